"""The content of one camera's message: vertical planes, prisms, free ranges and ground.

The arrays are read-only. Lengths are metres, angles radians, z points down; all coordinates are in the frame that the
message names ("ned" or "level", docs/reference/frames.md of the service).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_M = 1e9
"""No position is farther from the origin, along any axis. Beyond it rounding errors exceed a micrometre, and squares
overflow in the end: such a number is handled like NaN."""


class PlaneFlags(IntFlag):
    """Properties of a plane."""

    INFERRED = 1
    """A part of it was not measured: a gap too small to pass was filled."""
    UNKNOWN_BEHIND = 2
    """The space behind it was not observed."""
    CUT_LEFT = 4
    CUT_RIGHT = 8
    CUT_TOP = 16
    CUT_BOTTOM = 32
    """The border of the image cuts it on this side: it may continue there."""
    IRREGULAR = 64
    """More than half of its pixels are scattered or inclined: on no vertical surface, as those of foliage."""


class FreeEnd(IntEnum):
    """Why the free range of a direction ends."""

    NOT_SEEN = 0
    OBSTACLE = 1
    UNKNOWN = 2
    FIELD_OF_VIEW = 3
    MAX_RANGE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The surface that was taken for ground. seen: False where none was found.

    height_m: vertical distance of the camera above it; slope_x, slope_y: dz/dx and dz/dy; share: its share of the measured
    pixels. blind_beyond_m: horizontal range beyond which an obstacle of the minimum height cannot be distinguished from
    it. noise_per_m: noise of its height in metres per metre of horizontal range; tolerance_m: nothing closer above it is
    ever free. seen_from_m, seen_to_m: for each direction of the FreeProfile the horizontal ranges between which it was
    measured (to <= from: not measured in this direction)."""

    seen: bool
    height_m: float = math.nan
    slope_x: float = 0.0
    slope_y: float = 0.0
    share: float = 0.0
    blind_beyond_m: float = math.inf
    tolerance_m: float = 0.0
    noise_per_m: float = 0.0
    seen_from_m: tuple[float, ...] = ()
    seen_to_m: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FreeProfile:
    """Observed free space for each of D directions and L layers of height.

    azimuth_edges_rad: (D + 1,) float32, increasing, clockwise from above; layer_edges_m: (L + 1,) float32 in z,
    increasing. free_from_m, free_to_m: (D, L) float32 horizontal ranges between which the whole layer was observed free
    (free_to <= free_from: nothing is known to be free); end: (D, L) uint8 FreeEnd of free_to_m. open_from_dm, open_to_dm: (D, L)
    uint8 horizontal ranges in decimetres between which the layer is free or open, that is presumed free without a measurement;
    both 0 where that is no farther than what is free; (0, 0): the service presumes nothing. Raises ValueError for shapes and dtypes
    that do not fit together."""

    azimuth_edges_rad: NDArray[np.float32]
    layer_edges_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]
    open_from_dm: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    open_to_dm: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0), np.uint8))

    def __post_init__(self) -> None:
        table = (len(self.azimuth_edges_rad) - 1, len(self.layer_edges_m) - 1)
        set_readonly(self, "azimuth_edges_rad", np.float32, (None,))
        set_readonly(self, "layer_edges_m", np.float32, (None,))
        set_readonly(self, "free_from_m", np.float32, table)
        set_readonly(self, "free_to_m", np.float32, table)
        set_readonly(self, "end", np.uint8, table)
        opened = table if self.has_open else (0, 0)
        set_readonly(self, "open_from_dm", np.uint8, opened)
        set_readonly(self, "open_to_dm", np.uint8, opened)

    @property
    def has_open(self) -> bool:
        """Whether the profile holds open ranges."""
        return self.open_from_dm.size > 0 or self.open_to_dm.size > 0

    @property
    def open_from_m(self) -> NDArray[np.float32]:
        """open_from_dm in metres; without open ranges (0, 0)."""
        return self.open_from_dm * np.float32(0.1)

    @property
    def open_to_m(self) -> NDArray[np.float32]:
        """open_to_dm in metres; without open ranges (0, 0)."""
        return self.open_to_dm * np.float32(0.1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prism:
    """One layer of one obstacle: its side profile between two heights.

    vertices_m: (M, 2) float32 x, y; walking from vertex to vertex, free space is on the right seen from above. closed: the
    last vertex joins the first. plane: (M - 1,) int32, (M,) when closed: the plane of each edge. top_m < bottom_m, since z
    points down; otherwise ValueError is raised."""

    cluster: int
    top_m: float
    bottom_m: float
    closed: bool
    margin_m: float
    vertices_m: NDArray[np.float32]
    plane: NDArray[np.int32]

    def __post_init__(self) -> None:
        set_readonly(self, "vertices_m", np.float32, (None, 2))
        set_readonly(self, "plane", np.int32, (len(self.vertices_m) - (0 if self.closed else 1),))
        if not self.top_m < self.bottom_m:
            raise ValueError(f"prism: top {self.top_m} must be less than bottom {self.bottom_m} (z points down)")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraModel:
    """Obstacles and free space of one camera at one exposure. valid = False: it contains no information, and nothing may be
    taken as free.

    planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, with top < bottom; free space lies on the right of a -> b seen
    from above. support_px: (N,) int32 source pixels; margin_m: (N,) float32, to be subtracted from free space in front of
    the plane; flags: (N,) uint8 PlaneFlags; cluster: (N,) int32. Raises ValueError for arrays that do not fit together."""

    valid: bool
    planes: NDArray[np.float32]
    support_px: NDArray[np.int32]
    margin_m: NDArray[np.float32]
    flags: NDArray[np.uint8]
    cluster: NDArray[np.int32]
    prisms: Sequence[Prism]
    free: FreeProfile
    ground: Ground

    def __post_init__(self) -> None:
        n = len(self.planes)
        set_readonly(self, "planes", np.float32, (None, 6))
        set_readonly(self, "support_px", np.int32, (n,))
        set_readonly(self, "margin_m", np.float32, (n,))
        set_readonly(self, "flags", np.uint8, (n,))
        set_readonly(self, "cluster", np.int32, (n,))
        if n and not (self.planes[:, 4] < self.planes[:, 5]).all():
            raise ValueError("planes: top must be less than bottom (z points down)")


def without_free(model: CameraModel) -> CameraModel:
    """The model in which nothing is free or open. Planes, prisms and ground stay."""
    free = model.free
    none = np.zeros_like(free.free_to_m)
    free = FreeProfile(
        azimuth_edges_rad=free.azimuth_edges_rad,
        layer_edges_m=free.layer_edges_m,
        free_from_m=none,
        free_to_m=none,
        end=np.zeros_like(free.end),
    )
    return replace(model, free=free)


def set_readonly(owner: object, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> None:
    """Replaces an array field of a frozen dataclass by a read-only view. None in shape: any length. Raises ValueError for
    another dtype or shape."""
    array: NDArray[Any] = getattr(owner, name)
    if array.dtype != dtype:
        raise ValueError(f"{name}: dtype {array.dtype}, expected {np.dtype(dtype)}")
    fits = len(shape) == array.ndim and all(
        want is None or want == length for want, length in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name}: shape {array.shape}, expected {shape}")
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    object.__setattr__(owner, name, view)

"""The result of one depth frame, and the state passed to the next frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from .arrays import NOTHING_OPEN, store_readonly


class InvalidCause(Code):
    """Cause of an invalid frame. NONE: the frame is valid."""

    NONE = "", ""
    NO_MEASUREMENT = "no_measurement", "too few pixels hold a measurement"
    TOO_STEEP = "too_steep", "the camera is tilted too far for vertical columns to have a meaning"
    BAD_ROTATION = "bad_rotation", "the attitude is not a rotation"
    NON_FINITE = "non_finite", "the result holds values that are not finite"
    MOUNT_ERROR = "mount_error", "mount wrong: the camera's roll or pitch differs from its configuration"
    MOUNT_UNVERIFIED = (
        "mount_unverified",
        "mount unverified, turn the vehicle: the ground appears inclined by terrain or a wrong mount",
    )


class PlaneFlags(IntFlag):
    """Properties of a plane."""

    INFERRED = 1
    """Part of it was never measured: a gap too small to pass was filled."""
    UNKNOWN_BEHIND = 2
    """The space behind it was not observed; clear only where a gap was observed to be open and filled."""
    CUT_LEFT = 4
    CUT_RIGHT = 8
    CUT_TOP = 16
    CUT_BOTTOM = 32
    """The image border cut it there: it may continue."""
    IRREGULAR = 64
    """Most of its pixels are scattered or sloping: on strips that are no vertical surface."""


class FreeEnd(IntEnum):
    """Cause of the end of a free range."""

    NOT_SEEN = 0
    OBSTACLE = 1
    UNKNOWN = 2
    FIELD_OF_VIEW = 3
    MAX_RANGE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The horizontal surface under the camera.

    Attributes:
        seen: False: no ground was found, and none is assumed.
        height_m: height of the camera above the ground, positive; equal to z of the ground in level_cam below the
            camera.
        slope_x, slope_y: dz/dx and dz/dy of the fitted plane.
        share: share of the measured pixels that belong to it.
        blind_beyond_m: forward distance beyond which the noise hides an obstacle of the minimum height on the ground;
            inf: at no distance.
        noise_per_m: noise of the ground's height per metre of horizontal range, in metres. A point above it by less
            than this belongs to the ground.
        tolerance_m: space above the ground by less than this is never free, at any range.
        seen_from_m, seen_to_m: for each direction of the FreeProfile, the horizontal ranges between which the ground
            was measured, up to blind_beyond_m. to <= from: not measured in this direction; empty: in none."""

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
    """Observed free space for each direction and layer of height, in level_cam.

    Attributes:
        azimuth_edges_rad: (D + 1,) float32, increasing, clockwise from above.
        layer_edges_m: (L + 1,) float32 in z (down), increasing.
        free_from_m, free_to_m: (D, L) float32 horizontal ranges between which the whole layer was observed to be
            free. free_to <= free_from: nothing is free.
        end: (D, L) uint8, FreeEnd of free_to_m.
        open_from_dm, open_to_dm: (D, L) uint8 horizontal ranges in decimetres, rounded inwards, between which the
            layer is free or open, that is, presumed free without a measurement (core/stages/open_space.py). Both are
            0 if the open range is not longer than the free one."""

    azimuth_edges_rad: NDArray[np.float32]
    layer_edges_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]
    open_from_dm: NDArray[np.uint8] = field(default_factory=lambda: NOTHING_OPEN)
    open_to_dm: NDArray[np.uint8] = field(default_factory=lambda: NOTHING_OPEN)

    def __post_init__(self) -> None:
        d, layers = len(self.azimuth_edges_rad) - 1, len(self.layer_edges_m) - 1
        store_readonly(self, np.float32, (None,), "azimuth_edges_rad", "layer_edges_m")
        store_readonly(self, np.float32, (d, layers), "free_from_m", "free_to_m")
        store_readonly(self, np.uint8, (d, layers), "end")
        store_readonly(self, np.uint8, (d, layers) if self.has_open else (0, 0), "open_from_dm", "open_to_dm")

    @property
    def has_open(self) -> bool:
        """True if the profile contains open ranges."""
        return self.open_from_dm.size > 0 or self.open_to_dm.size > 0

    @property
    def open_from_m(self) -> NDArray[np.float32]:
        """open_from_dm in metres, (D, L); shape (0, 0) if there are no open ranges."""
        return self.open_from_dm * np.float32(0.1)

    @property
    def open_to_m(self) -> NDArray[np.float32]:
        """open_to_dm in metres, (D, L); shape (0, 0) if there are no open ranges."""
        return self.open_to_dm * np.float32(0.1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prism:
    """One layer of one obstacle: its outline between two heights.

    Attributes:
        vertices_m: (M, 2) float32 x, y. Seen from above, free space is on the right on the way from each vertex to
            the next.
        closed: the last vertex is connected to the first.
        plane: (M - 1,) int32, or (M,) if closed: the plane of each edge."""

    cluster: int
    top_m: float
    bottom_m: float
    closed: bool
    margin_m: float
    vertices_m: NDArray[np.float32]
    plane: NDArray[np.int32]

    def __post_init__(self) -> None:
        store_readonly(self, np.float32, (None, 2), "vertices_m")
        store_readonly(self, np.int32, (len(self.vertices_m) - (0 if self.closed else 1),), "plane")
        if not self.top_m < self.bottom_m:
            raise ValueError(f"prism: top {self.top_m} must be less than bottom {self.bottom_m} (z is down)")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameStats:
    """Counts of one frame, for the log. It contains no times."""

    measured_share: float = 0.0
    unknown_share: float = 1.0
    far_share: float = 0.0
    flying_px: int = 0
    smeared_px: int = 0
    ground_px: int = 0
    strips: int = 0
    dropped_strips: int = 0
    clusters: int = 0
    planes: int = 0
    prisms: int = 0
    overflow: int = 0
    """Strips or planes that did not fit the bounded buffers; they are merged into coarser ones, never dropped."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StripTable:
    """The strips of one frame, for drawing and tests.

    All arrays are (S,): column u, first and last row (inclusive) of the levelled view, forward distance x_m
    (level_cam), lateral position y_m, top_m < bottom_m in z, cluster (-1: none)."""

    u: NDArray[np.int32]
    row_top: NDArray[np.int32]
    row_bottom: NDArray[np.int32]
    x_m: NDArray[np.float32]
    y_m: NDArray[np.float32]
    top_m: NDArray[np.float32]
    bottom_m: NDArray[np.float32]
    support_px: NDArray[np.int32]
    cluster: NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameModel:
    """The result of one depth frame, in level_cam.

    Attributes:
        valid: False: the model contains no information, and no space may be taken as free.
        planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom in metres, top < bottom (z down). Free space is on the
            right of a -> b seen from above.
        support_px: (N,) int32, number of different source pixels.
        margin_m: (N,) float32, to be subtracted from the free space in front of the plane.
        flags: (N,) uint8 PlaneFlags.
        cluster: (N,) int32.
        ke_per_m: noise coefficient in use, sigma_Z = ke * Z^2."""

    valid: bool
    cause: InvalidCause
    planes: NDArray[np.float32]
    support_px: NDArray[np.int32]
    margin_m: NDArray[np.float32]
    flags: NDArray[np.uint8]
    cluster: NDArray[np.int32]
    prisms: Sequence[Prism]
    free: FreeProfile
    ground: Ground
    stats: FrameStats
    ke_per_m: float
    strips: StripTable | None = field(default=None)

    def __post_init__(self) -> None:
        n = len(self.planes)
        store_readonly(self, np.float32, (None, 6), "planes")
        store_readonly(self, np.int32, (n,), "support_px", "cluster")
        store_readonly(self, np.float32, (n,), "margin_m")
        store_readonly(self, np.uint8, (n,), "flags")
        if n and not (self.planes[:, 4] < self.planes[:, 5]).all():
            raise ValueError("planes: top must be less than bottom (z is down)")


@dataclass(frozen=True, slots=True)
class ExtractorState:
    """State passed to the next frame. nan: not known yet.

    Attributes:
        ke_per_m: noise coefficient in use.
        still_ke_per_m: noise coefficient measured over time, from frames between which the camera did not move.
        samples_mm: sampled pixels of an earlier frame, little-endian uint16 millimetres; b"": none.
        samples_age: number of frames since then, see `temporal_noise`.
        edge_ramps, edge_steps: weighted shares of edges that are smeared and that are not, see `observe_edges`."""

    ground_height_m: float = math.nan
    ke_per_m: float = math.nan
    still_ke_per_m: float = math.nan
    samples_mm: bytes = b""
    samples_age: int = 0
    edge_ramps: float = 0.0
    edge_steps: float = 0.0

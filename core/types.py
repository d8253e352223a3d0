"""Data types shared by all packages: frozen and validated, with every instant on the companion's monotonic clock.

Units stand in the names (`_m`, `_mm`, `_px`, `_rad`, `_ns`); transforms are `R_target_source`.
Frames: `optical` (x right, y down, z forward), `frd` (vehicle body), `ned` (the autopilot's local world),
`level_cam` (origin at the camera, x along the camera's horizontal heading, y right, z down) and
`level` (origin of frd, x along the vehicle's heading, y right, z down). See docs/reference/frames.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .codes import Code

UNKNOWN_MM = 0
"""A depth pixel without a measurement: its ray is unknown."""
FAR_MM = 65534
"""A depth pixel that the sensor reports as free up to its maximum range."""
SATURATED_MM = 65535
"""Treated like UNKNOWN_MM everywhere: some sensors write it for invalid pixels."""


_Scalar = TypeVar("_Scalar", bound=np.generic)
_Thing = TypeVar("_Thing")
_NATIVE: dict[Any, np.dtype[Any]] = {
    kind: np.dtype(kind) for kind in (np.bool_, np.uint8, np.uint16, np.int32, np.float32)
}
"""The dtype objects of arrays of these types: an identity test costs a third of a comparison."""


def readonly(a: NDArray[Any], dtype: type[_Scalar], shape: tuple[int | None, ...], name: str) -> NDArray[_Scalar]:
    """A read-only C-contiguous view of `a` after checking dtype and shape (None: any length); `a` itself where it is one.
    Raises ValueError."""
    if a.dtype is not _NATIVE.get(dtype) and a.dtype != dtype:
        raise ValueError(f"{name}: dtype {a.dtype}, expected {np.dtype(dtype)}")
    got = a.shape
    if got != shape:
        fits = len(got) == len(shape)
        for want, length in zip(shape, got, strict=False):
            fits = fits and (want is None or want == length)
        if not fits:
            raise ValueError(f"{name}: shape {got}, expected {shape}")
    flags = a.flags
    if not flags.c_contiguous:
        a = np.ascontiguousarray(a)
    elif not flags.writeable:
        return a
    view = a.view()
    view.flags.writeable = False
    return view


def _unchecked(kind: type[_Thing], **values: Any) -> _Thing:
    """A frozen object of values that fit, unchecked; its arrays become read-only."""
    thing = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(thing, name, value)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return thing


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera without distortion. Pixel (u, v) has its centre at integer coordinates; its ray in
    `optical` is ((u - cx)/fx, (v - cy)/fy, 1)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not (16 <= self.width <= 4096 and 16 <= self.height <= 4096):
            raise ValueError(f"intrinsics: image of {self.width}x{self.height}, expected 16..4096 a side")
        for name in ("fx", "fy", "cx", "cy"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"intrinsics: {name} is not finite")
        if not (0.1 * self.width < self.fx < 20 * self.width and 0.1 * self.width < self.fy < 20 * self.width):
            raise ValueError(
                f"intrinsics: fx={self.fx:g}, fy={self.fy:g} px do not fit an image {self.width} px wide "
                "(were they calibrated at another resolution?)"
            )
        if not (-0.5 * self.width < self.cx < 1.5 * self.width and -0.5 * self.height < self.cy < 1.5 * self.height):
            raise ValueError(f"intrinsics: principal point ({self.cx:g}, {self.cy:g}) lies far outside the image")


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where a camera sits on the vehicle: angles of R_frd_camfrd = Rz(yaw) Ry(pitch) Rx(roll), where camfrd is
    the camera's own forward-right-down triad, and its lever arm in frd, metres. Zeros: looks forward, level."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("roll_rad", "pitch_rad", "yaw_rad", "x_m", "y_m", "z_m"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"camera mount: {name} is not finite")


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Constants of one camera. `max_range_m` and `min_range_m` bound what it measures;
    `ke_per_m` is the prior of its noise, sigma_Z = ke * Z^2."""

    camera: str
    intrinsics: Intrinsics
    mount: CameraMount = CameraMount()
    min_range_m: float = 0.3
    max_range_m: float = 20.0
    ke_per_m: float = 0.005

    def __post_init__(self) -> None:
        if not self.camera or not self.camera.isprintable():
            raise ValueError("camera info: the camera needs a printable name")
        if not 0.0 < self.min_range_m < self.max_range_m <= 65.0:
            raise ValueError(
                f"camera info: range {self.min_range_m:g}..{self.max_range_m:g} m, expected 0 < min < max <= 65"
            )
        if not 1e-5 <= self.ke_per_m <= 0.05:
            raise ValueError(f"camera info: ke_per_m={self.ke_per_m:g}, expected 1e-5..0.05")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DepthFrame:
    """One depth image. depth_mm: (H, W) uint16, Z along the optical axis; UNKNOWN_MM, SATURATED_MM: no measurement;
    FAR_MM: free up to the camera's maximum. t_exposure_ns: mid-exposure; t_arrival_ns: when the host received it."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    depth_mm: NDArray[np.uint16]

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth_mm", readonly(self.depth_mm, np.uint16, (None, None), "depth_mm"))


@dataclass(frozen=True, slots=True)
class AttitudeSample:
    """Attitude of the vehicle at t_ns: q_ned_frd (w, x, y, z) unit quaternion, body rates in frd, rad/s (None: not known).
    t_arrival_ns: when the host received it."""

    t_ns: int
    t_arrival_ns: int
    q_ned_frd_wxyz: tuple[float, float, float, float]
    rates_frd_rad_s: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        w, x, y, z = self.q_ned_frd_wxyz
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(norm - 1.0) < 1e-3:  # also catches NaN
            raise ValueError(f"attitude at {self.t_ns} ns: quaternion norm {norm:g}, expected 1")
        if self.rates_frd_rad_s is not None and not all(map(math.isfinite, self.rates_frd_rad_s)):
            raise ValueError(f"attitude at {self.t_ns} ns: body rates are not finite")


@dataclass(frozen=True, slots=True)
class PoseSample:
    """Position of the vehicle (origin of frd) in ned, metres, and its velocity in ned, m/s (None: not known)."""

    t_ns: int
    t_arrival_ns: int
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float] | None = None
    reset_counter: int = 0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.position_ned_m)):
            raise ValueError(f"pose at {self.t_ns} ns: position is not finite")
        if self.velocity_ned_m_s is not None and not all(map(math.isfinite, self.velocity_ned_m_s)):
            raise ValueError(f"pose at {self.t_ns} ns: velocity is not finite")


class InvalidCause(Code):
    """Why a frame is invalid. NONE: it is valid."""

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
    """Stands for scattered or sloping surfaces by their near side."""


class FreeEnd(IntEnum):
    """Why a direction's free range ends."""

    NOT_SEEN = 0
    OBSTACLE = 1
    UNKNOWN = 2
    FIELD_OF_VIEW = 3
    MAX_RANGE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """The horizontal surface under the camera. seen = False: none was found, none is assumed.

    height_m: camera above it, positive (z of the surface in level_cam); slope_x, slope_y: dz/dx, dz/dy of the fit;
    share: of the measured pixels; blind_beyond_m: forward distance beyond which an obstacle of the minimum height
    cannot be distinguished from it with this noise (inf: never).
    noise_per_m: noise of its height per metre of horizontal range, in metres; what lies closer above it is part of it.
    tolerance_m: nothing closer above it is ever free, at any range.
    seen_from_m, seen_to_m: for each direction of the frame's FreeProfile the horizontal ranges between which it was
    measured, up to blind_beyond_m; to <= from: not measured in this direction; empty: in none."""

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
    """Observed free space, per direction and layer of height, in level_cam.

    azimuth_edges_rad: (D + 1,) float32, increasing, clockwise from above; layer_edges_m: (L + 1,) float32 in z (down),
    increasing. free_from_m, free_to_m: (D, L) float32 horizontal ranges between which the whole layer was
    observed to be free in that direction (free_to <= free_from: nothing is); end: (D, L) uint8, FreeEnd of free_to_m."""

    azimuth_edges_rad: NDArray[np.float32]
    layer_edges_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]
    end: NDArray[np.uint8]

    def __post_init__(self) -> None:
        d, layers = len(self.azimuth_edges_rad) - 1, len(self.layer_edges_m) - 1
        put = object.__setattr__
        put(self, "azimuth_edges_rad", readonly(self.azimuth_edges_rad, np.float32, (None,), "azimuth_edges_rad"))
        put(self, "layer_edges_m", readonly(self.layer_edges_m, np.float32, (None,), "layer_edges_m"))
        put(self, "free_from_m", readonly(self.free_from_m, np.float32, (d, layers), "free_from_m"))
        put(self, "free_to_m", readonly(self.free_to_m, np.float32, (d, layers), "free_to_m"))
        put(self, "end", readonly(self.end, np.uint8, (d, layers), "end"))

    @classmethod
    def from_trusted(
        cls,
        *,
        azimuth_edges_rad: NDArray[np.float32],
        layer_edges_m: NDArray[np.float32],
        free_from_m: NDArray[np.float32],
        free_to_m: NDArray[np.float32],
        end: NDArray[np.uint8],
    ) -> FreeProfile:
        """A profile without checks, of arrays that a kernel has just written; they become read-only."""
        return _unchecked(
            cls,
            azimuth_edges_rad=azimuth_edges_rad,
            layer_edges_m=layer_edges_m,
            free_from_m=free_from_m,
            free_to_m=free_to_m,
            end=end,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prism:
    """One layer of one obstacle: the side profile between two heights.

    vertices_m: (M, 2) float32 x, y; walking from each vertex to the next, free space is on the right seen from above.
    closed: the last vertex joins the first. plane: (M - 1,) int32 (M when closed), the plane each edge belongs to."""

    cluster: int
    top_m: float
    bottom_m: float
    closed: bool
    margin_m: float
    vertices_m: NDArray[np.float32]
    plane: NDArray[np.int32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices_m", readonly(self.vertices_m, np.float32, (None, 2), "vertices_m"))
        edges = len(self.vertices_m) - (0 if self.closed else 1)
        object.__setattr__(self, "plane", readonly(self.plane, np.int32, (edges,), "plane"))
        if not self.top_m < self.bottom_m:
            raise ValueError(f"prism: top {self.top_m} must be less than bottom {self.bottom_m} (z is down)")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameStats:
    """Counts of one frame, for the log: never wall times."""

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
    """The strips of one frame, for drawing and tests. All (S,): virtual column u, first and last row (inclusive) of the
    levelled view, forward distance x_m (level_cam), lateral y_m, top_m < bottom_m in z, cluster (-1: none)."""

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
    """The result of one depth frame, in level_cam. `valid = False`: it holds no information, nothing may be taken as free.

    planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, metres, top < bottom (z down); free space lies on the right
    of a -> b seen from above. support_px: (N,) int32 distinct source pixels; margin_m: (N,) float32, what a consumer
    subtracts from free space in front of the plane; flags: (N,) uint8 PlaneFlags; cluster: (N,) int32.
    ke_per_m: the noise estimate used, sigma_Z = ke * Z^2."""

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
        put = object.__setattr__
        n = len(self.planes)
        put(self, "planes", readonly(self.planes, np.float32, (None, 6), "planes"))
        put(self, "support_px", readonly(self.support_px, np.int32, (n,), "support_px"))
        put(self, "margin_m", readonly(self.margin_m, np.float32, (n,), "margin_m"))
        put(self, "flags", readonly(self.flags, np.uint8, (n,), "flags"))
        put(self, "cluster", readonly(self.cluster, np.int32, (n,), "cluster"))
        if n and not (self.planes[:, 4] < self.planes[:, 5]).all():
            raise ValueError("planes: top must be less than bottom (z is down)")

    @classmethod
    def from_trusted(
        cls,
        *,
        valid: bool,
        cause: InvalidCause,
        planes: NDArray[np.float32],
        support_px: NDArray[np.int32],
        margin_m: NDArray[np.float32],
        flags: NDArray[np.uint8],
        cluster: NDArray[np.int32],
        prisms: Sequence[Prism],
        free: FreeProfile,
        ground: Ground,
        stats: FrameStats,
        ke_per_m: float,
        strips: StripTable | None = None,
    ) -> FrameModel:
        """A model without checks, of arrays that kernels have written and checked; they become read-only. A second check
        would take longer than many a stage."""
        return _unchecked(
            cls,
            valid=valid,
            cause=cause,
            planes=planes,
            support_px=support_px,
            margin_m=margin_m,
            flags=flags,
            cluster=cluster,
            prisms=prisms,
            free=free,
            ground=ground,
            stats=stats,
            ke_per_m=ke_per_m,
            strips=strips,
        )


@dataclass(frozen=True, slots=True)
class ExtractorState:
    """What one frame passes to the next: height of the ground and noise estimates (nan: none yet).

    ke_per_m: noise in use. still_ke_per_m: noise measured over time, from frames between which the camera stood still.
    samples_mm, samples_age: sampled pixels of an earlier frame, little-endian uint16 millimetres (b"": none), and how many
    frames ago that was; see `temporal_noise`.
    edge_ramps, edge_steps: weighted shares of edges that are smeared and that are not; see `observe_edges`."""

    ground_height_m: float = math.nan
    ke_per_m: float = math.nan
    still_ke_per_m: float = math.nan
    samples_mm: bytes = b""
    samples_age: int = 0
    edge_ramps: float = 0.0
    edge_steps: float = 0.0

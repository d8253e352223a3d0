"""Inputs of the extraction: constants of the camera, a depth image, attitude and position of the vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .arrays import store_readonly

UNKNOWN_MM = 0
"""A depth pixel without a measurement: its ray is unknown."""
TEXTURELESS_MM = 1
"""A pixel without a measurement whose image shows a smooth surface: sky or blank paint. Nothing is measured there, and below
every least range it is unknown like UNKNOWN_MM; only core/stages/open_space.py distinguishes them."""
BEYOND_MM = 2
"""A pixel that was matched, at a distance greater than 65 m. Unknown like TEXTURELESS_MM for all but
core/stages/open_space.py."""
CONTINUED_MM = 3
"""A pixel without a measurement whose image is smooth and as bright as the matched surface below it. Unknown like
TEXTURELESS_MM for all but core/stages/open_space.py."""
TEXTURED_MM = 4
"""A pixel without a measurement whose image is textured, neither dark nor saturated: an edge, or a match that was not accepted.
Unknown like TEXTURELESS_MM for all but core/stages/open_space.py."""
GREATEST_MARK_MM = TEXTURED_MM
"""Values from 1 up to this one are marks of unmeasured pixels and no distances."""
FAR_MM = 65534
"""A depth pixel that the sensor reports as free up to its maximum range."""
SATURATED_MM = 65535
"""Treated like UNKNOWN_MM everywhere: some sensors write it for invalid pixels."""


def is_measured(depth_mm: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Returns the pixels with a measured distance, bool of the same shape.

    A pixel is measured unless it has one of the special values above. The range of the camera is not applied."""
    return (depth_mm > GREATEST_MARK_MM) & (depth_mm < FAR_MM)


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera without distortion.

    The centre of pixel (u, v) has integer coordinates. Its ray in `optical` is ((u - cx)/fx, (v - cy)/fy, 1)."""

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
    """Position and orientation of a camera on the vehicle.

    The angles are those of R_frd_camfrd = Rz(yaw) Ry(pitch) Rx(roll), where camfrd is the camera's own
    forward-right-down frame. x_m, y_m and z_m are the lever arm in frd. With zeros the camera looks forward and is
    level."""

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


MOST_BIAS_PER_M: Final = 0.3
"""Greatest bias_per_m of a CameraInfo: an error of 2.3 px of disparity with a baseline of 2 cm."""


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Constants of one camera.

    Attributes:
        min_range_m, max_range_m: limits of the measured distance.
        ke_per_m: initial value of the noise coefficient, sigma_Z = ke * Z^2.
        bias_per_m: assumed greatest error that all depths of the camera share, over Z^2: of its calibration. No frame shows
            it, so it is part of each margin. For an error e of the disparity in pixels, bias_per_m = e / (f B).
        marks_smooth: the driver writes TEXTURELESS_MM, BEYOND_MM and GREATEST_MARK_MM. Otherwise these values are raw
            depths of unknown pixels, and no evidence of open space."""

    camera: str
    intrinsics: Intrinsics
    mount: CameraMount = CameraMount()
    min_range_m: float = 0.3
    max_range_m: float = 20.0
    ke_per_m: float = 0.005
    marks_smooth: bool = False
    bias_per_m: float = 0.0

    @property
    def least_mm(self) -> int:
        """Least value in millimetres that counts as measured: at least min_range_m, and above every special value."""
        return math.ceil(max(GREATEST_MARK_MM + 1.0, 1000.0 * self.min_range_m))

    def __post_init__(self) -> None:
        if not self.camera or not self.camera.isprintable():
            raise ValueError("camera info: the camera needs a printable name")
        if not 0.0 < self.min_range_m < self.max_range_m <= 65.0:
            raise ValueError(
                f"camera info: range {self.min_range_m:g}..{self.max_range_m:g} m, expected 0 < min < max <= 65"
            )
        if not 1e-5 <= self.ke_per_m <= 0.05:
            raise ValueError(f"camera info: ke_per_m={self.ke_per_m:g}, expected 1e-5..0.05")
        if not 0.0 <= self.bias_per_m <= MOST_BIAS_PER_M:
            raise ValueError(f"camera info: bias_per_m={self.bias_per_m:g}, expected 0..{MOST_BIAS_PER_M:g}")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DepthFrame:
    """One depth image.

    Attributes:
        depth_mm: (H, W) uint16, distance Z along the optical axis. UNKNOWN_MM and SATURATED_MM: not measured; FAR_MM:
            free up to the maximum of the camera.
        t_exposure_ns: middle of the exposure.
        t_arrival_ns: when the host received the image.
        images_crc: CRC-32 of the images from which the driver matched the depth, 0: it did not. The same images may be matched
            in another way, as after an alignment of their rows."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int
    depth_mm: NDArray[np.uint16]
    images_crc: int = 0

    def __post_init__(self) -> None:
        store_readonly(self, np.uint16, (None, None), "depth_mm")


MAX_RATE_RAD_S = 70.0
"""Twice the measuring range of autopilots' gyros: greater body rates are measurement errors."""
MAX_SPEED_M_S = 200.0
"""No multirotor is faster: greater velocities are errors."""


@dataclass(frozen=True, slots=True)
class AttitudeSample:
    """Attitude of the vehicle at t_ns.

    q_ned_frd_wxyz is a unit quaternion. Body rates are in frd, rad/s; None: not known. t_arrival_ns: when the host
    received the sample. stamp_error_ns: greatest error of t_ns by the autopilot's clock, 30 ms by assumption where the
    delay of the line is not measured; 0: not stated."""

    t_ns: int
    t_arrival_ns: int
    q_ned_frd_wxyz: tuple[float, float, float, float]
    rates_frd_rad_s: tuple[float, float, float] | None = None
    stamp_error_ns: int = 0

    def __post_init__(self) -> None:
        w, x, y, z = self.q_ned_frd_wxyz
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(norm - 1.0) < 1e-3:  # also catches NaN
            raise ValueError(f"attitude at {self.t_ns} ns: quaternion norm {norm:g}, expected 1")
        if self.rates_frd_rad_s is not None and not all(map(math.isfinite, self.rates_frd_rad_s)):
            raise ValueError(f"attitude at {self.t_ns} ns: body rates are not finite")


@dataclass(frozen=True, slots=True)
class PoseSample:
    """Position of the vehicle (origin of frd) in ned, metres, and its velocity in ned, m/s; None: not known.

    stamp_error_ns: greatest error of t_ns by the autopilot's clock; 0: not stated."""

    t_ns: int
    t_arrival_ns: int
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float] | None = None
    reset_counter: int = 0
    stamp_error_ns: int = 0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.position_ned_m)):
            raise ValueError(f"pose at {self.t_ns} ns: position is not finite")
        if self.velocity_ned_m_s is not None and not all(map(math.isfinite, self.velocity_ned_m_s)):
            raise ValueError(f"pose at {self.t_ns} ns: velocity is not finite")

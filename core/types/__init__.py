"""Data types shared by all packages: frozen and validated, with every instant on the companion's monotonic clock.

Units stand in the names (`_m`, `_mm`, `_px`, `_rad`, `_ns`); transforms are `R_target_source`.
Frames: `optical` (x right, y down, z forward), `frd` (vehicle body), `ned` (the autopilot's local world),
`level_cam` (origin at the camera, x along the camera's horizontal heading, y right, z down) and
`level` (origin of frd, x along the vehicle's heading, y right, z down). See docs/reference/frames.md.
"""

from .arrays import NOTHING_OPEN, readonly, store_readonly
from .inputs import (
    BEYOND_MM,
    CONTINUED_MM,
    FAR_MM,
    GREATEST_MARK_MM,
    MAX_RATE_RAD_S,
    MAX_SPEED_M_S,
    MOST_BIAS_PER_M,
    SATURATED_MM,
    TEXTURED_MM,
    TEXTURELESS_MM,
    UNKNOWN_MM,
    AttitudeSample,
    CameraInfo,
    CameraMount,
    DepthFrame,
    Intrinsics,
    PoseSample,
    is_measured,
)
from .model import (
    ExtractorState,
    FrameModel,
    FrameStats,
    FreeEnd,
    FreeProfile,
    Ground,
    InvalidCause,
    PlaneFlags,
    Prism,
    StripTable,
)

__all__ = [
    "BEYOND_MM",
    "CONTINUED_MM",
    "FAR_MM",
    "GREATEST_MARK_MM",
    "MAX_RATE_RAD_S",
    "MAX_SPEED_M_S",
    "MOST_BIAS_PER_M",
    "NOTHING_OPEN",
    "SATURATED_MM",
    "TEXTURED_MM",
    "TEXTURELESS_MM",
    "UNKNOWN_MM",
    "AttitudeSample",
    "CameraInfo",
    "CameraMount",
    "DepthFrame",
    "ExtractorState",
    "FrameModel",
    "FrameStats",
    "FreeEnd",
    "FreeProfile",
    "Ground",
    "Intrinsics",
    "InvalidCause",
    "PlaneFlags",
    "PoseSample",
    "Prism",
    "StripTable",
    "is_measured",
    "readonly",
    "store_readonly",
]

"""Places the model of a frame in ned, for viewers and exports."""

from __future__ import annotations

import math

import numpy as np

from core.types import FrameModel

from ..pipeline.transform import LevelTransform, transform_model
from .frame import FrameStatus, ViewFrame


def ned_from_level_cam(frame: ViewFrame) -> LevelTransform:
    """level_cam -> ned, with the origin at the vehicle where the frame has no position. Identity without an attitude."""
    if frame.R_ned_frd is None:
        return LevelTransform(0.0, (0.0, 0.0, 0.0))
    yaw_rad, t_level = frame.level_from_level_cam
    heading_rad = math.atan2(float(frame.R_ned_frd[1, 0]), float(frame.R_ned_frd[0, 0]))
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y, z = (float(v) for v in t_level)
    at = np.array([c * x - s * y, s * x + c * y, z]) + (frame.position_ned_m or (0.0, 0.0, 0.0))
    return LevelTransform(yaw_rad + heading_rad, (float(at[0]), float(at[1]), float(at[2])))


def placed_model(frame: ViewFrame) -> FrameModel | None:
    """The model of a valid frame in ned; None otherwise."""
    if frame.model is None or frame.status is not FrameStatus.VALID:
        return None
    return transform_model(frame.model, ned_from_level_cam(frame))

"""Places the model of a frame in ned, for viewers and exports."""

from __future__ import annotations

from core.frames import rotation_level_ned
from core.types import FrameModel

from ..pipeline.transform import LevelTransform, transform_model
from .frame import FrameStatus, ViewFrame


def ned_from_level_cam(frame: ViewFrame) -> LevelTransform:
    """level_cam -> ned, with the origin at the vehicle where the frame has no position. Identity without an attitude."""
    if frame.R_ned_frd is None:
        return LevelTransform(0.0)
    yaw_rad, t_level = frame.level_from_level_cam
    R_ned_level = rotation_level_ned(frame.heading_rad).T
    north_m, east_m, down_m = (R_ned_level @ t_level + (frame.position_ned_m or (0.0, 0.0, 0.0))).tolist()
    return LevelTransform(yaw_rad + frame.heading_rad, (north_m, east_m, down_m))


def placed_model(frame: ViewFrame) -> FrameModel | None:
    """The model of a valid frame in ned; None otherwise."""
    if frame.model is None or frame.status is not FrameStatus.VALID:
        return None
    return transform_model(frame.model, ned_from_level_cam(frame))

"""Transforms the model of a frame from level_cam to the published frame: a rotation about the vertical and a
translation."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from core.frames import Vector
from core.types import ExtractorState, FrameModel

from .sync import PoseAt

_Place = TypeVar("_Place", float, NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class LevelTransform:
    """p_frame = Rz(yaw_rad) p_level_cam + translation_m; translation_m is the position of the camera."""

    yaw_rad: float
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def places(self, x_m: _Place, y_m: _Place) -> tuple[_Place, _Place]:
        """Returns (x, y), m, in the target frame of places x, y of level_cam; of any shape."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return c * x_m - s * y_m + self.translation_m[0], s * x_m + c * y_m + self.translation_m[1]

    def inverse(self) -> LevelTransform:
        """p_level_cam = Rz(-yaw_rad) (p_frame - translation_m)."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y, z = self.translation_m
        return LevelTransform(-self.yaw_rad, (-(c * x + s * y), s * x - c * y, -z))


def transform_model(model: FrameModel, transform: LevelTransform) -> FrameModel:
    """The model in the transform's target frame; an invalid model where its numbers are not all finite. See
    `core.transformed`."""
    # imported late: compiled code, which commands that only read results do not need
    from core.transformed import turned

    return turned(model, transform.yaw_rad, transform.translation_m)


def seed_ground_height(state: ExtractorState, pose: PoseAt | None, transform: LevelTransform) -> ExtractorState:
    """The state with the camera's height above the origin of ned as ground seed, where no frame has set one yet.

    The seed is a hint only: the ground must still be found in the image. transform: level_cam to the published frame.
    """
    height_m = -transform.translation_m[2]
    if pose is None or math.isfinite(state.ground_height_m) or height_m <= 0.0:
        return state
    return dataclasses.replace(state, ground_height_m=height_m)


def transform_from_level_cam(
    camera_rad: float, vehicle_rad: float, lever_ned_m: Vector, pose: PoseAt | None
) -> LevelTransform:
    """The transform level_cam -> level, or level_cam -> ned where a position is given. Computed from the headings of
    camera and vehicle and the camera's lever arm, see `level_cam_at`."""
    x, y, z = lever_ned_m
    if pose is not None:
        north, east, down = pose.position_ned_m
        return LevelTransform(camera_rad, (x + north, y + east, z + down))
    c, s = math.cos(vehicle_rad), math.sin(vehicle_rad)
    return LevelTransform(math.remainder(camera_rad - vehicle_rad, math.tau), (c * x + s * y, c * y - s * x, z))

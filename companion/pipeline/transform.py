"""A frame's model moved from level_cam into the frame it is published in: a turn about the vertical and a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

from core.types import FrameModel


@dataclass(frozen=True, slots=True)
class LevelTransform:
    """p_frame = Rz(yaw_rad) p_level_cam + translation_m; the translation is where the camera is."""

    yaw_rad: float
    translation_m: tuple[float, float, float]

    def inverse(self) -> LevelTransform:
        """p_level_cam = Rz(-yaw_rad) (p_frame - translation_m)."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y, z = self.translation_m
        return LevelTransform(-self.yaw_rad, (-(c * x + s * y), s * x - c * y, -z))


def transform_model(model: FrameModel, transform: LevelTransform) -> FrameModel:
    """The model in the transform's target frame; one that says nothing where its numbers are not all finite. See
    `core.transformed`."""
    from core.transformed import turned  # compiled: planners, who only read, need no numba

    return turned(model, transform.yaw_rad, transform.translation_m)

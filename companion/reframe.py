"""A frame's model moved from level_cam into the frame it is published in: a turn about the vertical and a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from core.prism_table import prism_table
from core.types import FrameModel, FreeEnd, FreeProfile, Ground, InvalidCause


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


def numbers_only(model: FrameModel) -> FrameModel:
    """The very same model; where what it tells is not all finite, one that says nothing. Such a plane stands nowhere, and one
    that cannot be compared with anything may hide all others: the frame is blind."""
    free = model.free
    told = [model.planes, model.margin_m, free.azimuth_edges_rad, free.layer_edges_m, free.free_from_m, free.free_to_m]
    told.append(prism_table(model.prisms).vertices_m)
    if all(np.isfinite(numbers).all() for numbers in told):
        return model
    d, layers = free.end.shape
    nothing = np.zeros_like(free.free_to_m)
    seen_free_nowhere = FreeProfile(
        azimuth_edges_rad=np.linspace(-0.1, 0.1, d + 1, dtype=np.float32),
        layer_edges_m=np.arange(layers + 1, dtype=np.float32),
        free_from_m=nothing,
        free_to_m=nothing,
        end=np.full_like(free.end, FreeEnd.NOT_SEEN),
    )
    return replace(
        model,
        valid=False,
        cause=InvalidCause.NO_NUMBERS,
        planes=model.planes[:0],
        support_px=model.support_px[:0],
        margin_m=model.margin_m[:0],
        flags=model.flags[:0],
        cluster=model.cluster[:0],
        prisms=(),
        free=seen_free_nowhere,
        strips=None,
    )


def reframed(model: FrameModel, transform: LevelTransform) -> FrameModel:
    """The model in the transform's target frame. Ranges and the ground's height stay counted from the camera; strips,
    which are drawn over the image, are left out."""
    from core.turned import turned_planes, turned_prisms  # compiled: planners, who only read, need no numba

    c, s, shift_m = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad), transform.translation_m
    return replace(
        model,
        planes=turned_planes(model.planes, c, s, shift_m),
        prisms=turned_prisms(prism_table(model.prisms), c, s, shift_m) if len(model.prisms) else (),
        free=_free(model.free, transform),
        ground=_ground(model.ground, transform),
        strips=None,
    )


def _free(free: FreeProfile, transform: LevelTransform) -> FreeProfile:
    return replace(
        free,
        azimuth_edges_rad=(free.azimuth_edges_rad.astype(np.float64) + transform.yaw_rad).astype(np.float32),
        layer_edges_m=(free.layer_edges_m.astype(np.float64) + transform.translation_m[2]).astype(np.float32),
    )


def _ground(ground: Ground, transform: LevelTransform) -> Ground:
    c, s = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad)
    return replace(
        ground,
        slope_x=c * ground.slope_x - s * ground.slope_y,
        slope_y=s * ground.slope_x + c * ground.slope_y,
    )

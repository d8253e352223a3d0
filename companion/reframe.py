"""A frame's model moved from level_cam into the frame it is published in: a turn about the vertical and a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel, FreeEnd, FreeProfile, Ground, InvalidCause, Prism


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
    if model.prisms:
        told.append(np.concatenate([prism.vertices_m for prism in model.prisms]))
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
    planes = np.empty_like(model.planes)
    planes[:, 0:2] = _turned(model.planes[:, 0:2], transform)
    planes[:, 2:4] = _turned(model.planes[:, 2:4], transform)
    planes[:, 4:6] = model.planes[:, 4:6].astype(np.float64) + transform.translation_m[2]
    # far from the origin of ned float32 may round a very low plane to nothing
    planes[:, 5] = np.maximum(planes[:, 5], np.nextafter(planes[:, 4], np.float32(np.inf)))
    return replace(
        model,
        planes=planes,
        prisms=_prisms(model.prisms, transform),
        free=_free(model.free, transform),
        ground=_ground(model.ground, transform),
        strips=None,
    )


def _turned(xy_m: NDArray[np.float32], transform: LevelTransform) -> NDArray[np.float32]:
    """(N, 2) float32 points turned and shifted in float64."""
    c, s = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad)
    x, y = xy_m[:, 0].astype(np.float64), xy_m[:, 1].astype(np.float64)
    tx, ty, _ = transform.translation_m
    return np.stack([c * x - s * y + tx, s * x + c * y + ty], axis=1).astype(np.float32)


def _prisms(prisms: tuple[Prism, ...], transform: LevelTransform) -> tuple[Prism, ...]:
    """All vertices are turned at once: a frame has hundreds of prisms of a few vertices each."""
    if not prisms:
        return ()
    vertices_m = _turned(np.concatenate([prism.vertices_m for prism in prisms]), transform)
    z_m = transform.translation_m[2]
    moved, begin = [], 0
    for prism in prisms:
        end = begin + len(prism.vertices_m)
        top = np.float32(prism.top_m + z_m)
        bottom = max(np.float32(prism.bottom_m + z_m), np.nextafter(top, np.float32(np.inf)))
        moved.append(
            Prism(
                cluster=prism.cluster,
                top_m=float(top),
                bottom_m=float(bottom),
                closed=prism.closed,
                margin_m=prism.margin_m,
                vertices_m=vertices_m[begin:end],
                plane=prism.plane,
            )
        )
        begin = end
    return tuple(moved)


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

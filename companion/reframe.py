"""A frame's model moved from level_cam into the frame it is published in: a turn about the vertical and a shift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.prism_table import PrismTable, prism_table
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


def _prisms(prisms: Sequence[Prism], transform: LevelTransform) -> Sequence[Prism]:
    """All vertices are turned at once: a frame has hundreds of prisms of a few vertices each."""
    if not prisms:
        return ()
    table = prism_table(prisms)
    heights_m = (table.heights_m.astype(np.float64) + transform.translation_m[2]).astype(np.float32)
    heights_m[:, 1] = np.maximum(heights_m[:, 1], np.nextafter(heights_m[:, 0], np.float32(np.inf)))
    return PrismTable(
        table.cluster, heights_m, table.closed, table.margin_m, table.vertex_begin, table.edge_begin,
        _turned(table.vertices_m, transform), table.plane,
    )  # fmt: skip


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

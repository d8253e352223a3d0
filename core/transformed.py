"""Rotates the model of a frame about the vertical and shifts it. Computes in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .invalid_model import invalid_model
from .stages.prism_table import prism_table
from .types import FrameModel, InvalidCause


def turned(model: FrameModel, yaw_rad: float, shift_m: tuple[float, float, float]) -> FrameModel:
    """Returns the model rotated by yaw_rad, clockwise seen from above, and then shifted.

    Ranges and the height of the ground stay relative to the camera. Strips are left out, because they are only drawn
    over the image. The result is invalid (InvalidCause.NON_FINITE) if any number is not finite, before or after: such
    a plane cannot be compared with others and may hide all of them."""
    cos, sin, (x_m, y_m, z_m) = math.cos(yaw_rad), math.sin(yaw_rad), shift_m
    free, ground = model.free, model.ground
    table = prism_table(model.prisms)

    def place(points: NDArray[np.float32]) -> NDArray[np.float32]:
        x, y = points.astype(np.float64).T
        return np.column_stack((cos * x - sin * y + x_m, sin * x + cos * y + y_m)).astype(np.float32)

    with np.errstate(over="ignore", invalid="ignore"):  # tested below
        heights, vertices = _lowered(table.heights_m, z_m), place(table.vertices_m)
        planes = np.hstack(
            (place(model.planes[:, 0:2]), place(model.planes[:, 2:4]), _lowered(model.planes[:, 4:6], z_m))
        )
        azimuths = (free.azimuth_edges_rad.astype(np.float64) + yaw_rad).astype(np.float32)
        layers = (free.layer_edges_m.astype(np.float64) + z_m).astype(np.float32)
    before = model.planes, table.heights_m, table.vertices_m, model.margin_m, free.free_from_m, free.free_to_m
    if not all(np.isfinite(array).all() for array in (*before, planes, heights, vertices, azimuths, layers)):
        return invalid_model(model, InvalidCause.NON_FINITE)
    return replace(
        model,
        planes=planes,
        prisms=replace(table, heights_m=heights, vertices_m=vertices),
        free=replace(free, azimuth_edges_rad=azimuths, layer_edges_m=layers),
        ground=replace(
            ground,
            slope_x=cos * ground.slope_x - sin * ground.slope_y,
            slope_y=sin * ground.slope_x + cos * ground.slope_y,
        ),
        strips=None,
    )


def _lowered(heights: NDArray[np.float32], shift_m: float) -> NDArray[np.float32]:
    """Returns tops and bottoms (N, 2) shifted down.

    Far from the origin of ned, rounding to float32 may make top and bottom equal. The bottom is then the next number."""
    top, bottom = (heights.astype(np.float64) + shift_m).astype(np.float32).T
    return np.column_stack((top, np.maximum(bottom, np.nextafter(top, np.float32(np.inf)))))

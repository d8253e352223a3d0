"""Rotates the model of a frame about the vertical and shifts it. Computes in float64."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .invalid_model import invalid_model
from .jit import inner
from .stages.prism_table import NO_PRISMS, prism_table
from .types import FrameModel, FreeProfile, InvalidCause

_INFINITY = np.float32(np.inf)


class Placed(NamedTuple):
    """The parts of a model that contain positions, all float32.

    Fields:
        planes: (N, 6) planes.
        heights: (P, 2) top and bottom of prisms.
        vertices: (V, 2) vertices of prisms.
        azimuths: (D + 1,) azimuth edges of the free profile.
        layers: (L + 1,) layer edges of the free profile."""

    planes: Any
    heights: Any
    vertices: Any
    azimuths: Any
    layers: Any


class Motion(NamedTuple):
    """A rotation about the vertical, clockwise seen from above, followed by a shift in metres."""

    cos: float
    sin: float
    yaw_rad: float
    x_m: float
    y_m: float
    z_m: float


def turned(model: FrameModel, yaw_rad: float, shift_m: tuple[float, float, float]) -> FrameModel:
    """Returns the model rotated by yaw_rad, clockwise seen from above, and then shifted.

    Ranges and the height of the ground stay relative to the camera. Strips are left out, because they are only drawn
    over the image. The result is invalid (InvalidCause.NON_FINITE) if any number is not finite, before or after: such
    a plane cannot be compared with others and may hide all of them."""
    motion = Motion(math.cos(yaw_rad), math.sin(yaw_rad), float(yaw_rad), *(float(v) for v in shift_m))
    free, ground = model.free, model.ground
    table = prism_table(model.prisms) if len(model.prisms) else NO_PRISMS
    before = Placed(model.planes, table.heights_m, table.vertices_m, free.azimuth_edges_rad, free.layer_edges_m)
    after = Placed(*(np.empty(a.shape, np.float32) for a in before))
    if turn_all(before, motion, after) or count_non_finite(model.margin_m, free.free_from_m, free.free_to_m):
        return invalid_model(model, InvalidCause.NON_FINITE)
    cos, sin = motion.cos, motion.sin
    return FrameModel.from_trusted(
        valid=model.valid,
        cause=model.cause,
        planes=after.planes,
        support_px=model.support_px,
        margin_m=model.margin_m,
        flags=model.flags,
        cluster=model.cluster,
        prisms=table.moved(after.heights, after.vertices),
        free=FreeProfile.from_trusted(
            azimuth_edges_rad=after.azimuths,
            layer_edges_m=after.layers,
            free_from_m=free.free_from_m,
            free_to_m=free.free_to_m,
            end=free.end,
            open_from_dm=free.open_from_dm,
            open_to_dm=free.open_to_dm,
        ),
        ground=replace(
            ground,
            slope_x=cos * ground.slope_x - sin * ground.slope_y,
            slope_y=sin * ground.slope_x + cos * ground.slope_y,
        ),
        stats=model.stats,
        ke_per_m=model.ke_per_m,
    )


@inner
def turn_all(before, motion, after):
    """Computes `after` and returns the number of values that are not finite, before and after. before, after: Placed;
    motion: Motion."""
    _turn(before.planes, 0, motion, after.planes)
    _turn(before.planes, 2, motion, after.planes)
    _shift(before.planes, 4, motion.z_m, after.planes)
    _shift(before.heights, 0, motion.z_m, after.heights)
    _turn(before.vertices, 0, motion, after.vertices)
    for k in range(before.azimuths.shape[0]):
        after.azimuths[k] = float(before.azimuths[k]) + motion.yaw_rad
    for k in range(before.layers.shape[0]):
        after.layers[k] = float(before.layers[k]) + motion.z_m
    return _non_finite(before) + _non_finite(after)


@inner
def _non_finite(placed):
    count = _count_in_table(placed.planes) + _count_in_table(placed.heights) + _count_in_table(placed.vertices)
    return count + _count_in_row(placed.azimuths) + _count_in_row(placed.layers)


@inner
def count_non_finite(margin, free_from, free_to):
    """Returns the number of values that are not finite in an array (N,) and in two tables (D, L)."""
    return _count_in_row(margin) + _count_in_table(free_from) + _count_in_table(free_to)


@inner
def _count_in_table(table):
    """Returns the number of values that are not finite in a table (N, C)."""
    count = 0
    for k in range(table.shape[0]):
        for c in range(table.shape[1]):
            count += not math.isfinite(table[k, c])
    return count


@inner
def _count_in_row(row):
    count = 0
    for k in range(row.shape[0]):
        count += not math.isfinite(row[k])
    return count


@inner
def _turn(table, column, motion, out):
    """Rotates and shifts x and y, which are in `column` and the next one."""
    for k in range(table.shape[0]):
        x, y = float(table[k, column]), float(table[k, column + 1])
        out[k, column] = motion.cos * x - motion.sin * y + motion.x_m
        out[k, column + 1] = motion.sin * x + motion.cos * y + motion.y_m


@inner
def _shift(table, column, shift_z, out):
    """Shifts top and bottom, which are in `column` and the next one.

    Far from the origin of ned, rounding to float32 may make top and bottom equal. The plane then gets the least
    height instead of none."""
    for k in range(table.shape[0]):
        top, bottom = np.float32(table[k, column] + shift_z), np.float32(table[k, column + 1] + shift_z)
        least = np.nextafter(top, _INFINITY)
        out[k, column], out[k, column + 1] = top, max(bottom, least)

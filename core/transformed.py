"""A frame's model turned about the vertical and shifted, in float64, all of it at once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .invalid_model import invalid_model
from .jit import inner
from .stages.prism_table import NO_PRISMS, prism_table
from .types import FrameModel, FreeProfile, InvalidCause

_INFINITY = np.float32(np.inf)


def turned(model: FrameModel, yaw_rad: float, shift_m: tuple[float, float, float]) -> FrameModel:
    """The model turned clockwise from above by this angle, then shifted. Ranges and the ground's height stay counted from
    the camera; strips, which are drawn over the image, are left out.

    Where what it tells is not all finite, before or after, one comes out that says nothing (InvalidCause.NON_FINITE): such a
    plane stands nowhere, and one that cannot be compared with anything may hide all others."""
    cos, sin, (x, y, z) = math.cos(yaw_rad), math.sin(yaw_rad), shift_m
    free, ground = model.free, model.ground
    table = prism_table(model.prisms) if len(model.prisms) else NO_PRISMS
    planes, heights = np.empty((len(model.planes), 6), np.float32), np.empty((len(table), 2), np.float32)
    vertices = np.empty((len(table.vertices_m), 2), np.float32)
    edges, layers = np.empty(len(free.azimuth_edges_rad), np.float32), np.empty(len(free.layer_edges_m), np.float32)
    lacking = turn_all(
        model.planes, table.heights_m, table.vertices_m, free.azimuth_edges_rad, free.layer_edges_m, model.margin_m,
        free.free_from_m, free.free_to_m, cos, sin, float(yaw_rad), float(x), float(y), float(z), planes, heights, vertices,
        edges, layers,
    )  # fmt: skip
    if lacking:
        return invalid_model(model, InvalidCause.NON_FINITE)
    return FrameModel.written(
        valid=model.valid, cause=model.cause, planes=planes, support_px=model.support_px, margin_m=model.margin_m,
        flags=model.flags, cluster=model.cluster, prisms=table.moved(heights, vertices),
        free=FreeProfile.written(
            azimuth_edges_rad=edges, layer_edges_m=layers, free_from_m=free.free_from_m, free_to_m=free.free_to_m, end=free.end
        ),
        ground=replace(
            ground, slope_x=cos * ground.slope_x - sin * ground.slope_y, slope_y=sin * ground.slope_x + cos * ground.slope_y
        ),
        stats=model.stats, ke_per_m=model.ke_per_m,
    )  # fmt: skip


@inner
def turn_all(
    planes, heights, vertices, azimuths, layers, margin, free_from, free_to, cos, sin, yaw, x, y, z, to_planes, to_heights,
    to_vertices, to_azimuths, to_layers,
):  # fmt: skip
    """Writes the `to_` tables; returns how many numbers are not finite, of those before, those after, and those that stay."""
    lacking = _lacking(planes) + _lacking(heights) + _lacking(vertices) + _lacking(free_from) + _lacking(free_to)
    lacking += _lacking_of(azimuths) + _lacking_of(layers) + _lacking_of(margin)
    _turn(planes, 0, cos, sin, x, y, to_planes)
    _turn(planes, 2, cos, sin, x, y, to_planes)
    _shift(planes, 4, z, to_planes)
    _shift(heights, 0, z, to_heights)
    _turn(vertices, 0, cos, sin, x, y, to_vertices)
    for k in range(azimuths.shape[0]):
        to_azimuths[k] = float(azimuths[k]) + yaw
    for k in range(layers.shape[0]):
        to_layers[k] = float(layers[k]) + z
    lacking += _lacking(to_planes) + _lacking(to_heights) + _lacking(to_vertices)
    return lacking + _lacking_of(to_azimuths) + _lacking_of(to_layers)


@inner
def _lacking(table):
    """How many numbers of a table (N, C) are not finite."""
    count = 0
    for k in range(table.shape[0]):
        for c in range(table.shape[1]):
            count += not math.isfinite(table[k, c])
    return count


@inner
def _lacking_of(row):
    count = 0
    for k in range(row.shape[0]):
        count += not math.isfinite(row[k])
    return count


@inner
def _turn(table, column, cos, sin, shift_x, shift_y, out):
    """x and y, which stand in a column of the table and the one after it."""
    for k in range(table.shape[0]):
        x, y = float(table[k, column]), float(table[k, column + 1])
        out[k, column] = cos * x - sin * y + shift_x
        out[k, column + 1] = sin * x + cos * y + shift_y


@inner
def _shift(table, column, shift_z, out):
    """Top and bottom. Far from the origin of ned float32 may round a very low plane to nothing: it stays one."""
    for k in range(table.shape[0]):
        top, bottom = np.float32(table[k, column] + shift_z), np.float32(table[k, column + 1] + shift_z)
        least = np.nextafter(top, _INFINITY)
        out[k, column], out[k, column + 1] = top, max(bottom, least)

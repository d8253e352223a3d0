"""A frame's planes and prisms turned about the vertical and shifted, in float64, all at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernels import inner
from .prism_table import PrismTable

_INFINITY = np.float32(np.inf)


def turned_planes(
    planes_m: NDArray[np.float32], cos: float, sin: float, shift_m: tuple[float, float, float]
) -> NDArray[np.float32]:
    """(N, 6) float32 a_x, a_y, b_x, b_y, top, bottom, turned by the angle of this cosine and sine, then shifted."""
    out = np.empty((len(planes_m), 6), np.float32)
    _turn(planes_m, 0, cos, sin, shift_m[0], shift_m[1], out)
    _turn(planes_m, 2, cos, sin, shift_m[0], shift_m[1], out)
    _shift(planes_m, 4, shift_m[2], out)
    return out


def turned_prisms(table: PrismTable, cos: float, sin: float, shift_m: tuple[float, float, float]) -> PrismTable:
    """The same of prisms."""
    heights_m, vertices_m = np.empty((len(table), 2), np.float32), np.empty((len(table.vertices_m), 2), np.float32)
    _turn(table.vertices_m, 0, cos, sin, shift_m[0], shift_m[1], vertices_m)
    _shift(table.heights_m, 0, shift_m[2], heights_m)
    return table.moved(heights_m, vertices_m)


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

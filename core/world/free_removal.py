"""Free space of the merged world that an observed obstacle takes away: in its place, and behind it where it has arrived.

An obstacle in a place that was free has come there since, or the position has drifted. What was seen free behind it, from
where the camera is, may be inside of it: of a vehicle that stops in a street only the side in view is observed."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, kernel
from .free_grid import (
    CELL_M,
    EDGE_M,
    HALF_M,
    NO_BLOCK,
    TALL,
    bits,
    cell,
    cells_beside,
    clear_bits,
    column_of,
    find_block,
    free_bits,
)

_BODY_M = 20.0
"""Greatest depth of what arrives: the length of the longest vehicles on a road."""


@inner
def in_column(free, ix, iy, low, high, clear):
    """True if any of the cells low..high of a column is free. clear: they are not free any more."""
    c, found = column_of(ix, iy), False
    for iz in range(low >> 6, (high >> 6) + 1):
        k = find_block(free, ix >> 4, iy >> 4, iz)
        if k == NO_BLOCK:
            continue
        here = bits(low - iz * TALL, high + 1 - iz * TALL)
        found = found or free_bits(free, k, c) & here != 0
        if clear:
            clear_bits(free, k, c, here)
    return found


@inner
def stand_in(free, b, clear):
    """True if any cell that a plane, a record of OBSERVATION, crosses is free. clear: none of them is free any more."""
    ax, ay, bx, by = b.ax_m, b.ay_m, b.bx_m, b.by_m
    if bx < ax:
        ax, ay, bx, by = bx, by, ax, ay
    low, high, found = cell(b.top_m - EDGE_M), cell(b.bottom_m + EDGE_M), False
    for ix in range(cell(ax - EDGE_M), cell(bx + EDGE_M) + 1):
        first, last = cells_beside(ax, ay, bx, by, ix, CELL_M)
        for iy in range(first, last + 1):
            found = in_column(free, ix, iy, low, high, clear) or found
    return found


@inner
def clear_behind(free, x, y, b):
    """Clears the free cells up to _BODY_M behind a plane, a record of OBSERVATION, as seen from (x, y), at its heights."""
    ax, ay, bx, by = b.ax_m - x, b.ay_m - y, b.bx_m - x, b.by_m - y
    ra, rb = max(math.sqrt(ax * ax + ay * ay), EDGE_M), max(math.sqrt(bx * bx + by * by), EDGE_M)
    reach = max(ra, rb) + _BODY_M
    wide = 1.0 if ax * by - ay * bx >= 0.0 else -1.0
    low, high = cell(b.top_m - EDGE_M), cell(b.bottom_m + EDGE_M)
    first_x, last_x = x + min(ax, bx) - _BODY_M, x + max(ax, bx) + _BODY_M
    first_y, last_y = y + min(ay, by) - _BODY_M, y + max(ay, by) + _BODY_M
    for ix in range(cell(first_x), cell(last_x) + 1):
        for iy in range(cell(first_y), cell(last_y) + 1):
            cx, cy = (ix + 0.5) * CELL_M - x, (iy + 0.5) * CELL_M - y
            if cx * cx + cy * cy > reach * reach or (cx * ax + cy * ay <= 0.0 and cx * bx + cy * by <= 0.0):
                continue
            beside_a, beside_b = wide * (ax * cy - ay * cx) / ra, wide * (cx * by - cy * bx) / rb
            if beside_a < -HALF_M or beside_b < -HALF_M:
                continue
            beyond = wide * ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax))
            if beyond >= 0.0:
                in_column(free, ix, iy, low, high, True)


@kernel
def arrived_in_free(free, observations):
    """Returns (N,) bool, which of the observations, (N,) OBSERVATION, stand in a cell that was free before their frame."""
    out = np.zeros(observations.shape[0], np.bool_)
    for j in range(observations.shape[0]):
        out[j] = stand_in(free, observations[j], False)
    return out


@kernel
def remove_free(free, observations, arrived, x, y):
    """Clears the free cells where the observations of a frame are, and those behind the ones that have arrived.

    observations: (N,) OBSERVATION; arrived: (N,) bool, see `arrived_in_free`; x, y: place of the camera."""
    for j in range(observations.shape[0]):
        stand_in(free, observations[j], True)
        if arrived[j]:
            clear_behind(free, x, y, observations[j])

"""The ground of the merged world: for each column of cells, the height of its last measurement and its noise.

It is kept in the blocks of free space (free_grid.py): ground, (B, 256, 2) float32, is the z of the highest point of
the ground in the column and its noise in metres, nan if it is not known. It does not age. A newer measurement
replaces it, unless that agrees with it and has more noise. No cell below the ground stays free."""

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
    block_for,
    cell,
    cell_directions,
    clear_bits,
    column_of,
    find_block,
)


@inner
def clear_below(free, ix, iy, z):
    """Clears the free bits of a column at z and below, including the next block."""
    first, c = cell(z - EDGE_M), column_of(ix, iy)
    for iz in range(first >> 6, (first >> 6) + 2):
        k = find_block(free, ix >> 4, iy >> 4, iz)
        if k != NO_BLOCK:
            clear_bits(free, k, c, bits(first - iz * TALL, TALL))


@inner
def put_ground(free, ix, iy, z, noise):
    """Stores the ground of a column, unless the stored one agrees with it and has less noise; returns the z that is
    stored."""
    ground, c = free.ground, column_of(ix, iy)
    at = cell(z - EDGE_M) >> 6
    for iz in range(at - 1, at + 2):  # noise may move it across the border of two blocks
        k = find_block(free, ix >> 4, iy >> 4, iz)
        if k == NO_BLOCK or math.isnan(ground[k, c, 0]):
            continue
        apart, slack = abs(ground[k, c, 0] - z), ground[k, c, 1] + noise
        if apart <= slack and ground[k, c, 1] < noise:
            return np.float64(ground[k, c, 0])
        if iz != at and apart <= slack + CELL_M:
            ground[k, c, 0] = ground[k, c, 1] = np.nan
            free.blocks[k].touched = free.state[0].frame
    k = block_for(free, ix >> 4, iy >> 4, at)
    ground[k, c, 0], ground[k, c, 1] = z, noise
    return np.float64(ground[k, c, 0])


@inner
def measured_at(x, y, edges, seen_from, seen_to):
    """True if the ground was measured in all directions that a cell at (x, y) from the camera extends into, at its
    range."""
    r = math.sqrt(x * x + y * y)
    d0, d1 = cell_directions(edges, x, y, r)
    for d in range(d0, d1 + 1):
        if seen_from[d] > r - HALF_M or seen_to[d] < r + HALF_M:
            return False
    return d1 >= d0


@kernel
def see_ground(free, view, seen_from, seen_to):
    """Stores the ground that a frame measured, and clears the free bits at and below it.

    seen_from, seen_to: (D,) float64 ranges at which the ground was measured."""
    x, y, edges = view.x_m, view.y_m, view.edges_rad
    z, slope_x, slope_y, noise = view.ground_z_m, view.slope_x, view.slope_y, view.noise_per_m
    reach = seen_to.max()
    lift = math.sqrt(slope_x**2 + slope_y**2) * HALF_M
    for ix in range(cell(x - reach), cell(x + reach) + 1):
        for iy in range(cell(y - reach), cell(y + reach) + 1):
            cx, cy = (ix + 0.5) * CELL_M - x, (iy + 0.5) * CELL_M - y
            r2 = cx * cx + cy * cy
            if r2 > reach * reach or not measured_at(cx, cy, edges, seen_from, seen_to):
                continue
            highest = z + slope_x * cx + slope_y * cy - lift
            clear_below(free, ix, iy, put_ground(free, ix, iy, highest, noise * (math.sqrt(r2) + HALF_M)))

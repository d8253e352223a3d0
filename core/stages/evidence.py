"""What a joined plane may cover: cells of the view that hold no evidence, and how large a hole among them may be.

Evidence is the nearest strip in each cell of the levelled view. At a distance x a cell is blocked when something stands
there nearer than x or a little behind it; what is not blocked was seen to be open or never seen at all.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner, inner_inline
from .openings import is_open
from .strips import BOTTOM, SUPPORT, TOP, D, U

# columns of the frame of the grid: cells per unit of tangent across and down; cell of tangent 0, both ways
G_ACROSS, G_DOWN, G_CU, G_CV = range(4)
_NOBODY_LOOKED = 1e6
"""Not tuning: nearer than anything, in 1/x."""


@inner
def mark_nearest(ints, floats, n, f, cell, grid):
    """grid (C, R) float32 out: 1/x of the nearest strip that crosses each cell, 0 where there is none."""
    grid[:] = 0.0
    for k in range(n):
        if ints[k, SUPPORT] <= 0:
            continue
        s = floats[k, D] / f
        i = ints[k, U] // cell
        for j in range(ints[k, TOP] // cell, ints[k, BOTTOM] // cell + 1):
            if s > grid[i, j]:
                grid[i, j] = s


@inner
def mark_outside(H, width, height, cell, grid):
    """Blocks the cells of grid whose centres lie outside the source image: nobody looked there, so nothing is empty."""
    cols, rows = grid.shape
    for i in range(cols):
        u = (i + 0.5) * cell - 0.5
        for j in range(rows):
            v = (j + 0.5) * cell - 0.5
            w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
            x, y = H[0, 0] * u + H[0, 1] * v + H[0, 2], H[1, 0] * u + H[1, 1] * v + H[1, 2]
            if w <= 0.0 or x < -0.5 * w or x > (width - 0.5) * w or y < -0.5 * w or y > (height - 0.5) * w:
                grid[i, j] = _NOBODY_LOOKED


@inner
def nearest_seen(ints, floats, n, f, cu, cv, column_px, H, width, height, cell, grid, frame):
    """Fills grid (ceil(cols / cell), ceil(rows / cell)) float32 and its frame (4,) float64 by the G_ indices.

    f, cu, cv, column_px, H: of the view, whose columns are column_px of its pixels wide; width, height: of the source: cells
    that look past it are blocked at any distance."""
    mark_nearest(ints, floats, n, f, cell, grid)
    mark_outside(H, width, height, cell, grid)
    frame[G_ACROSS], frame[G_DOWN] = f / np.float64(column_px) / cell, f / cell
    frame[G_CU], frame[G_CV] = (cu + 0.5) / cell, (cv + 0.5) / cell


@inner
def first_cell(value):
    """Index of the first cell whose centre is not before `value`, in cells."""
    return int(math.ceil(value - 0.5))


@inner_inline
def uncovered_share(t0, t1, z0, z1, a, b, p, q, behind_m, noise_s, gap_m, slack_m, grid, frame, masks, mask_frame, run):
    """Share of a joined rectangle's cells that are not blocked, 2 where it must not be at all.

    It must not be where a square of gap_m a side inside it is empty, or where it takes in an open cell (openings.py)
    that lies more than slack_m inside its border and in neither of the two rectangles p and q: (4,) t0, t1 and
    top, bottom as metres at the joined line s = a + b*t. A cell is blocked by what lies less than behind_m and
    noise_s (of 1/x) behind the line. run: (R + 2,) int32 scratch."""
    i0 = max(0, first_cell(t0 * frame[G_ACROSS] + frame[G_CU]))
    i1 = min(grid.shape[0], first_cell(t1 * frame[G_ACROSS] + frame[G_CU]))
    run[:] = 0
    cells, empty = 0, 0
    for i in range(i0, i1):
        t = (i + 0.5 - frame[G_CU]) / frame[G_ACROSS]
        s = a + b * t
        down = frame[G_DOWN] * s
        j0 = min(max(0, first_cell(z0 * down + frame[G_CV])), grid.shape[1])
        j1 = max(j0, min(grid.shape[1], first_cell(z1 * down + frame[G_CV])))
        limit = s / (1.0 + behind_m * s) - noise_s
        longest = gap_m * min(frame[G_ACROSS], frame[G_DOWN]) * s
        slack = slack_m * down
        corner = run[j0]
        run[j0] = 0
        for j in range(j0, j1):
            above = corner
            corner = run[j + 1]
            if grid[i, j] >= limit:
                run[j + 1] = 0
                continue
            empty += 1
            side = 1 + min(above, min(corner, run[j]))
            run[j + 1] = side
            if side > longest:
                return 2.0
            if slack < j + 0.5 - j0 and slack < j1 - j - 0.5 and slack < i + 0.5 - i0 and slack < i1 - i - 0.5:
                m = (j + 0.5 - frame[G_CV]) / frame[G_DOWN]
                if _inside(p, t, m / s) or _inside(q, t, m / s):
                    continue
                if is_open(masks, t, m, 1.0 / s, mask_frame):
                    return 2.0
        run[j1 + 1 :] = 0
        cells += max(0, j1 - j0)
    return empty / max(cells, 1)


@inner
def _inside(r, t, z):
    return r[0] <= t <= r[1] and r[2] <= z <= r[3]

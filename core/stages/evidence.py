"""What a joined plane may cover: cells of the view that hold no evidence, and how large a hole among them may be.

Evidence is the nearest strip in each cell of the levelled view. At a distance x a cell is blocked when something stands
there nearer than x or a little behind it; what is not blocked was seen to be open or never seen at all.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit import inner, inner_inline
from .openings import is_open


class Evidence(NamedTuple):
    """The nearest strip in each cell of the levelled view: nearest (C, R) float32, 1/x, 0: none; across, down: cells per unit
    of tangent; cu, cv: cell of the optical axis of the view."""

    nearest: Any
    across: Any
    down: Any
    cu: Any
    cv: Any


class Rectangle(NamedTuple):
    """Part of a plane: tangents of azimuth t0, t1, heights top_m, bottom_m."""

    t0: Any
    t1: Any
    top_m: Any
    bottom_m: Any


_OUTSIDE = 1e6
"""Stands for a cell outside the source image: nearer than anything, in 1/x."""


@inner
def mark_nearest(strips, n, f, cell, grid):
    """grid (C, R) float32 out: 1/x of the nearest strip that crosses each cell, 0 where there is none."""
    grid[:] = 0.0
    for k in range(n):
        strip = strips[k]
        if strip.support <= 0:
            continue
        s = strip.disparity_px / f
        i = strip.column // cell
        for j in range(strip.top_row // cell, strip.bottom_row // cell + 1):
            if s > grid[i, j]:
                grid[i, j] = s


@inner
def mark_outside(H, width, height, cell, grid):
    """Blocks the cells of grid whose centres lie outside the source image: nothing was measured there, so nothing is empty."""
    cols, rows = grid.shape
    for i in range(cols):
        u = (i + 0.5) * cell - 0.5
        for j in range(rows):
            v = (j + 0.5) * cell - 0.5
            w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
            x, y = H[0, 0] * u + H[0, 1] * v + H[0, 2], H[1, 0] * u + H[1, 1] * v + H[1, 2]
            if w <= 0.0 or x < -0.5 * w or x > (width - 0.5) * w or y < -0.5 * w or y > (height - 0.5) * w:
                grid[i, j] = _OUTSIDE


@inner
def find_evidence(strips, n, view, image, cell, grid):
    """Evidence of the first n of strips (N,) STRIP, in grid (ceil(cols / cell), ceil(rows / cell)) float32.

    image: a record of SOURCE: cells that look past the source image are blocked at any distance."""
    mark_nearest(strips, n, view.f_px, cell, grid)
    mark_outside(view.H, image.width_px, image.height_px, cell, grid)


@inner
def first_cell(value):
    """Index of the first cell whose centre is not before `value`, in cells."""
    return int(math.ceil(value - 0.5))


@inner_inline
def uncovered_share(joined, a, b, p, q, rules, evidence, openings, run):
    """Share of a joined rectangle's cells that are not blocked, 2 where it must not be at all.

    joined: Rectangle on the line s = a + b*t. It must not be where a square of gap_m a side inside it is empty, or where it
    takes in an open cell (openings.py) that lies more than slack_m inside its border and in neither of the two rectangles
    p and q, whose heights are metres at the joined line. A cell is blocked by what lies less than behind_m and `sigmas` of
    noise (of 1/x) behind the line. rules: a record of MERGE_RULES. run: (R + 2,) int32 scratch."""
    grid, noise_s = evidence.nearest, rules.sigmas * rules.sigma_s
    i0 = max(0, first_cell(joined.t0 * evidence.across + evidence.cu))
    i1 = min(grid.shape[0], first_cell(joined.t1 * evidence.across + evidence.cu))
    run[:] = 0
    cells, empty = 0, 0
    for i in range(i0, i1):
        t = (i + 0.5 - evidence.cu) / evidence.across
        s = a + b * t
        down = evidence.down * s
        j0 = min(max(0, first_cell(joined.top_m * down + evidence.cv)), grid.shape[1])
        j1 = max(j0, min(grid.shape[1], first_cell(joined.bottom_m * down + evidence.cv)))
        limit = s / (1.0 + rules.behind_m * s) - noise_s
        longest = rules.gap_m * min(evidence.across, evidence.down) * s
        slack = rules.slack_m * down
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
                m = (j + 0.5 - evidence.cv) / evidence.down
                if _inside(p, t, m / s) or _inside(q, t, m / s):
                    continue
                if is_open(openings, t, m, 1.0 / s):
                    return 2.0
        run[j1 + 1 :] = 0
        cells += max(0, j1 - j0)
    return empty / max(cells, 1)


@inner
def _inside(rectangle, t, z):
    return rectangle.t0 <= t <= rectangle.t1 and rectangle.top_m <= z <= rectangle.bottom_m

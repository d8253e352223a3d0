"""Evidence for a merged plane: which cells of the view it may cover, and how large an empty area in it may be.

Input: the table of strips. Output: the nearest strip in each cell of the levelled view. At a distance x a cell is
blocked if a strip is nearer than x or a little behind it. All other cells were observed to be open, or were not
measured. Not in the paper, whose merge does not test what it covers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, kernel
from .line_fit import LINE_SIGMAS
from .openings import is_open
from .strips import SMOOTH


class Evidence(NamedTuple):
    """The nearest strip in each cell of the levelled view."""

    nearest: Any  # (C, R) float32, 1/x in 1/m; 0: no strip
    across: Any  # columns of cells per unit of tangent of azimuth
    down: Any  # rows of cells per unit of tangent of elevation
    cu: Any  # column of the optical axis of the view, in cells
    cv: Any  # row of the optical axis of the view, in cells


class Rectangle(NamedTuple):
    """A rectangle on a plane."""

    t0: Any  # t0, t1: tangents of azimuth
    t1: Any
    top_m: Any  # top_m, bottom_m: heights
    bottom_m: Any


class Cover(NamedTuple):
    """What `uncovered_share` reads about the space that a rectangle covers."""

    evidence: Any  # Evidence
    openings: Any  # OpeningMasks
    run: NDArray[np.int32]  # (2, R + 2) int32 scratch


CELL_PX = 8
"""Side of the cells in which evidence is counted, in columns and rows of the view."""
_ROUGH_M = 0.2
"""A strip that is not smooth is evidence as if it were nearer by this: its pixels, as those of leaves, are scattered."""
_TALL_GAPS = 3.0
"""An area wider than half of gap_m, behind all of which strips were measured, is at most this many times gap_m high."""
_OUTSIDE = 1e6
"""1/x of a cell outside of the source image, greater than that of any obstacle."""


@inner
def mark_nearest(strips, n, f, grid):
    """Computes 1/x of the nearest strip that crosses each cell, nearer by _ROUGH_M if it is not smooth: grid, (C, R)
    float32 out, 0 where there is none."""
    grid[:] = 0.0
    for k in range(n):
        strip = strips[k]
        if strip.support <= 0:
            continue
        s = strip.disparity_px / f
        if strip.kind != SMOOTH:
            s /= max(1.0 - _ROUGH_M * s, 0.1)
        i = strip.column // CELL_PX
        for j in range(strip.top_row // CELL_PX, strip.bottom_row // CELL_PX + 1):
            if s > grid[i, j]:
                grid[i, j] = s


@inner
def mark_outside(H, width, height, grid):
    """Blocks the cells of grid whose centres lie outside of the source image: they were not measured, so they are not
    empty."""
    cols, rows = grid.shape
    for i in range(cols):
        u = (i + 0.5) * CELL_PX - 0.5
        for j in range(rows):
            v = (j + 0.5) * CELL_PX - 0.5
            w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
            x, y = H[0, 0] * u + H[0, 1] * v + H[0, 2], H[1, 0] * u + H[1, 1] * v + H[1, 2]
            if w <= 0.0 or x < -0.5 * w or x > (width - 0.5) * w or y < -0.5 * w or y > (height - 0.5) * w:
                grid[i, j] = _OUTSIDE


@kernel
def find_evidence(strips, n, view, image):
    """Returns the Evidence of a view."""
    cell = CELL_PX
    grid = np.empty(((view.cols + cell - 1) // cell, (view.rows + cell - 1) // cell), np.float32)
    mark_nearest(strips, n, view.f_px, grid)
    mark_outside(view.H, image.width_px, image.height_px, grid)
    across = view.f_px / np.float64(view.lateral[0]) / cell
    return Evidence(grid, across, view.f_px / cell, (view.cu + 0.5) / cell, (view.cv + 0.5) / cell)


@inner
def farthest_evidence(s, settings):
    """Returns the least 1/x of a strip that is evidence for a plane at 1/x = s: less than merge_distance_m, and
    LINE_SIGMAS of noise of 1/x, behind it, as a strip of a merged plane may be."""
    return s / (1.0 + settings.merge_distance_m * s) - (LINE_SIGMAS * settings.sigma_s + settings.smear_s)


@inner
def is_measured_behind(plane, t0, t1, settings, evidence):
    """True if a cell whose centre lies on a plane from tangent t0 to t1 has strips, all of them farther than
    `farthest_evidence`."""
    grid = evidence.nearest
    i0 = max(0, first_cell(t0 * evidence.across + evidence.cu))
    i1 = min(grid.shape[0], first_cell(t1 * evidence.across + evidence.cu))
    for i in range(i0, i1):
        s = plane.a + plane.b * (i + 0.5 - evidence.cu) / evidence.across
        down, limit = evidence.down * s, farthest_evidence(s, settings)
        j0 = max(0, first_cell(plane.top_m * down + evidence.cv))
        for j in range(j0, min(grid.shape[1], first_cell(plane.bottom_m * down + evidence.cv))):
            if 0.0 < grid[i, j] < limit:
                return True
    return False


@inner
def first_cell(value):
    """Returns the index of the first cell whose centre is at or after `value`, in cells."""
    return int(math.ceil(value - 0.5))


@inner_inline
def uncovered_share(joined, a, b, p, q, settings, cover):
    """Returns the share of the cells of a joined rectangle that are not blocked; 2 if it must not be made.

    It must not be made if it contains an empty square with a side of gap_m, an empty area of half that width and
    _TALL_GAPS times that height behind all of which strips were measured, or an open cell (openings.py) that lies more than
    opening_slack_m inside its border and in neither p nor q. A cell is blocked by a strip that is not behind
    `farthest_evidence`.

    Args:
        joined: Rectangle on the line.
        a, b: line s = a + b t.
        p, q: Rectangles of the two planes, with heights at the joined line."""
    evidence, run, beside = cover.evidence, cover.run[0], cover.run[1]
    grid = evidence.nearest
    i0 = max(0, first_cell(joined.t0 * evidence.across + evidence.cu))
    i1 = min(grid.shape[0], first_cell(joined.t1 * evidence.across + evidence.cu))
    cover.run[:] = 0
    cells, empty = 0, 0
    for i in range(i0, i1):
        t = (i + 0.5 - evidence.cu) / evidence.across
        s = a + b * t
        down = evidence.down * s
        j0 = min(max(0, first_cell(joined.top_m * down + evidence.cv)), grid.shape[1])
        j1 = max(j0, min(grid.shape[1], first_cell(joined.bottom_m * down + evidence.cv)))
        limit = farthest_evidence(s, settings)
        longest = settings.gap_m * min(evidence.across, evidence.down) * s
        slack = settings.opening_slack_m * down
        tall = 0  # rows up to this one whose cells, to the left over half of gap_m, have a strip behind the line
        corner = run[j0]
        run[j0] = 0
        for j in range(j0, j1):
            above = corner
            corner = run[j + 1]
            if grid[i, j] >= limit:
                run[j + 1] = beside[j] = tall = 0
                continue
            empty += 1
            side = 1 + min(above, min(corner, run[j]))
            run[j + 1] = side
            beside[j] = beside[j] + 1 if grid[i, j] > 0.0 else 0
            tall = tall + 1 if 2 * beside[j] > longest else 0
            if side > longest or tall > _TALL_GAPS * longest:
                return 2.0
            if slack < j + 0.5 - j0 and slack < j1 - j - 0.5 and slack < i + 0.5 - i0 and slack < i1 - i - 0.5:
                m = (j + 0.5 - evidence.cv) / evidence.down
                if _inside(p, t, m / s) or _inside(q, t, m / s):
                    continue
                if is_open(cover.openings, t, m, 1.0 / s):
                    return 2.0
        run[j1 + 1 :] = 0
        cells += max(0, j1 - j0)
    return empty / max(cells, 1)


@inner
def _inside(rectangle, t, z):
    """True if a rectangle contains the point at tangent t and height z."""
    return rectangle.t0 <= t <= rectangle.t1 and rectangle.top_m <= z <= rectangle.bottom_m

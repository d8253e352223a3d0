"""Openings: space through which the vehicle could fly, which no later stage may cover (extends Section 5.1).

Input: the levelled view and the table of strips. Output: one mask of cells per distance. A cell is open at distance x
if it belongs to a box of Ws by Hs, all cells of which were observed to be free to beyond x + Ws. A niche that is
shallower than the vehicle is wide is therefore no opening. Merge and filling may cover space close to obstacles, but
no open cell."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import inner, inner_inline, kernel
from .view_geometry import Q_UNKNOWN, ViewGeometry

CELL_PX = 4
"""Side of a cell in columns and rows of the view."""
_FIRST_M, _RATIO = 0.5, 1.42
"""First of the distances of the masks, and the ratio of each to the one before."""
_UNKNOWN_SHARE = 0.2
"""Greatest share of unknown cells in a free box."""
_BEHIND_M = 0.5
"""Least depth that must be seen free behind an opening where Ws would reach beyond the maximum range."""


class OpeningMasks(NamedTuple):
    """Open cells of the view for L distances."""

    masks: NDArray[np.uint8]  # (L, C, R), 1: open
    steps_m: NDArray[np.float64]  # (L - 1,), distances at which the next layer begins
    across: float  # columns of cells per unit of tangent of azimuth
    down: float  # rows of cells per unit of tangent of elevation
    cu: float  # column of the optical axis of the view, in cells
    cv: float  # row of the optical axis of the view, in cells


ROUNDING = 1e-9
"""Tolerance in cells: a box that is a whole number of cells wide, except for rounding, gets no additional cell."""


@inner_inline
def second_nearest(a, b, c, d):
    """Returns the second largest of four codes; 0 if two or more of them are unknown. Q_UNKNOWN is the least code."""
    one, other = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))  # the two in the middle
    return max(one, other) if min(one, other) != Q_UNKNOWN else np.uint16(0)


@inner
def nearest_codes(codes, strips, n, lsb_per_px, boxes, nearest):
    """Computes the code of the nearest obstacle in each cell; 0 if half of its corners or more are unknown.

    It is the second nearest of the four corners of the cell, which a mismatch of two by two pixels cannot be, or the
    nearest strip that crosses the cell, so that thin objects count.

    Args:
        lsb_per_px: of the view.
        boxes: (rows,) uint16 scratch, the second nearest corner for a cell that begins at each row.
        nearest: (C, R) uint16 out."""
    cols, rows = codes.shape
    whole = rows // CELL_PX
    for i in range(nearest.shape[0]):
        left, right, line = codes[i * CELL_PX], codes[min(cols, (i + 1) * CELL_PX) - 1], nearest[i]
        low_left, low_right = left[CELL_PX - 1 :], right[CELL_PX - 1 :]
        for v in range(low_left.shape[0]):
            boxes[v] = second_nearest(left[v], right[v], low_left[v], low_right[v])
        for j in range(whole):
            line[j] = boxes[j * CELL_PX]
        if whole < line.shape[0]:  # the last cell has fewer rows
            v = whole * CELL_PX
            line[whole] = second_nearest(left[v], right[v], left[rows - 1], right[rows - 1])
    for k in range(n):
        s = strips[k]
        if s.support > 0:
            code = np.uint16(min(np.float32(65535.0), s.disparity_px * lsb_per_px))
            crossed = nearest[s.column // CELL_PX, s.top_row // CELL_PX : s.bottom_row // CELL_PX + 1]
            for j in range(len(crossed)):
                crossed[j] = max(crossed[j], code)


@inner
def count_unknown(nearest, total):
    """Computes total[i, j], the number of unknown cells in the first i columns and j rows. total: (C + 1, R + 1)
    int32 out."""
    total[0] = 0
    for i in range(nearest.shape[0]):
        line, before, after = nearest[i], total[i], total[i + 1]
        run = 0
        after[0] = 0
        for j in range(line.shape[0]):
            run += line[j] == 0
            after[j + 1] = before[j + 1] + run


class Box(NamedTuple):
    """What makes a box of cells free."""

    wide: Any  # wide, high: its size in cells
    high: Any
    limit: Any  # least code that blocks it
    most_unknown: Any  # int32, greatest number of unknown cells


@kernel
def any_ahead(cells, other, length, step):
    """Tests for each cell if any of `length` cells from it on, `step` apart, is set; returns (result, the other array).

    Windows of doubling length are combined. cells, other: flat uint8, both overwritten. Nothing is set beyond their
    end."""
    reach = 1
    while reach < length:
        more = min(reach, length - reach)
        ahead = cells[more * step :]
        for k in range(len(ahead)):
            other[k] = cells[k] | ahead[k]
        other[len(ahead) :] = cells[len(ahead) :]
        cells, other = other, cells
        reach += more
    return cells, other


@kernel
def any_in_box(cells, other, box, rows):
    """Tests for each cell if any cell of the box that begins with it is set; otherwise like `any_ahead`.

    A box that crosses the end of its column continues with the next one. rows: cells of a column."""
    cells, other = any_ahead(cells, other, box.high, 1)
    return any_ahead(cells, other, box.wide, rows)


@kernel
def open_mask(nearest, box, total, spare, mask):
    """Sets mask[i, j] to 1 where a free box contains the cell, else to 0.

    Args:
        nearest: (C, R) uint16 of `nearest_codes`.
        total: (C + 1, R + 1) int32 of `count_unknown`.
        spare: (2, C * R) uint8 scratch.
        mask: (C, R) uint8 out."""
    (cols, rows), codes, (wide, high) = nearest.shape, nearest.reshape(-1), (box.wide, box.high)
    if wide > cols or high > rows:
        mask[:] = 0
        return
    cells = spare[0]
    for k in range(len(codes)):
        cells[k] = codes[k] >= box.limit
    blocked, free = any_in_box(cells, spare[1], box, rows)
    free[:] = 0
    # a free box is marked at its last cell, so that the boxes which contain a cell are marked ahead of it
    first_cells, last_cells = blocked.reshape(cols, rows), free.reshape(cols, rows)
    for i in range(cols - wide + 1):
        first, last = first_cells[i], last_cells[i + wide - 1, high - 1 :]
        a, b, c, d = total[i], total[i, high:], total[i + wide], total[i + wide, high:]
        for j in range(len(last)):
            last[j] = (first[j] == 0) & (np.int32(d[j] - b[j] - c[j] + a[j]) <= box.most_unknown)
    if free.max() > 0:  # mostly there is no free box; unlike any(), vectorised
        free, _ = any_in_box(free, blocked, box, rows)
    mask.reshape(-1)[:] = free


@inner
def is_open(openings, t, m, x):
    """True if the ray with the tangents (t, m) of azimuth and elevation is open at distance x. openings:
    OpeningMasks."""
    masks = openings.masks
    i = int(math.floor(t * openings.across + openings.cu))
    j = int(math.floor(m * openings.down + openings.cv))
    if i < 0 or j < 0 or i >= masks.shape[1] or j >= masks.shape[2]:
        return False
    return masks[layer_of(x, openings.steps_m), i, j] == 1


@inner
def cell_of(tan, per_tan, centre, cells):
    """Returns the column or row of the cell of a tangent; the nearest one if the tangent is outside of the view."""
    return min(max(int(math.floor(tan * per_tan + centre)), 0), cells - 1)


@inner
def layer_of(x, steps_m):
    """Returns the index of the mask for distance x."""
    layer = 0
    for k in range(steps_m.shape[0]):
        if x < steps_m[k]:
            break
        layer += 1
    return layer


@kernel
def open_masks(codes, strips, n, view, passable, max_range_m, masks):
    """Computes `open_mask` at the distances _FIRST_M * _RATIO^k.

    passable: (Ws, Hs) in m; masks: of OpeningMasks, out."""
    (ws, hs), f, step = passable, view.f_px, np.float64(view.lateral[0])
    across, down = masks.shape[1], masks.shape[2]
    nearest, total = np.empty((across, down), np.uint16), np.empty((across + 1, down + 1), np.int32)
    nearest_codes(codes, strips, n, view.lsb_per_px, np.empty(codes.shape[1], np.uint16), nearest)
    count_unknown(nearest, total)
    spare = np.empty((2, across * down), np.uint8)
    for k in range(masks.shape[0]):
        x = _FIRST_M * _RATIO**k
        beyond = min(x + ws, max(max_range_m, x + _BEHIND_M))
        wide = max(1, math.ceil(ws * f / (x * step * CELL_PX) - ROUNDING))
        high = max(1, math.ceil(hs * f / (x * CELL_PX) - ROUNDING))
        limit = max(int(f * view.lsb_per_px / beyond), 2)
        box = Box(wide, high, limit, np.int32(_UNKNOWN_SHARE * (wide * high)))
        open_mask(nearest, box, total, spare, masks[k])


def find_openings(
    codes: NDArray[np.uint16],
    strips: NDArray[Any],
    n: int,
    view: ViewGeometry,
    max_range_m: float,
    passable: tuple[float, float],
    buffers: Buffers,
) -> OpeningMasks:
    """Returns the openings of a frame, one mask per distance up to the maximum range. The masks lie in `buffers`.

    passable: (Ws, Hs) in m."""
    shape = -(-view.cols // CELL_PX), -(-view.rows // CELL_PX)
    layers = 1 + max(0, round(math.log(max_range_m / _FIRST_M) / math.log(_RATIO)))
    masks = buffers("opening_masks", (layers, *shape), np.uint8)
    open_masks(codes, strips, n, view, passable, max_range_m, masks)
    steps_m = np.array([_FIRST_M * _RATIO ** (k + 0.5) for k in range(layers - 1)])
    f_px, column_px = view.f_px, float(view.lateral[0])
    across, down = f_px / column_px / CELL_PX, f_px / CELL_PX
    return OpeningMasks(masks, steps_m, across, down, (view.cu + 0.5) / CELL_PX, (view.cv + 0.5) / CELL_PX)

"""Section 5.1's rule for every later stage: what the vehicle could fly through is never covered.

At a distance x a cell is open when it belongs to a box of Ws by Hs of cells that were all seen to be free to beyond
x + Ws. Merging and filling may cover what lies close to evidence, but no open cell.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..jit import inner, inner_inline, kernel, record
from .view_geometry import Q_UNKNOWN, ViewGeometry

OPENING_SETTINGS = record(
    ("opening_cell_px", np.int64),
    ("opening_first_m", np.float64),
    ("opening_ratio", np.float64),
    ("opening_behind_m", np.float64),
    ("opening_unknown_share", np.float64),
    ("passable_width_m", np.float64),
    ("passable_height_m", np.float64),
)
"""The parameters of the same names."""


class OpeningMasks(NamedTuple):
    """Where the vehicle could fly through, for each of L distances.

    masks: (L, C, R) uint8, 1: open; steps_m: (L - 1,) float64, distances at which the next layer begins; across, down: cells
    per unit of tangent; cu, cv: cell of the optical axis of the view."""

    masks: NDArray[np.uint8]
    steps_m: NDArray[np.float64]
    across: float
    down: float
    cu: float
    cv: float


ROUNDING = 1e-9
"""Cells: a box that fills a whole number of them but for the last digit of a float is not made one wider."""


@inner_inline
def second_nearest(a, b, c, d):
    """The second largest of four codes; 0 where two or more of them are unknown, which is the least code."""
    one, other = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))  # the two in the middle
    return max(one, other) if min(one, other) != Q_UNKNOWN else np.uint16(0)


@inner
def nearest_codes(codes, cell, strips, n, lsb_per_px, boxes, nearest):
    """The nearest thing in each cell as a code; 0 where half of it or more is unknown.

    codes: (cols, rows) uint16. nearest: (C, R) uint16 out: the second nearest of the cell's four corners, which a
    mismatch of two by two pixels cannot be, or the nearest strip that crosses the cell: thin things are strips.
    boxes: (rows,) uint16 scratch: the same for a cell that begins at any row, many of which are done at a time."""
    cols, rows = codes.shape
    side, whole = np.uint32(cell), rows // cell
    for i in range(nearest.shape[0]):
        left, right, line = codes[i * cell], codes[min(cols, (i + 1) * cell) - 1], nearest[i]
        low_left, low_right = left[cell - 1 :], right[cell - 1 :]
        for v in range(low_left.shape[0]):
            boxes[v] = second_nearest(left[v], right[v], low_left[v], low_right[v])
        at = np.uint64(0)
        for j in range(whole):
            line[j] = boxes[at]
            at += np.uint64(cell)
        if whole < line.shape[0]:  # a last cell that is not as high
            v = whole * cell
            line[whole] = second_nearest(left[v], right[v], left[rows - 1], right[rows - 1])
    for k in range(n):
        s = strips[k]
        if s.support > 0:
            code = np.uint16(min(np.float32(65535.0), s.disparity_px * lsb_per_px))
            across = np.uint32(s.column) // side
            first, last = np.uint32(s.top_row) // side, np.uint32(s.bottom_row) // side
            for j in range(np.uint64(first), np.uint64(last) + np.uint64(1)):
                nearest[across, j] = max(nearest[across, j], code)


@inner
def count_unknown(nearest, total):
    """total[i, j]: unknown cells among the first i columns and j rows. total: (C + 1, R + 1) int32 out."""
    total[0] = 0
    for i in range(nearest.shape[0]):
        line, before, after = nearest[i], total[i], total[i + 1]
        run = 0
        after[0] = 0
        for j in range(line.shape[0]):
            run += line[j] == 0
            after[j + 1] = before[j + 1] + run


@kernel
def any_ahead(cells, other, length):
    """Whether any of `length` cells from each one on is set; returns (result, the spare array), both overwritten.

    cells, other: flat uint8. By windows of twice the width at a time. Where a window reaches past the end of its column,
    the result means nothing."""
    width = 1
    for _ in range(32):
        if width >= length:
            break
        more = min(width, length - width)
        ahead = cells[more:]
        for k in range(ahead.shape[0]):
            other[k] = cells[k] | ahead[k]
        cells, other = other, cells
        width += more
    return cells, other


@kernel
def any_behind(cells, other, length):
    """Whether any of the `length` cells up to each one is set; otherwise as `any_ahead`."""
    width = 1
    for _ in range(32):
        if width >= length:
            break
        more = min(width, length - width)
        other[:more] = cells[:more]
        here, out = cells[more:], other[more:]
        for k in range(here.shape[0]):
            out[k] = here[k] | cells[k]
        cells, other = other, cells
        width += more
    return cells, other


@kernel
def open_mask(nearest, limit, wide, high, unknown_share, total, spare, column, mask):
    """mask[i, j] = 1 where a free box of wide x high cells covers the cell.

    A box is free when no cell's code reaches limit and at most unknown_share of its cells is unknown (dropped pixels).
    nearest: (C, R) uint16; total: see count_unknown; mask: (C, R) uint8 out. Scratch: spare (2, C * R) uint8,
    column (R,) uint16. Down the columns by doubled windows, across them by sums that slide along."""
    cols, rows = nearest.shape
    mask[:] = 0
    if wide > cols or high > rows:
        return
    cells, codes = spare[0], nearest.reshape(-1)
    for k in range(codes.shape[0]):
        cells[k] = codes[k] >= limit
    flat, other = any_ahead(cells, spare[1], high)
    blocked, boxes = flat.reshape(cols, rows), other.reshape(cols, rows)
    allowed = np.int32(unknown_share * (wide * high))
    found, places = np.uint8(0), rows - high + 1
    other[:] = 0
    column[:] = 0
    for i in range(wide - 1):
        line = blocked[i]
        for j in range(places):
            column[j] += line[j]
    for i in range(cols - wide + 1):
        come, gone, free = blocked[i + wide - 1], blocked[i], boxes[i]
        a, b, c, d = total[i], total[i, high:], total[i + wide], total[i + wide, high:]
        for j in range(places):
            here = np.uint16(column[j] + come[j])
            passes = np.uint8((here == 0) & (np.int32(d[j] - b[j] - c[j] + a[j]) <= allowed))
            free[j] = passes
            found |= passes
            column[j] = here - gone[j]
    if found == 0:
        return
    covered = any_behind(other, flat, high)[0].reshape(cols, rows)
    column[:] = 0
    for i in range(wide - 1):
        line, out = covered[i], mask[i]
        for j in range(rows):
            column[j] += line[j]
            out[j] = column[j] > 0
    for i in range(cols - wide + 1):
        come, gone, out = covered[i + wide - 1], covered[i], mask[i + wide - 1]
        for j in range(rows):
            here = np.uint16(column[j] + come[j])
            out[j] = here > 0
            column[j] = here - gone[j]


@inner
def is_open(openings, t, m, x):
    """Whether the ray of tangents (t, m) is open at distance x. openings: OpeningMasks."""
    masks = openings.masks
    i = int(math.floor(t * openings.across + openings.cu))
    j = int(math.floor(m * openings.down + openings.cv))
    if i < 0 or j < 0 or i >= masks.shape[1] or j >= masks.shape[2]:
        return False
    return masks[layer_of(x, openings.steps_m), i, j] == 1


@inner
def cell_of(tan, per_tan, centre, cells):
    """The cell across or down of a tangent, that at the border where it lies outside."""
    return min(max(int(math.floor(tan * per_tan + centre)), 0), cells - 1)


@inner
def layer_of(x, steps_m):
    """Index of the layer of masks for distance x."""
    layer = 0
    for k in range(steps_m.shape[0]):
        if x < steps_m[k]:
            break
        layer += 1
    return layer


@kernel
def open_masks(codes, strips, n, view, settings, max_range_m, spare, masks, steps_m):
    """`nearest_codes`, and of these `open_mask` at the distances opening_first_m * opening_ratio^k.

    codes: (cols, rows) uint16; strips: the first n of STRIP; settings: (1,) OPENING_SETTINGS; spare: see `open_mask`. Out:
    masks and steps_m of OpeningMasks."""
    p = settings[0]
    cell, f, step = p.opening_cell_px, view.f_px, np.float64(view.lateral[0])
    first_m, ratio, ws, hs = p.opening_first_m, p.opening_ratio, p.passable_width_m, p.passable_height_m
    across, down = masks.shape[1], masks.shape[2]
    nearest, total = np.empty((across, down), np.uint16), np.empty((across + 1, down + 1), np.int32)
    boxes, column = np.empty(codes.shape[1], np.uint16), np.empty(down, np.uint16)
    nearest_codes(codes, cell, strips, n, view.lsb_per_px, boxes, nearest)
    count_unknown(nearest, total)
    for k in range(masks.shape[0]):
        x = first_m * ratio**k
        beyond = min(x + ws, max(max_range_m, x + p.opening_behind_m))
        wide = max(1, math.ceil(ws * f / (x * step * cell) - ROUNDING))
        high = max(1, math.ceil(hs * f / (x * cell) - ROUNDING))
        limit = max(int(f * view.lsb_per_px / beyond), 2)
        open_mask(nearest, limit, wide, high, p.opening_unknown_share, total, spare, column, masks[k])
    for k in range(1, masks.shape[0]):
        steps_m[k - 1] = first_m * ratio ** (k - 0.5)


def find_openings(
    codes: NDArray[np.uint16],
    strips: NDArray[Any],
    n: int,
    view: ViewGeometry,
    max_range_m: float,
    settings: NDArray[Any],
    buffers: Buffers,
) -> OpeningMasks:
    """What the vehicle could fly through, one mask per distance step, up to the maximum range; the masks lie in `buffers`.

    codes: (cols, rows) uint16 of the view; strips: the first n of STRIP; settings: (1,) OPENING_SETTINGS. A cell passes at x when nothing in it is nearer than
    x + Ws; so a niche shallower than the vehicle is wide is no opening."""
    p = settings[0]
    cell = int(p.opening_cell_px)
    shape = -(-view.cols // cell), -(-view.rows // cell)
    layers = 1 + max(0, round(math.log(max_range_m / p.opening_first_m) / math.log(p.opening_ratio)))
    masks, steps_m = buffers("opening_masks", (layers, *shape), np.uint8), np.empty(layers - 1)
    spare = buffers("opening_spare", (2, shape[0] * shape[1]), np.uint8)
    open_masks(codes, strips, n, view, settings, max_range_m, spare, masks, steps_m)
    f_px, column_px = view.f_px, float(view.lateral[0])
    return OpeningMasks(
        masks, steps_m, f_px / column_px / cell, f_px / cell, (view.cu + 0.5) / cell, (view.cv + 0.5) / cell
    )

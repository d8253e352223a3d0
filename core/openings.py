"""Section 5.1's rule for every later stage: what the vehicle could fly through is never covered.

At a distance x a cell is open when it belongs to a box of Ws by Hs of cells that were all seen to be free to beyond
x + Ws. Merging and filling may cover what lies close to evidence, but no open cell.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .level import ViewGeometry
from .params import Params
from .strips import BOTTOM, SUPPORT, TOP, D, U

_BLOCKED = 20000
"""A blocked cell in sums that else count unknown cells: more than any box may hold of those."""

# what is_open needs to know of the masks: cells per tangent across and down, the cell of the axis, the distances
F_ACROSS, F_DOWN, F_CU, F_CV, F_FIRST_M, F_LOG_RATIO = range(6)


@njit(cache=True, nogil=True)
def level_of(x, first_m, log_ratio):
    """Index of the layer of masks for distance x: the distances grow geometrically from first_m."""
    return max(0, int(math.log(max(x, 1e-3) / first_m) / log_ratio + 0.5))


@njit(cache=True, nogil=True)
def nearest_codes(codes, cell, ints, floats, n, quantum, nearest):
    """The nearest thing in each cell as a code; 0 where half of it or more is unknown.

    codes: (cols, rows) uint16. nearest: (C, R) int32 out: the second nearest of the cell's four corners, which a
    mismatch of two by two pixels cannot be, or the nearest strip that crosses the cell: thin things are strips."""
    cols, rows = codes.shape
    for i in range(nearest.shape[0]):
        u0, u1 = i * cell, min(cols, (i + 1) * cell) - 1
        for j in range(nearest.shape[1]):
            v0, v1 = j * cell, min(rows, (j + 1) * cell) - 1
            a, b, dark = np.int32(1), np.int32(1), 0
            for u in (u0, u1):
                for v in (v0, v1):
                    code = np.int32(codes[u, v])
                    dark += 1 if code == 0 else 0
                    if code > a:
                        a, b = code, a
                    elif code > b:
                        b = code
            nearest[i, j] = 0 if dark >= 2 else b
    for k in range(n):
        if ints[k, SUPPORT] > 0:
            code = min(np.int32(65535), np.int32(floats[k, D] * quantum))
            i = ints[k, U] // cell
            for j in range(ints[k, TOP] // cell, ints[k, BOTTOM] // cell + 1):
                nearest[i, j] = max(nearest[i, j], code)


@njit(cache=True, nogil=True)
def open_mask(nearest, limit, wide, high, unknown_share, total, mask):
    """mask[i, j] = 1 where a free box of wide x high cells covers the cell.

    A box is free when no cell's code reaches limit and at most unknown_share of its cells is unknown (dropped pixels).
    total: (C + 1, R + 1) int64 scratch. Summed areas find the free boxes, summed areas of those their union."""
    cols, rows = nearest.shape
    mask[:] = 0
    if wide > cols or high > rows:
        return
    total[:] = 0
    allowed = int(unknown_share * (wide * high))
    for i in range(cols):
        run = 0
        for j in range(rows):
            run += _BLOCKED if nearest[i, j] >= limit else (1 if nearest[i, j] == 0 else 0)
            total[i + 1, j + 1] = total[i, j + 1] + run
    for i in range(cols):
        for j in range(rows):
            if i + wide <= cols and j + high <= rows:
                inside = total[i + wide, j + high] - total[i, j + high] - total[i + wide, j] + total[i, j]
                mask[i, j] = 1 if inside <= allowed else 0
    # each free box marks its cells: spread right, then down
    for j in range(rows):
        left = 0
        for i in range(cols):
            left = wide if mask[i, j] else left - 1
            total[i + 1, j + 1] = 1 if left > 0 else 0
    for i in range(cols):
        left = 0
        for j in range(rows):
            left = high if total[i + 1, j + 1] else left - 1
            mask[i, j] = 1 if left > 0 else 0


@njit(cache=True, nogil=True)
def is_open(masks, t, m, x, frame):
    """Whether the ray of tangents (t, m) is open at distance x. frame: (6,) float64 by the F_ indices."""
    i = int(math.floor(t * frame[F_ACROSS] + frame[F_CU]))
    j = int(math.floor(m * frame[F_DOWN] + frame[F_CV]))
    if i < 0 or j < 0 or i >= masks.shape[1] or j >= masks.shape[2]:
        return False
    level = min(masks.shape[0] - 1, level_of(x, frame[F_FIRST_M], frame[F_LOG_RATIO]))
    return masks[level, i, j] == 1


def opening_masks(
    codes: NDArray[np.uint16], ints: NDArray[np.int32], floats: NDArray[np.float32], n: int, g: ViewGeometry,
    max_range_m: float, params: Params,
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:  # fmt: skip
    """(masks, frame): masks (L, C, R) uint8 per distance step, up to the maximum range, frame (6,) for is_open.

    A cell passes at x when nothing in it is nearer than x + Ws; so a niche shallower than the vehicle is wide is no
    opening."""
    p = params
    step, cell = float(g.lateral[0]), p.opening_cell_px
    nearest = np.empty((-(-g.cols // cell), -(-g.rows // cell)), np.int32)
    nearest_codes(codes, cell, ints, floats, n, g.quantum, nearest)
    log_ratio = math.log(p.opening_ratio)
    levels = 1 + level_of(max_range_m, p.opening_first_m, log_ratio)
    masks = np.zeros((levels, *nearest.shape), np.uint8)
    total = np.empty((nearest.shape[0] + 1, nearest.shape[1] + 1), np.int64)
    for level in range(levels):
        x = p.opening_first_m * p.opening_ratio**level
        wide = max(1, math.ceil(p.passable_width_m * g.f_px / (x * step * cell) - 1e-9))
        high = max(1, math.ceil(p.passable_height_m * g.f_px / (x * cell) - 1e-9))
        limit = int(g.f_px * g.quantum / min(x + p.passable_width_m, max(max_range_m, x + p.opening_behind_m)))
        open_mask(nearest, max(limit, 2), wide, high, p.opening_unknown_share, total, masks[level])
    across, down, cu, cv = g.f_px / step / cell, g.f_px / cell, (g.cu + 0.5) / cell, (g.cv + 0.5) / cell
    return masks, np.array([across, down, cu, cv, p.opening_first_m, log_ratio])

"""Which strips stay: a thing needs enough source pixels, its own or its neighbours'; and where the image cut it."""

from __future__ import annotations

import numpy as np

from ..jit import copy_row, inner, inner_inline, kernel
from .strips import (
    BOTTOM,
    CUT,
    I_CUT,
    I_LARGE,
    I_SUPPORT,
    I_SUPPORT_COLUMNS,
    I_SUPPORT_ROWS,
    KIND,
    MERGED,
    NEAR,
    PX,
    S_SIGMA_D,
    S_SMOOTH_RELATIVE,
    S_SMOOTH_SIGMAS,
    S_SUPPORT_PER_PX,
    S_SUPPORT_RELATIVE,
    S_SUPPORT_SIGMAS,
    S_TAIL,
    SIGMA,
    SUPPORT,
    TOP,
    D,
    U,
)
from .view_geometry import outside_source

_BAND = 16
"""Not tuning: rows of a column among which a strip is looked for one by one."""


@kernel
def drop_unsupported(ints, floats, n, cols, fs, si, first_of_column, lowest, keep):
    """Removes strips that too few pixels stand for; returns how many stay, moved to the front in order.

    A strip needs min_support_px source pixels, near ones min_support_m's worth. With fewer it is kept when other small
    strips, within support_columns, support_rows and support_sigmas (or support_relative) of disparity, bring it to
    that: a pole has it in its own column, a wire along its row; a mismatch of two by two pixels has it nowhere. What
    lies within support_tail_sigmas of a large strip beside it is that strip's noise, and counts there. Strips merged for
    want of room carry all that they touch.
    Strips in order of `sort_columns`. fs, si: settings by the S_ and I_ indices. first_of_column: (cols + 1,) int32, see
    `index_columns`, in and out. lowest: (N,) int32, keep: (N,) uint8, both scratch."""
    lowest_rows(ints, cols, first_of_column, lowest)
    deepest = 0
    for i in range(n):
        deepest = max(deepest, lowest[i])
    first_below = np.empty((cols, deepest // _BAND + 1), np.int32)
    index_rows(cols, first_of_column, lowest, first_below)
    least, per_px = PX * si[I_SUPPORT], fs[S_SUPPORT_PER_PX]
    for i in range(n):
        need = max(least, int(per_px * floats[i, D]))
        keep[i] = 1
        if ints[i, SUPPORT] < need:
            keep[i] = _carried(ints, floats, i, cols, need, fs, si, first_of_column, lowest, first_below)
    n = compact(ints, floats, n, keep)
    index_columns(ints, n, cols, first_of_column)
    return n


@inner
def lowest_rows(ints, cols, first_of_column, lowest):
    """lowest[i]: the greatest BOTTOM of the strips up to i in its column. Strips that end above a row can so be passed
    over, as those that begin below one can."""
    for u in range(cols):
        least = np.int32(-1)
        for i in range(first_of_column[u], first_of_column[u + 1]):
            least = max(least, ints[i, BOTTOM])
            lowest[i] = least


@inner
def index_rows(cols, first_of_column, lowest, first_below):
    """first_below[u, b] (cols, B) int32 out: the first strip of column u that may reach row b * _BAND or a lower one; what
    follows the column where none does. lowest: of `lowest_rows`."""
    for u in range(cols):
        at, last = first_of_column[u], first_of_column[u + 1]
        for b in range(first_below.shape[1]):
            for _ in range(last - at):
                if lowest[at] >= b * _BAND:
                    break
                at += 1
            first_below[u, b] = at


@inner_inline
def _carried(ints, floats, i, cols, least, fs, si, first_of_column, lowest, first_below):
    """1 where the small strip i is carried by small neighbours and is not the noise of a large one, else 0.

    A large one lies beside it when it touches its rows in its own column or the next; so these columns come first.
    first_below: of `index_rows`."""
    total = ints[i, SUPPORT]
    u, top, bottom, d = ints[i, U], ints[i, TOP], ints[i, BOTTOM], floats[i, D]
    reach, rows = si[I_SUPPORT_COLUMNS], si[I_SUPPORT_ROWS]
    near = max(fs[S_SUPPORT_SIGMAS] * fs[S_SIGMA_D], fs[S_SUPPORT_RELATIVE] * d)
    tail, large = fs[S_TAIL] * fs[S_SIGMA_D], si[I_LARGE] * least
    for k in range(2 * reach + 1):
        off = (k + 1) // 2  # 0, 1, -1, 2, -2, ..
        w = u + off if k % 2 == 1 else u - off
        if off > 1 and total >= least:
            return 1
        if w < 0 or w >= cols:
            continue
        row = top - rows - off
        first, last = first_below[w, max(row, 0) // _BAND], first_of_column[w + 1]
        for _ in range(last - first):
            if lowest[first] >= row:
                break
            first += 1
        for j in range(first, last):
            if ints[j, TOP] > bottom + rows + off:
                break
            apart = abs(floats[j, D] - d)
            if top - ints[j, BOTTOM] > rows + off:
                continue
            if ints[j, KIND] == MERGED:  # whatever carried this one may be in it
                return 1
            if j == i or apart > near:
                continue
            inside = top >= ints[j, TOP] - 1 and bottom <= ints[j, BOTTOM] + 1
            if inside and ints[j, SUPPORT] >= large:
                if off <= 1 and apart <= tail:
                    return 0
            else:
                total += ints[j, SUPPORT]
    return 1 if total >= least else 0


@inner
def index_columns(ints, n, cols, first_of_column):
    """first_of_column[u]..first_of_column[u + 1]: the strips of column u (strips are in column order)."""
    i = 0
    for u in range(cols + 1):
        for _ in range(n - i):
            if ints[i, U] >= u:
                break
            i += 1
        first_of_column[u] = i


@inner
def compact(ints, floats, n, keep):
    """Moves the strips with keep != 0 to the front; returns their number."""
    m = 0
    for i in range(n):
        if keep[i]:
            if m != i:
                copy_row(ints, m, i)
                copy_row(floats, m, i)
            m += 1
    return m


@kernel
def sort_columns(ints, floats, cols, first_of_column):
    """Orders the strips of every column by top row, then from near to far (by insertion: they are few and nearly so)."""
    row, value = np.zeros(ints.shape[1], ints.dtype), np.zeros(floats.shape[1], floats.dtype)
    for u in range(cols):
        first = first_of_column[u]
        for i in range(first + 1, first_of_column[u + 1]):
            top, d = ints[i, TOP], floats[i, D]
            at = i
            for _ in range(i - first):
                if ints[at - 1, TOP] < top or (ints[at - 1, TOP] == top and floats[at - 1, D] >= d):
                    break
                at -= 1
            if at == i:
                continue
            for c in range(row.shape[0]):
                row[c] = ints[i, c]
            for c in range(value.shape[0]):
                value[c] = floats[i, c]
            for j in range(i - at):
                copy_row(ints, i - j, i - j - 1)
                copy_row(floats, i - j, i - j - 1)
            for c in range(row.shape[0]):
                ints[at, c] = row[c]
            for c in range(value.shape[0]):
                floats[at, c] = value[c]


@inner
def mark_cuts(ints, n, H, cols, rows, si):
    """Sets CUT where the cell cut_rows above (1) or below (2) a strip is outside the source image (cols x rows)."""
    beyond = si[I_CUT]
    for i in range(n):
        cut = 0
        if outside_source(H, ints[i, U], ints[i, TOP] - beyond, cols, rows):
            cut = 1
        if outside_source(H, ints[i, U], ints[i, BOTTOM] + beyond, cols, rows):
            cut += 2
        ints[i, CUT] = cut


@inner
def smooth_near(ints, floats, n, cols, fs, first_of_column, lowest, raw):
    """Near edge as the median over three columns of touching strips, so that one column alone moves no plane.

    No edge comes nearer by it: what stands beside a strip is other strips' edge, and moves their plane. Strips in order of `sort_columns`. lowest: (N,) int32, raw: (N,) float32, both scratch. A strip without both
    neighbours keeps its own. Thin things keep theirs: a neighbour farther off than smooth_relative of the disparity and
    smooth_sigmas of SIGMA is another thing."""
    index_columns(ints, n, cols, first_of_column)
    lowest_rows(ints, cols, first_of_column, lowest)
    for i in range(n):
        raw[i] = floats[i, NEAR]
    for u in range(1, cols - 1):
        a, b = first_of_column[u - 1], first_of_column[u + 1]
        for i in range(first_of_column[u], first_of_column[u + 1]):
            left, a = _touching(ints, floats, i, fs, a, first_of_column[u], lowest)
            if left < 0 or raw[left] >= raw[i]:
                continue  # the median of three would be no farther than its own, which it keeps
            right, b = _touching(ints, floats, i, fs, b, first_of_column[u + 2], lowest)
            if right >= 0:
                floats[i, NEAR] = min(raw[i], max(raw[left], raw[right]))


@inner_inline
def _touching(ints, floats, i, fs, first, last, lowest):
    """(The strip among first..last-1 that overlaps strip i in rows and lies nearest to it in disparity, or -1; the
    first that may overlap this one or a lower one)."""
    best, found = fs[S_SMOOTH_RELATIVE] * floats[i, D] + fs[S_SMOOTH_SIGMAS] * floats[i, SIGMA], -1
    top, bottom, d = ints[i, TOP], ints[i, BOTTOM], floats[i, D]
    for _ in range(last - first):
        if lowest[first] >= top:
            break
        first += 1
    for j in range(first, last):
        if ints[j, TOP] > bottom:
            break
        if top <= ints[j, BOTTOM]:
            off = abs(floats[j, D] - d)
            if off < best:
                best, found = off, j
    return found, first

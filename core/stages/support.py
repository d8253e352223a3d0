"""Which strips stay: a thing needs enough source pixels, its own or its neighbours'; and where the image cut it."""

from __future__ import annotations

import numpy as np

from ..jit import inner, inner_inline, kernel
from .strips import CUT_BOTTOM, CUT_TOP, MERGED, PX, STRIP
from .view_geometry import outside_source

_BAND = 16
"""Not tuning: rows of a column among which a strip is looked for one by one."""


@kernel
def drop_unsupported(strips, n, cols, settings, first_of_column, lowest, keep):
    """Removes strips that too few pixels stand for; returns how many stay, moved to the front in order.

    A strip needs min_support_px source pixels, near ones min_support_m's worth. With fewer it is kept when other small
    strips, within support_columns, support_rows and support_sigmas (or support_relative) of disparity, bring it to
    that: a pole has it in its own column, a wire along its row; a mismatch of two by two pixels has it nowhere. What
    lies within support_tail_sigmas of a large strip beside it is that strip's noise, and counts there. Strips merged for
    want of room carry all that they touch.
    Strips in order of `sort_columns`. settings: a record of STRIP_SETTINGS. first_of_column: (cols + 1,) int32, see
    `index_columns`, in and out. lowest: (N,) int32, keep: (N,) uint8, both scratch."""
    lowest_rows(strips, cols, first_of_column, lowest)
    deepest = 0
    for i in range(n):
        deepest = max(deepest, lowest[i])
    first_below = np.empty((cols, deepest // _BAND + 1), np.int32)
    index_rows(cols, first_of_column, lowest, first_below)
    least, per_px = PX * settings.min_support_px, settings.support_per_px
    for i in range(n):
        need = max(least, int(per_px * strips[i].disparity_px))
        keep[i] = 1
        if strips[i].support < need:
            keep[i] = _carried(strips, i, cols, need, settings, first_of_column, lowest, first_below)
    n = compact(strips, n, keep)
    index_columns(strips, n, cols, first_of_column)
    return n


@inner
def lowest_rows(strips, cols, first_of_column, lowest):
    """lowest[i]: the greatest BOTTOM of the strips up to i in its column. Strips that end above a row can so be passed
    over, as those that begin below one can."""
    for u in range(cols):
        least = np.int32(-1)
        for i in range(first_of_column[u], first_of_column[u + 1]):
            least = max(least, strips[i].bottom_row)
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
def _carried(strips, i, cols, least, settings, first_of_column, lowest, first_below):
    """1 where the small strip i is carried by small neighbours and is not the noise of a large one, else 0.

    A large one lies beside it when it touches its rows in its own column or the next; so these columns come first.
    first_below: of `index_rows`."""
    total = strips[i].support
    u, top, bottom, d = strips[i].column, strips[i].top_row, strips[i].bottom_row, strips[i].disparity_px
    reach, rows = settings.support_columns, settings.support_rows
    near = max(settings.support_sigmas * settings.sigma_d_px, settings.support_relative * d)
    tail, large = settings.support_tail_sigmas * settings.sigma_d_px, settings.support_large * least
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
            if strips[j].top_row > bottom + rows + off:
                break
            apart = abs(strips[j].disparity_px - d)
            if top - strips[j].bottom_row > rows + off:
                continue
            if strips[j].kind == MERGED:  # whatever carried this one may be in it
                return 1
            if j == i or apart > near:
                continue
            inside = top >= strips[j].top_row - 1 and bottom <= strips[j].bottom_row + 1
            if inside and strips[j].support >= large:
                if off <= 1 and apart <= tail:
                    return 0
            else:
                total += strips[j].support
    return 1 if total >= least else 0


@inner
def index_columns(strips, n, cols, first_of_column):
    """first_of_column[u]..first_of_column[u + 1]: the strips of column u (strips are in column order)."""
    i = 0
    for u in range(cols + 1):
        for _ in range(n - i):
            if strips[i].column >= u:
                break
            i += 1
        first_of_column[u] = i


@inner
def compact(strips, n, keep):
    """Moves the strips with keep != 0 to the front; returns their number."""
    m = 0
    for i in range(n):
        if keep[i]:
            if m != i:
                strips[m] = strips[i]
            m += 1
    return m


@kernel
def sort_columns(strips, cols, first_of_column):
    """Orders the strips of every column by top row, then from near to far (by insertion: they are few and nearly so)."""
    held = np.zeros(1, STRIP)
    for u in range(cols):
        first = first_of_column[u]
        for i in range(first + 1, first_of_column[u + 1]):
            top, d = strips[i].top_row, strips[i].disparity_px
            at = i
            for _ in range(i - first):
                if strips[at - 1].top_row < top or (strips[at - 1].top_row == top and strips[at - 1].disparity_px >= d):
                    break
                at -= 1
            if at == i:
                continue
            held[0] = strips[i]
            for j in range(i - at):
                strips[i - j] = strips[i - j - 1]
            strips[at] = held[0]


@inner
def mark_cuts(strips, n, H, cols, rows, cut_rows):
    """Sets `cut` where the cell cut_rows above or below a strip is outside the source image (cols x rows)."""
    for i in range(n):
        cut = 0
        if outside_source(H, strips[i].column, strips[i].top_row - cut_rows, cols, rows):
            cut = CUT_TOP
        if outside_source(H, strips[i].column, strips[i].bottom_row + cut_rows, cols, rows):
            cut += CUT_BOTTOM
        strips[i].cut = cut


@inner
def smooth_near(strips, n, cols, settings, first_of_column, lowest, raw):
    """Near edge as the median over three columns of touching strips, so that one column alone moves no plane.

    No edge comes nearer by it: what stands beside a strip is the edge of other strips, and moves their plane. Strips in
    order of `sort_columns`. lowest: (N,) int32, raw: (N,) float32, both scratch. A strip without both neighbours keeps its
    own. Thin things keep theirs: a neighbour farther off than smooth_relative of the disparity and
    smooth_sigmas of noise is another thing."""
    index_columns(strips, n, cols, first_of_column)
    lowest_rows(strips, cols, first_of_column, lowest)
    for i in range(n):
        raw[i] = strips[i].near_px
    for u in range(1, cols - 1):
        a, b = first_of_column[u - 1], first_of_column[u + 1]
        for i in range(first_of_column[u], first_of_column[u + 1]):
            left, a = _touching(strips, i, settings, a, first_of_column[u], lowest)
            if left < 0 or raw[left] >= raw[i]:
                continue  # the median of three would be no farther than its own, which it keeps
            right, b = _touching(strips, i, settings, b, first_of_column[u + 2], lowest)
            if right >= 0:
                strips[i].near_px = min(raw[i], max(raw[left], raw[right]))


@inner_inline
def _touching(strips, i, settings, first, last, lowest):
    """(The strip among first..last-1 that overlaps strip i in rows and lies nearest to it in disparity, or -1; the
    first that may overlap this one or a lower one)."""
    best, found = settings.smooth_relative * strips[i].disparity_px + settings.smooth_sigmas * strips[i].sigma_px, -1
    top, bottom, d = strips[i].top_row, strips[i].bottom_row, strips[i].disparity_px
    for _ in range(last - first):
        if lowest[first] >= top:
            break
        first += 1
    for j in range(first, last):
        if strips[j].top_row > bottom:
            break
        if top <= strips[j].bottom_row:
            off = abs(strips[j].disparity_px - d)
            if off < best:
                best, found = off, j
    return found, first

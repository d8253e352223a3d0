"""Which strips stay: a thing needs enough source pixels, its own or its neighbours'; and where the image cut it."""

from __future__ import annotations

from numba import njit

from .level import outside_source
from .strips import (
    BOTTOM,
    CUT,
    I_CUT,
    I_LARGE,
    I_SUPPORT,
    I_SUPPORT_COLUMNS,
    I_SUPPORT_ROWS,
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


@njit(cache=True, nogil=True)
def drop_unsupported(ints, floats, n, cols, fs, si, first_of_column, keep):
    """Removes strips that too few pixels stand for; returns how many stay, moved to the front in order.

    A strip needs min_support_px source pixels, near ones min_support_m's worth. With fewer it is kept when other small
    strips, within support_columns, support_rows and support_sigmas (or support_relative) of disparity, bring it to
    that: a pole has it in its own column, a wire along its row; a mismatch of two by two pixels has it nowhere. What
    lies within support_tail_sigmas of a large strip beside it is that strip's noise, and counts there.
    fs, si: settings by the S_ and I_ indices. first_of_column: (cols + 1,) int32, keep: (N,) uint8, both scratch."""
    index_columns(ints, n, cols, first_of_column)
    for i in range(n):
        keep[i] = 1
        need = max(PX * si[I_SUPPORT], int(fs[S_SUPPORT_PER_PX] * floats[i, D]))
        if ints[i, SUPPORT] < need:
            keep[i] = _carried(ints, floats, i, cols, need, fs, si, first_of_column)
    return compact(ints, floats, n, keep)


@njit(cache=True, nogil=True)
def _carried(ints, floats, i, cols, least, fs, si, first_of_column):
    """1 where the small strip i is carried by small neighbours and is not the noise of a large one, else 0.

    A large one lies beside it when it touches its rows in its own column or the next."""
    total = ints[i, SUPPORT]
    u, reach, rows = ints[i, U], si[I_SUPPORT_COLUMNS], si[I_SUPPORT_ROWS]
    near = max(fs[S_SUPPORT_SIGMAS] * fs[S_SIGMA_D], fs[S_SUPPORT_RELATIVE] * floats[i, D])
    tail, large = fs[S_TAIL] * fs[S_SIGMA_D], si[I_LARGE] * least
    for w in range(max(0, u - reach), min(cols - 1, u + reach) + 1):
        for j in range(first_of_column[w], first_of_column[w + 1]):
            apart = max(ints[j, TOP] - ints[i, BOTTOM], ints[i, TOP] - ints[j, BOTTOM])
            off = abs(floats[j, D] - floats[i, D])
            if j == i or apart > rows + abs(w - u) or off > near:
                continue
            inside = ints[i, TOP] >= ints[j, TOP] - 1 and ints[i, BOTTOM] <= ints[j, BOTTOM] + 1
            if inside and abs(w - u) <= 1 and off <= tail and ints[j, SUPPORT] >= large:
                return 0
            if not inside or ints[j, SUPPORT] < large:
                total += ints[j, SUPPORT]
    return 1 if total >= least else 0


@njit(cache=True, nogil=True)
def index_columns(ints, n, cols, first_of_column):
    """first_of_column[u]..first_of_column[u + 1]: the strips of column u (strips are in column order)."""
    i = 0
    for u in range(cols + 1):
        for _ in range(n - i):
            if ints[i, U] >= u:
                break
            i += 1
        first_of_column[u] = i


@njit(cache=True, nogil=True)
def compact(ints, floats, n, keep):
    """Moves the strips with keep != 0 to the front; returns their number."""
    m = 0
    for i in range(n):
        if keep[i]:
            if m != i:
                ints[m] = ints[i]
                floats[m] = floats[i]
            m += 1
    return m


@njit(cache=True, nogil=True)
def sort_column(ints, floats, first, last):
    """Orders the strips first..last-1 of one column by top row, then from near to far (insertion sort: few, nearly sorted)."""
    for i in range(first + 1, last):
        row = ints[i].copy()
        value = floats[i].copy()
        at = i
        for j in range(i - 1, first - 1, -1):
            if ints[j, TOP] < row[TOP] or (ints[j, TOP] == row[TOP] and floats[j, D] >= value[D]):
                break
            ints[j + 1] = ints[j]
            floats[j + 1] = floats[j]
            at = j
        ints[at] = row
        floats[at] = value


@njit(cache=True, nogil=True)
def sort_columns(ints, floats, cols, first_of_column):
    """Orders the strips of every column from top to bottom."""
    for u in range(cols):
        sort_column(ints, floats, first_of_column[u], first_of_column[u + 1])


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def smooth_near(ints, floats, n, cols, fs, first_of_column, raw):
    """Near edge as the median over three columns of touching strips, so that one column alone moves no plane.

    raw: (N,) float32 scratch. A strip without both neighbours keeps its own. Thin things keep theirs: a neighbour
    farther off than smooth_relative of the disparity and smooth_sigmas of SIGMA is another thing."""
    index_columns(ints, n, cols, first_of_column)
    for i in range(n):
        raw[i] = floats[i, NEAR]
    for i in range(n):
        u = ints[i, U]
        if u == 0 or u == cols - 1:
            continue
        left = _touching(ints, floats, i, fs, first_of_column[u - 1], first_of_column[u])
        right = _touching(ints, floats, i, fs, first_of_column[u + 1], first_of_column[u + 2])
        if left >= 0 and right >= 0:
            a, b, c = raw[left], raw[i], raw[right]
            middle = max(min(a, b), min(max(a, b), c))
            floats[i, NEAR] = middle


@njit(cache=True, nogil=True)
def _touching(ints, floats, i, fs, first, last):
    """The strip among first..last-1 that overlaps strip i in rows and lies nearest to it in disparity, or -1."""
    best, found = fs[S_SMOOTH_RELATIVE] * floats[i, D] + fs[S_SMOOTH_SIGMAS] * floats[i, SIGMA], -1
    for j in range(first, last):
        if ints[j, TOP] <= ints[i, BOTTOM] and ints[i, TOP] <= ints[j, BOTTOM]:
            off = abs(floats[j, D] - floats[i, D])
            if off < best:
                best, found = off, j
    return found

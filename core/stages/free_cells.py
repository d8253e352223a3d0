"""The cells of a levelled view that the free-range profile samples, laid side by side so that they are counted fast."""

from __future__ import annotations

import numpy as np

from ..jit import inner
from .view_geometry import Q_UNKNOWN

DARK_ROWS = 4
"""Not tuning: rows of a block that is dark where more than half of it is unknown."""
_COUNTED = 32768
"""Cells that are counted in one go: as many as 16 bits hold with room to spare."""


@inner
def looked_at(rows, looked):
    """looked: (2, rows) uint16 out: how often a row is looked at in columns of even and of odd number.

    Every second pair of rows, the other ones in the next column: half of the cells, and no line, column or chequers of
    single cells that would be seen only or never. An odd last row counts twice."""
    for v in range(rows):
        turn = (v >> 1) & 1
        looked[turn, v] = 2 if v == rows - 1 and v % 2 == 0 else 1
        looked[1 - turn, v] = 0


@inner
def look_at(codes, u0, u1, block, looked, unknown, cells, begin, dark):
    """Lays the cells of columns u0..u1 - 1 that are looked at side by side, block by block of rows.

    codes: (cols, rows) uint16; block: rows of a block, even; looked: see `looked_at`. unknown: (rows,) uint16 scratch.
    cells: uint16 out, room for one for each row of each column and two more. begin: (B + 1,) int64 out, the cells of
    block b are cells[begin[b]:begin[b + 1]]. dark: (B + 1,) int64 out, the unknown ones of all blocks before b."""
    rows = codes.shape[1]
    one, four, wide = np.uint64(1), np.uint64(4), np.uint64(2 * (u1 - u0))
    even = ((u1 + 1) >> 1) - ((u0 + 1) >> 1)
    unknown[:] = 0
    for u in range(u0, u1):
        odd = u & 1
        column, counted = codes[u], looked[odd]
        for v in range(rows):
            count = counted[v]  # read in any case, see `kernels`
            unknown[v] += count if column[v] == Q_UNKNOWN else np.uint16(0)
        to, at = np.uint64(2 * ((u - u0) >> 1) + 2 * even * odd), np.uint64(2 * odd)
        for _ in range((rows + 2 - 2 * odd) >> 2):
            cells[to], cells[to + one] = column[at], column[at + one]
            at += four
            to += wide
        if counted[rows - 1] == 2:
            cells[to], cells[to + one] = column[rows - 1], column[rows - 1]
    total = np.int64(0)
    for b in range(begin.shape[0]):
        first, last = b * block, min((b + 1) * block, rows)
        pairs = min(first, rows + 1) >> 1
        begin[b], dark[b] = 2 * (((pairs + 1) >> 1) * even + (pairs >> 1) * (u1 - u0 - even)), total
        for v in range(first, last):
            total += np.int64(unknown[v])


@inner
def count_dark_blocks(codes, u0, u1, dark_blocks):
    """How many of the columns u0..u1 - 1 have dark blocks: DARK_ROWS rows of which more than half are unknown.

    codes: (cols, rows) uint16. dark_blocks: (cols, rows // DARK_ROWS + 1) int16 out, for each of these columns how many of
    the blocks before b are dark."""
    one, two, three, step = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(DARK_ROWS)
    found = 0
    for u in range(u0, u1):
        column, counts, total, v = codes[u], dark_blocks[found], np.int16(0), np.uint64(0)
        counts[0] = 0
        for b in range(1, counts.shape[0]):
            upper = np.int16(column[v] == Q_UNKNOWN) + np.int16(column[v + one] == Q_UNKNOWN)
            lower = np.int16(column[v + two] == Q_UNKNOWN) + np.int16(column[v + three] == Q_UNKNOWN)
            total += np.int16(upper + lower > 2)
            counts[b] = total
            v += step
        if total > 0:
            found += 1
    return found


@inner
def count_codes(cells, first, end, least, most):
    """How many of cells[first..end - 1] have a code of least..most.

    Counted in numbers as narrow as the codes, so that many are done at a time; in parts that these can hold."""
    least, most, count, last = np.uint16(least), np.uint16(most), np.int64(0), np.uint64(end)
    for begin in range(first, end, _COUNTED):
        part, at = np.uint16(0), np.uint64(begin)
        for i in range(at, min(at + np.uint64(_COUNTED), last)):
            part = np.uint16(part + np.uint16((cells[i] >= least) & (cells[i] <= most)))
        count += np.int64(part)
    return count

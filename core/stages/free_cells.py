"""Samples of the levelled view for the free-range profile, in an order in which they are counted fast.

Input: quantised disparity of the exact view. Output: the unknown cells of each block of a column, the samples of one
direction, block by block of rows, and the number of unknown samples and columns. Used by free_space.py."""

from __future__ import annotations

import numpy as np

from ..jit import inner, kernel
from .view_geometry import Q_FAR, Q_UNKNOWN

DARK_ROWS = 4
"""Rows of a block that counts as unknown if more than half of its cells are."""
HIDES_NOTHING, HIDES_PART, HIDES_ALL = 0, 1, 2
"""See `hiding_columns`."""
_COUNTED = 32768
"""Cells that are counted with 16-bit numbers before the sum is widened."""


@inner
def looked_at(rows, looked):
    """Computes how often each row is sampled: looked, (2, rows) uint16 out, for columns of even and of odd index.

    Every second pair of rows is sampled, alternating between neighbouring columns. This is half of the cells, and no
    row, column or pattern of single cells is sampled only or never. The last row of an odd number counts twice."""
    for v in range(rows):
        turn = (v >> 1) & 1
        looked[turn, v] = 2 if v == rows - 1 and v % 2 == 0 else 1
        looked[1 - turn, v] = 0


@inner
def look_at(codes, u0, u1, block, looked, unknown, cells, begin, dark):
    """Copies the sampled cells of the columns u0..u1 - 1 to `cells`, block by block of rows.

    Args:
        codes: (cols, rows) uint16.
        u0, u1: first column and end.
        block: rows of a block, an even number.
        looked: (2, rows) uint16 of `looked_at`.
        unknown: (rows,) uint16 scratch.
        cells: uint16 out, with room for one cell per row and column and two more.
        begin: (B + 1,) int64 out. The cells of block b are cells[begin[b]:begin[b + 1]].
        dark: (B + 1,) int64 out, the number of unknown cells in all blocks before b."""
    rows = codes.shape[1]
    one, four, wide = np.uint64(1), np.uint64(4), np.uint64(2 * (u1 - u0))
    even = ((u1 + 1) >> 1) - ((u0 + 1) >> 1)
    unknown[:] = 0
    for u in range(u0, u1):
        odd = u & 1
        column, counted = codes[u], looked[odd]
        for v in range(rows):
            count = counted[v]  # read unconditionally, see core/jit.py
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


@kernel
def unknown_of_blocks(codes):
    """Returns the number of unknown cells in each block of DARK_ROWS rows of a column, (cols, blocks) uint8. Cells beyond
    the last row count as unknown. codes: (cols, rows) uint16."""
    cols, rows = codes.shape
    counts = np.empty((cols, (rows + DARK_ROWS - 1) // DARK_ROWS), np.uint8)
    one, two, three, step = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(DARK_ROWS)
    for u in range(cols):
        column, blocks, v = codes[u], counts[u], np.uint64(0)
        for b in range(rows // DARK_ROWS):
            upper = np.uint8(column[v] == Q_UNKNOWN) + np.uint8(column[v + one] == Q_UNKNOWN)
            lower = np.uint8(column[v + two] == Q_UNKNOWN) + np.uint8(column[v + three] == Q_UNKNOWN)
            blocks[b] = upper + lower
            v += step
        if rows % DARK_ROWS:
            blocks[-1] = DARK_ROWS
            for row in range(rows // DARK_ROWS * DARK_ROWS, rows):
                blocks[-1] -= column[row] != Q_UNKNOWN
    return counts


@inner
def count_dark_blocks(unknown, u0, u1, dark_blocks, dark_columns):
    """Counts blocks of DARK_ROWS rows of which more than half are unknown; returns the number of columns that have
    any.

    Args:
        unknown: of `unknown_of_blocks`.
        u0, u1: first column and end.
        dark_blocks: (cols, rows // DARK_ROWS + 1) int16 out. Line k is the k-th of these columns; element b is the
            number of such blocks before block b.
        dark_columns: (cols,) int64 out, the columns of these lines."""
    found = 0
    for u in range(u0, u1):
        column, counts, total = unknown[u], dark_blocks[found], np.int16(0)
        counts[0] = 0
        for b in range(1, counts.shape[0]):
            total += np.int16(2 * column[b - 1] > DARK_ROWS)
            counts[b] = total
        if total > 0:
            dark_columns[found] = u
            found += 1
    return found


@inner
def count_codes(cells, first, end, least, most):
    """Returns how many of cells[first..end - 1] have a code of least..most.

    The counts are as narrow as the codes, so that more cells are processed per instruction."""
    least, most, count, last = np.uint16(least), np.uint16(most), np.int64(0), np.uint64(end)
    for begin in range(first, end, _COUNTED):
        part, at = np.uint16(0), np.uint64(begin)
        for i in range(at, min(at + np.uint64(_COUNTED), last)):
            part = np.uint16(part + np.uint16((cells[i] >= least) & (cells[i] <= most)))
        count += np.int64(part)
    return count


@inner
def hiding_columns(sampled, v0, v1, blocking):
    """Returns what columns may hide in the rows v0..v1, rounded outward: HIDES_ALL if one of the direction is unknown in more
    than half of its blocks; HIDES_PART if one that overlaps the direction is, or is unknown in a block and sees through
    the ring in less than half of its rows; else HIDES_NOTHING.

    Planes end the free range at near cells. Of a surface that is seen edge-on most pixels are removed as flying ones,
    and no plane stands for the near ones that are left between them.

    Args:
        sampled: Sampled of free_walk.py.
        v0, v1: rows.
        blocking: code of `blocking_codes`."""
    dark_blocks, columns, rows = sampled.dark_blocks, sampled.dark_columns, sampled.codes.shape[1]
    b0, b1 = v0 // DARK_ROWS, min(v1 // DARK_ROWS + 1, dark_blocks.shape[1] - 1)
    first, end = b0 * DARK_ROWS, min((v1 // DARK_ROWS + 1) * DARK_ROWS, rows)
    found = HIDES_NOTHING
    for k in range(dark_blocks.shape[0]):
        dark = dark_blocks[k, b1] - dark_blocks[k, b0]
        if 2 * dark > b1 - b0:
            if sampled.own[0] <= columns[k] < sampled.own[1]:
                return HIDES_ALL
            found = HIDES_PART
        elif dark > 0 and found == HIDES_NOTHING:
            seen = count_codes(sampled.codes[columns[k]], first, end, Q_FAR, blocking - 1)
            if 2 * seen < end - first:
                found = HIDES_PART
    return found

"""Samples of the levelled view for the free-range profile, in an order in which they are counted fast.

Input: quantised disparity of the exact view. Output: the unknown cells of each block of a column, the samples of one
direction, block by block of rows, and the number of unknown samples and columns. Used by free_space.py."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, kernel
from .view_geometry import Q_FAR, Q_UNKNOWN

DARK_ROWS = 4
"""Rows of a block that counts as unknown if more than half of its cells are."""
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


class Samples(NamedTuple):
    """Sampled cells of one direction, block by block of rows, and what is counted of them."""

    # uint16, with room for one cell per row and column and two more; those of block b are cells[begin[b]:begin[b + 1]]
    cells: Any
    begin: Any  # (B + 1,) int64
    unknown: Any  # (B + 1,) int64, the number of unknown cells in all blocks before b
    of_row: Any  # (rows,) uint16 scratch, the unknown cells of each row


@inner
def look_at(codes, columns, block, looked, out):
    """Samples the columns of a direction.

    Args:
        codes: (cols, rows) uint16.
        columns: (first, end) of the columns.
        block: rows of a block, an even number.
        looked: (2, rows) uint16 of `looked_at`.
        out: Samples, set."""
    rows, (u0, u1), cells = codes.shape[1], columns, out.cells
    one, four, wide = np.uint64(1), np.uint64(4), np.uint64(2 * (u1 - u0))
    even = ((u1 + 1) >> 1) - ((u0 + 1) >> 1)
    out.of_row[:] = 0
    for u in range(u0, u1):
        odd = u & 1
        column, counted = codes[u], looked[odd]
        for v in range(rows):
            count = counted[v]  # read unconditionally, see core/jit.py
            out.of_row[v] += count if column[v] == Q_UNKNOWN else np.uint16(0)
        to, at = np.uint64(2 * ((u - u0) >> 1) + 2 * even * odd), np.uint64(2 * odd)
        for _ in range((rows + 2 - 2 * odd) >> 2):
            cells[to], cells[to + one] = column[at], column[at + one]
            at += four
            to += wide
        if counted[rows - 1] == 2:
            cells[to], cells[to + one] = column[rows - 1], column[rows - 1]
    total = np.int64(0)
    for b in range(out.begin.shape[0]):
        first, last = b * block, min((b + 1) * block, rows)
        pairs = min(first, rows + 1) >> 1
        out.begin[b], out.unknown[b] = 2 * (((pairs + 1) >> 1) * even + (pairs >> 1) * (u1 - u0 - even)), total
        for v in range(first, last):
            total += np.int64(out.of_row[v])


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


class DarkColumns(NamedTuple):
    """The columns of a direction that have blocks of DARK_ROWS rows of which more than half of the cells are unknown."""

    columns: Any  # (K,) int64
    blocks: Any  # (K, rows // DARK_ROWS + 1) int16, of each of them the number of such blocks before block b


@inner
def count_dark_blocks(unknown, columns, out):
    """Finds the columns of (first, end) that have dark blocks; returns their number.

    Args:
        unknown: of `unknown_of_blocks`.
        columns: (first, end).
        out: DarkColumns with room for them, set."""
    found = 0
    for u in range(columns[0], columns[1]):
        column, counts, total = unknown[u], out.blocks[found], np.int16(0)
        counts[0] = 0
        for b in range(1, counts.shape[0]):
            total += np.int16(2 * column[b - 1] > DARK_ROWS)
            counts[b] = total
        if total > 0:
            out.columns[found] = u
            found += 1
    return found


class Sampled(NamedTuple):
    """What the walk counts in one direction."""

    codes: Any
    in_source: Any  # (first, last) row, see `free_geometry.common_source_rows`
    samples: Any  # Samples of the columns that have their middle in the direction
    dark: Any  # DarkColumns of the columns that overlap the direction
    # holes, near_holes: (rows,) uint8, `own` and `beside` of `free_holes.join_holes`, of the columns of `dark`
    holes: Any
    near_holes: Any


@inner_inline
def samples_of(sampled, part, w):
    """Returns (first, end, unknown) of the samples in the blocks that hold the rows of a Part: their range in `cells`, and
    how many of them are unknown. w: a record of WALK_SETTINGS."""
    b0, b1 = part.first // w.block_rows, part.last // w.block_rows + 1
    begin, unknown = sampled.samples.begin, sampled.samples.unknown
    return begin[b0], begin[b1], unknown[b1] - unknown[b0]


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
def columns_hide(sampled, part, blocking):
    """Returns whether a column that overlaps the direction may hide an object in the rows of a part, rounded outward: it is
    unknown in more than half of its blocks, or in one block and sees through the ring in less than half of its rows.

    Planes end the free range at near cells. Of a surface that is seen edge-on most pixels are removed as flying ones,
    and no plane stands for the near ones that are left between them.

    Args:
        sampled: Sampled.
        part: Part.
        blocking: least code that blocks the ring, see `Rings`."""
    blocks, columns, rows = sampled.dark.blocks, sampled.dark.columns, sampled.codes.shape[1]
    b0, b1 = part.first // DARK_ROWS, min(part.last // DARK_ROWS + 1, blocks.shape[1] - 1)
    first, end = b0 * DARK_ROWS, min((part.last // DARK_ROWS + 1) * DARK_ROWS, rows)
    for k in range(blocks.shape[0]):
        dark = blocks[k, b1] - blocks[k, b0]
        if 2 * dark > b1 - b0:
            return True
        if dark > 0:
            seen = count_codes(sampled.codes[columns[k]], first, end, Q_FAR, blocking - 1)
            if 2 * seen < end - first:
                return True
    return False

"""Holes of the levelled view: squares of unknown cells that are large enough to hide an object.

Input: the exact view and the number of unknown cells of each of its blocks. Output: for each row of a direction the sides of the unknown
squares that contain a cell of it or connect with one. Used by free_space.py.

What is nearer than the minimum range, and a surface without texture, leaves a hole in the image and no plane. The share
of unknown cells of a ring does not show it: a part of the hole that is small for the ring may be the edge of something
large. So holes are found in the whole image, before it is cut into directions and layers.

A hole counts by its width and height in pixels. Dropped pixels, and lines of them, are no hole: they fill no square. What
is narrower than the smallest square is narrower than what is found at all, see docs/reference/limits.md."""

from __future__ import annotations

import numpy as np

from ..jit import inner, inner_inline, kernel
from .free_cells import DARK_ROWS
from .view_geometry import Q_UNKNOWN

LEAST_SIDE = DARK_ROWS
"""Side of the smallest squares, cells. Their rows are those of a block, so a hole of 2 LEAST_SIDE - 1 rows is always found."""
_SIDES = 4
"""Number of sides: LEAST_SIDE times powers of two."""
_SIDE_CELLS = 3
"""Unknown cells of a block of a column that make it part of the hole in a block beside it."""
_EDGE_ROWS = 2 * LEAST_SIDE - 1
"""Greatest number of rows by which a hole extends above and below its squares: they begin and end with a block, and those of a round
hole do not reach its highest and lowest cells."""
_EACH = np.uint8(0xFF)
"""All bits."""
_BEYOND = LEAST_SIDE << (_SIDES - 1)
"""Cells beyond the border of the view that count as unknown."""


@inner
def fill_dark(unknown, out):
    """Finds blocks whose cells are all unknown.

    Args:
        unknown: (cols, blocks) uint8 of `unknown_of_blocks`.
        out: (cols + 2 _BEYOND, blocks + 2 _BEYOND / LEAST_SIDE) uint8 out, _EACH for such blocks and for those beyond
            the border, else 0."""
    cols, blocks = unknown.shape
    beyond = _BEYOND // LEAST_SIDE
    out[:] = _EACH
    for u in range(cols):
        column, line = unknown[u], out[u + _BEYOND, beyond : beyond + blocks]
        for b in range(blocks):
            line[b] = _EACH if column[b] == LEAST_SIDE else np.uint8(0)


@kernel
def find_holes(unknown):
    """Returns (cols, blocks) uint8: bit k is set where a block of LEAST_SIDE rows of a column lies in a square of unknown
    cells of side LEAST_SIDE << k. unknown: (cols, blocks) uint8 of `unknown_of_blocks`.

    Squares are marked at their first column and block. One of twice the side consists of four; in the opposite order,
    each square that was found is filled by four of half the side. The columns are searched as one line of blocks, in
    which a column is `line` blocks long: a square that runs from one column into the next lies in the blocks beyond the
    border."""
    cols, beyond = unknown.shape[0], _BEYOND // LEAST_SIDE
    line = unknown.shape[1] + 2 * beyond
    dark = np.empty((cols + 2 * _BEYOND, line), np.uint8)
    fill_dark(unknown, dark)
    blocks = dark.reshape(dark.size)
    n = len(blocks) - (LEAST_SIDE - 1) * line
    squares = np.empty((_SIDES, n), np.uint8)
    join_four(blocks, blocks[line:], blocks[2 * line :], blocks[3 * line :], squares[0])
    for k in range(1, _SIDES):
        across, down = (LEAST_SIDE << (k - 1)) * line, 1 << (k - 1)
        n -= across + down
        half = squares[k - 1]
        join_four(half, half[down:], half[across:], half[across + down :], squares[k, :n])
    found = squares[_SIDES - 1, :n] & np.uint8(1 << (_SIDES - 1))
    for k in range(_SIDES - 2, -1, -1):
        across, down = (LEAST_SIDE << k) * line, 1 << k
        n += across + down
        wider = np.zeros(n, np.uint8)
        add_marks(squares[k], np.uint8(1 << k), wider)
        for step in (0, down, across, across + down):
            add_marks(found, _EACH, wider[step:])
        found = wider
    holes = np.zeros((cols, line - 2 * beyond), np.uint8)
    for u in range(cols):
        for first in range(LEAST_SIDE):
            add_marks(found[(u + _BEYOND - first) * line + beyond :], _EACH, holes[u])
    return holes


@inner
def add_sides(unknown, holes):
    """Extends each hole along its rows over blocks of which at least 3 cells are unknown: at the sides of a round hole the columns are
    lower than the squares that it contains.

    Args:
        unknown: (cols, blocks) uint8 of `unknown_of_blocks`.
        holes: (cols, blocks) uint8 of `find_holes`, in and out."""
    cols = holes.shape[0]
    for u in range(1, cols):
        extend_column(holes[u - 1], unknown[u], holes[u])
    for u in range(cols - 2, -1, -1):
        extend_column(holes[u + 1], unknown[u], holes[u])


@inner_inline
def extend_column(beside, counts, column):
    """Adds the holes of the column beside to a column, where at least _SIDE_CELLS of a block's cells are unknown."""
    for b in range(len(column)):
        sides = beside[b]  # read unconditionally, see core/jit.py
        column[b] |= sides if counts[b] >= _SIDE_CELLS else np.uint8(0)


@inner_inline
def join_four(a, b, c, d, out):
    """out: what all four lines have."""
    for i in range(len(out)):
        out[i] = a[i] & b[i] & c[i] & d[i]


@inner_inline
def add_marks(marks, bits, out):
    """Adds these bits of marks to out, as far as that reaches."""
    for i in range(min(len(marks), len(out))):
        out[i] |= marks[i] & bits


@inner
def join_holes(codes, holes, columns, blocks, own, beside):
    """Joins the holes of the columns of (first, end).

    Args:
        codes: (cols, rows) uint16 of the view.
        holes: (cols, blocks) uint8 of `find_holes` and `add_sides`.
        columns: (first, end).
        blocks: (blocks,) uint8 scratch.
        own: (rows,) uint8 out, the holes of these columns.
        beside: (rows,) uint8 out, the holes of these columns and of one more on either side."""
    (u0, u1), cols = columns, holes.shape[0]
    own[:] = 0
    beside[:] = 0
    add_columns(codes[u0:u1], holes[u0:u1], blocks, own)
    add_marks(own, _EACH, beside)
    for first, end in ((max(u0 - 1, 0), u0), (u1, min(u1 + 1, cols))):
        add_columns(codes[first:end], holes[first:end], blocks, beside)


@inner
def add_columns(codes, holes, blocks, out):
    """Adds the holes of columns to the rows of their blocks, and to the rows of the unknown cells that connect with them above
    and below, at most _EDGE_ROWS.

    Args:
        codes, holes, blocks: see `join_holes`.
        out: (rows,) uint8, in and out."""
    rows = len(out)
    blocks[:] = 0
    for u in range(len(holes)):
        add_marks(holes[u], _EACH, blocks)
        line, upper, lower = codes[u], holes[u, :-1], holes[u, 1:]
        for b in range(len(upper)):
            if upper[b] == lower[b]:
                continue
            ends, begins, edge = upper[b] & ~lower[b], lower[b] & ~upper[b], (b + 1) * LEAST_SIDE
            for v in range(edge, min(edge + _EDGE_ROWS, rows) if ends else edge):
                if line[v] != Q_UNKNOWN:
                    break
                out[v] |= ends
            for v in range(edge - 1, max(edge - _EDGE_ROWS, 0) - 1 if begins else edge - 1, -1):
                if line[v] != Q_UNKNOWN:
                    break
                out[v] |= begins
    for v in range(rows):
        out[v] |= blocks[v // LEAST_SIDE]


@inner
def holds_hole(joined, v0, v1, least):
    """True if the rows v0..v1, as far as they lie in the view, hold a part of a hole of side LEAST_SIDE << least. joined: (rows,) uint8
    of `join_holes`."""
    sides = np.uint8(0)
    for v in range(max(v0, 0), min(v1 + 1, len(joined))):
        sides |= joined[v]
    return (sides >> least) & 1 != 0


@inner
def side_index(cells):
    """Returns the index of the side that is nearest to a number of cells, as a ratio."""
    index = 0
    while index < _SIDES - 1 and cells * cells > 2.0 * (LEAST_SIDE << index) * (LEAST_SIDE << index):
        index += 1
    return index

"""Holes of the levelled view: squares of unknown cells that are large enough to hide an object.

Input: the number of unknown cells of each block of the exact view. Output: for each column and block of rows the sides of the unknown squares
that contain it. Used by free_space.py.

What is nearer than the minimum range, and a surface without texture, leaves a hole in the image and no plane. The share
of unknown cells of a ring does not show it: a part of the hole that is small for the ring may be the edge of something
large. So holes are found in the whole image, before it is cut into directions and layers.

A hole counts by its width and height in pixels. Dropped pixels, and lines of them, are no hole: they fill no square. What
is narrower than the smallest square is narrower than what is found at all, see docs/reference/limits.md."""

from __future__ import annotations

import numpy as np

from ..jit import inner, inner_inline, kernel
from .free_cells import DARK_ROWS

LEAST_SIDE = DARK_ROWS
"""Side of the smallest squares, cells. Their rows are those of a block, so a hole of 2 LEAST_SIDE - 1 rows is always found."""
_SIDES = 4
"""Number of sides: LEAST_SIDE times powers of two."""
_EDGE_CELLS = 3
"""Unknown cells of a block of a column that make it part of the hole in a block beside it."""
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
def add_edges(unknown, holes):
    """Adds to each hole the blocks at its upper and lower edge of which at least 3 cells are unknown: the edge of a hole is known to a
    cell, and the blocks of a layer to DARK_ROWS of them.

    Args:
        unknown: (cols, blocks) uint8 of `unknown_of_blocks`.
        holes: (cols, blocks) uint8 of `find_holes`, in and out."""
    last = holes.shape[1] - 1
    for u in range(holes.shape[0]):
        column, counts, above = holes[u], unknown[u], np.uint8(0)
        for b in range(last + 1):
            here, below = column[b], column[b + 1] if b < last else np.uint8(0)
            column[b] = here | above | below if counts[b] >= _EDGE_CELLS else here
            above = here


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
    """Adds the holes of the column beside to a column, where at least _EDGE_CELLS of a block's cells are unknown."""
    for b in range(len(column)):
        column[b] |= beside[b] if counts[b] >= _EDGE_CELLS else np.uint8(0)


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
def join_holes(holes, columns, own, widened):
    """Joins the holes of the columns of (first, end).

    Args:
        holes: (cols, blocks) uint8 of `find_holes`.
        columns: (first, end).
        own: (blocks,) uint8 out, the holes of these columns.
        widened: (blocks,) uint8 out, the holes of a column more on either side and a block more above and below: the edge
            of an object is known to one pixel, and a hole to the block that it fills."""
    (u0, u1), last = columns, len(own) - 1
    own[:] = 0
    for u in range(u0, u1):
        column = holes[u]
        for b in range(last + 1):
            own[b] |= column[b]
    left, right = holes[max(u0 - 1, 0)], holes[min(u1, holes.shape[0] - 1)]
    before = np.uint8(0)
    for b in range(last + 1):
        here = own[b] | left[b] | right[b]
        widened[b] = here | before
        if b > 0:
            widened[b - 1] |= here
        before = here


@inner
def holds_hole(joined, v0, v1, least):
    """True if the rows v0..v1, rounded outward to blocks, hold a hole of side LEAST_SIDE << least. joined: (blocks,) uint8 of
    `join_holes`."""
    sides = np.uint8(0)
    for b in range(v0 // LEAST_SIDE, min(v1 // LEAST_SIDE + 1, len(joined))):
        sides |= joined[b]
    return (sides >> least) & 1 != 0


@inner
def side_index(cells):
    """Returns the index of the side that is nearest to a number of cells, as a ratio."""
    index = 0
    while index < _SIDES - 1 and cells * cells > 2.0 * (LEAST_SIDE << index) * (LEAST_SIDE << index):
        index += 1
    return index

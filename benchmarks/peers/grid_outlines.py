"""Outlines of the occupied cells of a grid, compiled: the polygons of the grid baseline before they are simplified."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Cells = NDArray[np.bool_]
STEPS = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]], np.int64)
"""Directions along the sides of cells in (x forward, y right): right, forward, left, back, each turning left from above."""


@njit(cache=True, nogil=True)
def _sides(occupied, onward):
    """Marks at each corner of the grid the directions in which an outline continues; returns the number of sides.

    onward: (X + 1, Y + 1) uint8, bit i: a side leads from there along STEPS[i], with the occupied cell on its left in
    the top view. The border of `occupied` (X, Y) must be free."""
    n = 0
    for x in range(1, occupied.shape[0] - 1):
        for y in range(1, occupied.shape[1] - 1):
            if occupied[x, y]:
                if not occupied[x - 1, y]:
                    onward[x, y] |= 1
                    n += 1
                if not occupied[x, y + 1]:
                    onward[x, y + 1] |= 2
                    n += 1
                if not occupied[x + 1, y]:
                    onward[x + 1, y + 1] |= 4
                    n += 1
                if not occupied[x, y - 1]:
                    onward[x + 1, y] |= 8
                    n += 1
    return n


@njit(cache=True, nogil=True)
def _trace(onward, steps, corners, first):
    """Follows all outlines -> corners (sides, 2), first[i] the first corner of outline i; returns outlines, corners.

    Where two cells touch by a corner the outline turns away from the cell just followed, so that both share one outline.
    """
    loops, n = 0, 0
    for x0 in range(onward.shape[0]):
        for y0 in range(onward.shape[1]):
            while onward[x0, y0]:
                first[loops] = n
                loops += 1
                x, y, heading = x0, y0, -1
                while True:
                    bits = onward[x, y]
                    way = -1
                    if heading >= 0:
                        # turning right first: right is one step back in STEPS
                        for turn in (3, 0, 1):
                            if bits >> ((heading + turn) & 3) & 1:
                                way = (heading + turn) & 3
                                break
                    else:
                        for i in range(4):
                            if bits >> i & 1:
                                way = i
                                break
                    onward[x, y] = bits & ~(np.uint8(1) << np.uint8(way))
                    if way != heading:
                        corners[n, 0], corners[n, 1] = x, y
                        n += 1
                    heading = way
                    x, y = x + steps[way, 0], y + steps[way, 1]
                    if x == x0 and y == y0:
                        break
    first[loops] = n
    return loops, n


def outlines(occupied: Cells) -> list[NDArray[np.int64]]:
    """Closed outlines (M, 2) of the occupied cells (X, Y), in cells, with the occupied side on the left seen from above
    (x forward, y right), corners only. Cells that touch by a corner belong together; the border must be free."""
    onward = np.zeros((occupied.shape[0] + 1, occupied.shape[1] + 1), np.uint8)
    sides = _sides(occupied, onward)
    corners, first = np.empty((sides, 2), np.int64), np.empty(sides + 1, np.int64)
    loops, _ = _trace(onward, STEPS, corners, first)
    return [corners[first[i] : first[i + 1]] for i in range(loops)]


@njit(cache=True, nogil=True)
def signed_area(loop):
    """Of a closed outline (M, 2): negative where it runs counter-clockwise seen from above, around occupied cells."""
    twice = 0.0
    for i in range(loop.shape[0]):
        j = i + 1 if i + 1 < loop.shape[0] else 0
        twice += loop[i, 0] * loop[j, 1] - loop[j, 0] * loop[i, 1]
    return 0.5 * twice

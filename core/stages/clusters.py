"""Section 4.4: which strips belong together because the vehicle cannot pass between them.

Algorithm 1 with its distance made whole: horizontal gap below Ws and vertical gap below Hs, to any strip of a cluster
instead of its last one; clusters that meet later join.
"""

from __future__ import annotations

import math

import numpy as np

from ..jit import inner
from .strips import BOTTOM, CLUSTER, TOP, D, U

# columns of the place table
X, Y, Z_TOP, Z_BOTTOM = range(4)
# columns of the table of groups: its cell, the next group of the bucket, its first and last strip
G_IX, G_IY, G_NEXT, G_FIRST, G_LAST = range(5)

CELL_PER_WS = 0.7
"""Side of a cell over Ws: below 1/sqrt(2), so that two strips of one cell are always closer than Ws. No tuning: it
changes the work, never the clusters."""
CELL_REACH = 2
"""Cells to either side that hold strips closer than Ws: the next integer above 1/CELL_PER_WS."""
BUCKETS = 4096
"""Chains into which cells are spread, a power of two: it changes the work, never the clusters."""


@inner
def place_strips(ints, floats, n, f, cu, lateral, tan_edge, place):
    """place: (N, 4) float32 x, y, top, bottom of each strip in level_cam, metres (Eq. 15)."""
    for i in range(n):
        x = f / floats[i, D]
        middle = (ints[i, TOP] + ints[i, BOTTOM]) // 2
        place[i, X] = x
        place[i, Y] = x * (ints[i, U] - cu) / f * lateral[middle]
        place[i, Z_TOP] = x * tan_edge[ints[i, TOP]]
        place[i, Z_BOTTOM] = x * tan_edge[ints[i, BOTTOM] + 1]


@inner
def root_of(parent, i):
    """Root of i in the union-find forest, halving the path."""
    for _ in range(i + 1):  # parents have lower numbers
        if parent[i] == i:
            break
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner
def join_near(ints, place, n, ws, hs, following, group_of, parent, groups, boxes, buckets):
    """Writes CLUSTER (numbered from 0 in order of first appearance); returns the number of clusters.

    place: see place_strips. ws, hs: horizontal and vertical gap, m, from which on the vehicle passes.

    The components of the graph of all pairs of strips closer than Ws across and Hs in height, without looking at all
    pairs: strips of one cell are closer than Ws anyhow, so that heights alone make groups of them; groups of cells in
    reach of each other are joined where a pair of their strips is close enough.
    Scratch: following, group_of, parent (N,) int32, groups (N, 5) int32, boxes (N, 6) float32,
    buckets (BUCKETS,) int32."""
    count = _group_cells(place, n, CELL_PER_WS * ws, hs, following, group_of, parent, groups, boxes, buckets)
    for g in range(count):
        if groups[g, G_FIRST] >= 0:
            _join_neighbours(place, g, ws, hs, following, parent, groups, boxes, buckets)
    return _number_clusters(ints, n, count, group_of, parent, groups)


@inner
def _bucket(ix, iy):
    """Where the chain of groups of a cell begins."""
    return (ix + 61 * iy) & (BUCKETS - 1)


@inner
def _group_cells(place, n, cell_m, hs, following, group_of, parent, groups, boxes, buckets):
    """Groups the strips of each cell by their heights: no step of Hs or more inside a group; returns how many it made.

    A group that a later strip joins to another one of its cell has no strips left (G_FIRST = -1) and a parent."""
    buckets[:] = -1
    count = 0
    for i in range(n):
        ix, iy = int(math.floor(place[i, X] / cell_m)), int(math.floor(place[i, Y] / cell_m))
        bucket = _bucket(ix, iy)
        following[i] = -1
        mine, before, g = -1, -1, buckets[bucket]
        for _ in range(count):
            if g < 0:
                break
            after = groups[g, G_NEXT]
            near = max(place[i, Z_TOP] - boxes[g, 5], boxes[g, 4] - place[i, Z_BOTTOM]) < hs
            if not near or groups[g, G_IX] != ix or groups[g, G_IY] != iy:
                before = g
            elif mine < 0:
                mine = before = g
                following[groups[g, G_LAST]] = i
                groups[g, G_LAST] = i
                _widen(
                    boxes[g], place[i, X], place[i, X], place[i, Y], place[i, Y], place[i, Z_TOP], place[i, Z_BOTTOM]
                )
            else:  # the strip lies between two groups of its cell
                groups[before, G_NEXT] = after
                _absorb(mine, g, following, parent, groups, boxes)
            g = after
        if mine < 0:
            mine = count
            count += 1
            parent[mine] = mine
            groups[mine, G_IX], groups[mine, G_IY], groups[mine, G_NEXT] = ix, iy, buckets[bucket]
            groups[mine, G_FIRST], groups[mine, G_LAST] = i, i
            buckets[bucket] = mine
            boxes[mine, 0], boxes[mine, 1] = place[i, X], place[i, X]
            boxes[mine, 2], boxes[mine, 3] = place[i, Y], place[i, Y]
            boxes[mine, 4], boxes[mine, 5] = place[i, Z_TOP], place[i, Z_BOTTOM]
        group_of[i] = mine
    return count


@inner
def _widen(box, x0, x1, y0, y1, z0, z1):
    """Takes a box into another."""
    box[0], box[1] = min(box[0], x0), max(box[1], x1)
    box[2], box[3] = min(box[2], y0), max(box[3], y1)
    box[4], box[5] = min(box[4], z0), max(box[5], z1)


@inner
def _absorb(g, h, following, parent, groups, boxes):
    """Takes the strips of group h into group g of the same cell."""
    _unite(parent, g, h)
    following[groups[g, G_LAST]] = groups[h, G_FIRST]
    groups[g, G_LAST] = groups[h, G_LAST]
    groups[h, G_FIRST] = -1
    b = boxes[h]
    _widen(boxes[g], b[0], b[1], b[2], b[3], b[4], b[5])


@inner
def _unite(parent, g, h):
    a, b = root_of(parent, g), root_of(parent, h)
    parent[max(a, b)] = min(a, b)


@inner
def _join_neighbours(place, g, ws, hs, following, parent, groups, boxes, buckets):
    """Joins group g with those of the half of the cells around it that come after it, where strips are close enough."""
    for dx in range(CELL_REACH + 1):
        for dy in range(-CELL_REACH if dx > 0 else 1, CELL_REACH + 1):
            ix, iy = groups[g, G_IX] + dx, groups[g, G_IY] + dy
            h = buckets[_bucket(ix, iy)]
            for _ in range(groups.shape[0]):
                if h < 0:
                    break
                apart = groups[h, G_IX] == ix and groups[h, G_IY] == iy and root_of(parent, g) != root_of(parent, h)
                if apart and _touch(place, g, h, ws, hs, following, groups, boxes):
                    _unite(parent, g, h)
                h = groups[h, G_NEXT]


@inner
def _apart(a, b):
    """Squared distance across of two boxes (x, x, y, y, top, bottom)."""
    dx = max(a[0] - b[1], b[0] - a[1], np.float32(0.0))
    dy = max(a[2] - b[3], b[2] - a[3], np.float32(0.0))
    return dx * dx + dy * dy


@inner
def _touch(place, g, h, ws, hs, following, groups, boxes):
    """Whether a strip of group g and one of group h are closer than Ws across and Hs in height."""
    b = boxes[h]
    if max(boxes[g, 4] - b[5], b[4] - boxes[g, 5]) >= hs or _apart(boxes[g], b) >= ws * ws:
        return False
    i = groups[g, G_FIRST]
    for _i in range(following.shape[0]):
        if i < 0:
            break
        x, y, top, bottom = place[i, X], place[i, Y], place[i, Z_TOP], place[i, Z_BOTTOM]
        dx = max(x - b[1], b[0] - x, np.float32(0.0))
        dy = max(y - b[3], b[2] - y, np.float32(0.0))
        if max(top - b[5], b[4] - bottom) < hs and dx * dx + dy * dy < ws * ws:
            j = groups[h, G_FIRST]
            for _j in range(following.shape[0]):
                if j < 0:
                    break
                dx, dy = x - place[j, X], y - place[j, Y]
                if dx * dx + dy * dy < ws * ws and max(top - place[j, Z_BOTTOM], place[j, Z_TOP] - bottom) < hs:
                    return True
                j = following[j]
        i = following[i]
    return False


@inner
def _number_clusters(ints, n, count, group_of, parent, groups):
    """Numbers the clusters 0, 1, ... in order of their first strip; returns how many there are."""
    for g in range(count):
        groups[g, G_NEXT] = -1  # from here on the number of the cluster
    clusters = 0
    for i in range(n):
        root = root_of(parent, group_of[i])
        if groups[root, G_NEXT] < 0:
            groups[root, G_NEXT] = clusters
            clusters += 1
        ints[i, CLUSTER] = groups[root, G_NEXT]
    return clusters

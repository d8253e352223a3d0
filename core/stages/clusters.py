"""Section 4.4: which strips belong together because the vehicle cannot pass between them.

Algorithm 1 with its distance made whole: horizontal gap below Ws and vertical gap below Hs, to any strip of a cluster
instead of its last one; clusters that meet later join.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, record

GROUP = record(
    ("ix", np.int32),
    ("iy", np.int32),
    ("next", np.int32),
    ("first", np.int32),
    ("last", np.int32),
    ("x0", np.float32),
    ("x1", np.float32),
    ("y0", np.float32),
    ("y1", np.float32),
    ("top", np.float32),
    ("bottom", np.float32),
)
"""Strips of one cell that are one cluster by their heights. ix, iy: the cell; next: the next group of the bucket, later the
number of the cluster; first, last: strips of the chain; x0 to bottom: the box around them, m."""

CELL_PER_WS = 0.7
"""Side of a cell over Ws: below 1/sqrt(2), so that two strips of one cell are always closer than Ws. No tuning: it
changes the work, never the clusters."""
CELL_REACH = 2
"""Cells to either side that hold strips closer than Ws: the next integer above 1/CELL_PER_WS."""
BUCKETS = 4096
"""Chains into which cells are spread, a power of two: it changes the work, never the clusters."""


class ClusterBuffers(NamedTuple):
    """Scratch of `join_near` for N strips: following, group_of, parent (N,) int32; groups (N,) GROUP; buckets (BUCKETS,)
    int32."""

    following: NDArray[np.int32]
    group_of: NDArray[np.int32]
    parent: NDArray[np.int32]
    groups: NDArray[Any]
    buckets: NDArray[np.int32]


def cluster_buffers(strips: int) -> ClusterBuffers:
    """Scratch for so many strips."""
    return ClusterBuffers(
        np.zeros(strips, np.int32),
        np.zeros(strips, np.int32),
        np.zeros(strips, np.int32),
        np.zeros(strips, GROUP),
        np.zeros(BUCKETS, np.int32),
    )


@inner
def place_strips(strips, n, view):
    """Writes the place of each strip in level_cam (Eq. 15)."""
    f, cu = view.f_px, view.cu
    for i in range(n):
        s = strips[i]
        x = f / s.disparity_px
        s.x_m = x
        s.y_m = x * (s.column - cu) / f * view.lateral[(s.top_row + s.bottom_row) // 2]
        s.top_m = x * view.tan_edge[s.top_row]
        s.bottom_m = x * view.tan_edge[s.bottom_row + 1]


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
def join_near(strips, n, ws, hs, buffers):
    """Writes `cluster` (numbered from 0 in order of first appearance); returns the number of clusters.

    strips: (N,) STRIP with places. ws, hs: horizontal and vertical gap, m, from which on the vehicle passes. buffers:
    ClusterBuffers.

    The components of the graph of all pairs of strips closer than Ws across and Hs in height, without looking at all
    pairs: strips of one cell are closer than Ws anyhow, so that heights alone make groups of them; groups of cells in
    reach of each other are joined where a pair of their strips is close enough."""
    count = _group_cells(strips, n, CELL_PER_WS * ws, hs, buffers)
    for g in range(count):
        if buffers.groups[g].first >= 0:
            _join_neighbours(strips, g, ws, hs, buffers)
    return _number_clusters(strips, n, count, buffers)


@inner
def _bucket(ix, iy):
    """Where the chain of groups of a cell begins."""
    return (ix + 61 * iy) & (BUCKETS - 1)


@inner
def _group_cells(strips, n, cell_m, hs, buffers):
    """Groups the strips of each cell by their heights: no step of Hs or more inside a group; returns how many it made.

    A group that a later strip joins to another one of its cell has no strips left (first = -1) and a parent."""
    following, groups, buckets = buffers.following, buffers.groups, buffers.buckets
    buckets[:] = -1
    count = 0
    for i in range(n):
        s = strips[i]
        ix, iy = int(math.floor(s.x_m / cell_m)), int(math.floor(s.y_m / cell_m))
        bucket = _bucket(ix, iy)
        following[i] = -1
        mine, before, g = -1, -1, buckets[bucket]
        for _ in range(count):
            if g < 0:
                break
            group = groups[g]
            after = group.next
            near = max(s.top_m - group.bottom, group.top - s.bottom_m) < hs
            if not near or group.ix != ix or group.iy != iy:
                before = g
            elif mine < 0:
                mine = before = g
                following[group.last] = i
                group.last = i
                _widen(group, s.x_m, s.x_m, s.y_m, s.y_m, s.top_m, s.bottom_m)
            else:  # the strip lies between two groups of its cell
                groups[before].next = after
                _absorb(mine, g, buffers)
            g = after
        if mine < 0:
            mine = count
            count += 1
            buffers.parent[mine] = mine
            new = groups[mine]
            new.ix, new.iy, new.next = ix, iy, buckets[bucket]
            new.first, new.last = i, i
            buckets[bucket] = mine
            new.x0, new.x1, new.y0, new.y1 = s.x_m, s.x_m, s.y_m, s.y_m
            new.top, new.bottom = s.top_m, s.bottom_m
        buffers.group_of[i] = mine
    return count


@inner
def _widen(group, x0, x1, y0, y1, top, bottom):
    """Takes a box into that of a group."""
    group.x0, group.x1 = min(group.x0, x0), max(group.x1, x1)
    group.y0, group.y1 = min(group.y0, y0), max(group.y1, y1)
    group.top, group.bottom = min(group.top, top), max(group.bottom, bottom)


@inner
def _absorb(g, h, buffers):
    """Takes the strips of group h into group g of the same cell."""
    a, b = buffers.groups[g], buffers.groups[h]
    _unite(buffers.parent, g, h)
    buffers.following[a.last] = b.first
    a.last = b.last
    b.first = -1
    _widen(a, b.x0, b.x1, b.y0, b.y1, b.top, b.bottom)


@inner
def _unite(parent, g, h):
    a, b = root_of(parent, g), root_of(parent, h)
    parent[max(a, b)] = min(a, b)


@inner
def _join_neighbours(strips, g, ws, hs, buffers):
    """Joins group g with those of the half of the cells around it that come after it, where strips are close enough."""
    groups, parent = buffers.groups, buffers.parent
    for dx in range(CELL_REACH + 1):
        for dy in range(-CELL_REACH if dx > 0 else 1, CELL_REACH + 1):
            ix, iy = groups[g].ix + dx, groups[g].iy + dy
            h = buffers.buckets[_bucket(ix, iy)]
            for _ in range(groups.shape[0]):
                if h < 0:
                    break
                apart = groups[h].ix == ix and groups[h].iy == iy and root_of(parent, g) != root_of(parent, h)
                if apart and _touch(strips, groups[g], groups[h], ws, hs, buffers.following):
                    _unite(parent, g, h)
                h = groups[h].next


@inner
def _touch(strips, g, h, ws, hs, following):
    """Whether a strip of group g and one of group h are closer than Ws across and Hs in height."""
    zero = np.float32(0.0)
    dx, dy = max(g.x0 - h.x1, h.x0 - g.x1, zero), max(g.y0 - h.y1, h.y0 - g.y1, zero)
    if max(g.top - h.bottom, h.top - g.bottom) >= hs or dx * dx + dy * dy >= ws * ws:
        return False
    i = g.first
    for _i in range(following.shape[0]):
        if i < 0:
            break
        s = strips[i]
        x, y, top, bottom = s.x_m, s.y_m, s.top_m, s.bottom_m
        dx, dy = max(x - h.x1, h.x0 - x, zero), max(y - h.y1, h.y0 - y, zero)
        if max(top - h.bottom, h.top - bottom) < hs and dx * dx + dy * dy < ws * ws:
            j = h.first
            for _j in range(following.shape[0]):
                if j < 0:
                    break
                other = strips[j]
                dx, dy = x - other.x_m, y - other.y_m
                if dx * dx + dy * dy < ws * ws and max(top - other.bottom_m, other.top_m - bottom) < hs:
                    return True
                j = following[j]
        i = following[i]
    return False


@inner
def _number_clusters(strips, n, count, buffers):
    """Numbers the clusters 0, 1, ... in order of their first strip; returns how many there are."""
    groups = buffers.groups
    for g in range(count):
        groups[g].next = -1  # from here on the number of the cluster
    clusters = 0
    for i in range(n):
        root = groups[root_of(buffers.parent, buffers.group_of[i])]
        if root.next < 0:
            root.next = clusters
            clusters += 1
        strips[i].cluster = root.next
    return clusters

"""Clusters of strips between which the vehicle cannot pass (Section 4.4, Algorithm 1).

Input: the table of strips with their places. Output: the cluster of each strip.

Algorithm 1 compares a strip with the last strip of each cluster. Here two strips belong to one cluster if their
horizontal gap is less than Ws and their vertical gap less than Hs, whichever strips of the cluster they are, and
clusters that meet are joined. The result does not depend on the order of the strips."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel, record
from ..union_find import root_of

GROUP = record(
    ("ix", np.int32),  # the cell
    ("iy", np.int32),
    ("next", np.int32),  # next group of the bucket; later the number of the cluster
    ("first", np.int32),  # first and last strip of the chain
    ("last", np.int32),
    ("x0", np.float32),  # box around the strips, m
    ("x1", np.float32),
    ("y0", np.float32),
    ("y1", np.float32),
    ("top", np.float32),
    ("bottom", np.float32),
)
"""Strips of one cell of the horizontal grid whose heights make them one cluster."""

CELL_PER_WS = 0.7
"""Side of a cell over Ws. It is less than 1/sqrt(2), so that two strips of one cell are always closer than Ws. It
affects the time only, not the clusters."""
CELL_REACH = 2
"""Number of cells to each side that may hold strips closer than Ws: the next integer above 1/CELL_PER_WS."""
BUCKETS = 4096
"""Number of hash buckets of the cells, a power of two. It affects the time only."""


class ClusterBuffers(NamedTuple):
    """Scratch memory of `join_near` for N strips."""

    following: Any  # (N,) int32, next strip of the same group
    group_of: Any  # (N,) int32, group of a strip
    parent: Any  # (N,) int32, union-find forest of the groups
    groups: Any  # (N,) GROUP
    buckets: Any  # (BUCKETS,) int32, first group of a bucket


@inner
def place_strips(strips, n, view):
    """Computes the place of each strip in level_cam (Eq. 15)."""
    f, cu = view.f_px, view.cu
    for i in range(n):
        s = strips[i]
        x = f / s.disparity_px
        s.x_m = x
        s.y_m = x * (s.column - cu) / f * view.lateral[(s.top_row + s.bottom_row) // 2]
        s.top_m = x * view.tan_edge[s.top_row]
        s.bottom_m = x * view.tan_edge[s.bottom_row + 1]


@kernel
def join_near(strips, n, ws, hs):
    """Sets `cluster` of each strip, numbered from 0 in the order of first appearance; returns the number of clusters.

    The clusters are the connected components of the graph of all pairs of strips closer than ws horizontally and hs
    vertically. Not all pairs are tested: two strips of one cell are always closer than ws, so that their heights
    alone form groups. Groups of cells within reach of each other are joined if one pair of their strips is close
    enough.
    strips: with places; ws, hs: horizontal and vertical gap that the vehicle can pass, m."""
    following, group_of, parent = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    buffers = ClusterBuffers(following, group_of, parent, np.empty(n, GROUP), np.full(BUCKETS, -1, np.int32))
    count = _group_cells(strips, n, CELL_PER_WS * ws, hs, buffers)
    for g in range(count):
        if buffers.groups[g].first >= 0:
            _join_neighbours(strips, g, ws, hs, buffers)
    return _number_clusters(strips, n, count, buffers)


@inner
def _bucket(ix, iy):
    """Returns the hash bucket of a cell."""
    return (ix + 61 * iy) & (BUCKETS - 1)


@inner
def _group_cells(strips, n, cell_m, hs, buffers):
    """Groups the strips of each cell so that no vertical gap within a group is hs or more; returns the number of
    groups.

    A group that is absorbed by another one of its cell has no strips left (first = -1) and a parent."""
    following, groups, buckets = buffers.following, buffers.groups, buffers.buckets
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
            else:  # the strip connects two groups of its cell
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
    """Extends the box of a group by another box."""
    group.x0, group.x1 = min(group.x0, x0), max(group.x1, x1)
    group.y0, group.y1 = min(group.y0, y0), max(group.y1, y1)
    group.top, group.bottom = min(group.top, top), max(group.bottom, bottom)


@inner
def _absorb(g, h, buffers):
    """Moves the strips of group h into group g of the same cell."""
    a, b = buffers.groups[g], buffers.groups[h]
    _unite(buffers.parent, g, h)
    buffers.following[a.last] = b.first
    a.last = b.last
    b.first = -1
    _widen(a, b.x0, b.x1, b.y0, b.y1, b.top, b.bottom)


@inner
def _unite(parent, g, h):
    """Joins the components of two groups. The root is the group of the lower number."""
    a, b = root_of(parent, g), root_of(parent, h)
    parent[max(a, b)] = min(a, b)


@inner
def _join_neighbours(strips, g, ws, hs, buffers):
    """Joins group g with groups of neighbouring cells that have a strip close enough.

    Only the half of the cells that comes after the cell of g is searched; the other half is searched from there."""
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
    """True if a strip of group g and one of group h are closer than ws horizontally and hs vertically."""
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
    """Numbers the clusters 0, 1, ... in the order of their first strip; returns their number."""
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

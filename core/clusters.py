"""Section 4.4: which strips belong together because the vehicle cannot pass between them.

Algorithm 1 with its distance made whole: horizontal gap below Ws and vertical gap below Hs. Only the frontier, the
last strips of each cluster that can still be reached, is looked at; clusters that meet later join.
"""

from __future__ import annotations

import math

from numba import njit

from .strips import BOTTOM, CLUSTER, TOP, D, U

# columns of the place table
X, Y, Z_TOP, Z_BOTTOM = range(4)


@njit(cache=True, nogil=True)
def place_strips(ints, floats, n, f, cu, lateral, tan_edge, place):
    """place: (N, 4) float32 x, y, top, bottom of each strip in level_cam, metres (Eq. 15)."""
    for i in range(n):
        x = f / floats[i, D]
        middle = (ints[i, TOP] + ints[i, BOTTOM]) // 2
        place[i, X] = x
        place[i, Y] = x * (ints[i, U] - cu) / f * lateral[middle]
        place[i, Z_TOP] = x * tan_edge[ints[i, TOP]]
        place[i, Z_BOTTOM] = x * tan_edge[ints[i, BOTTOM] + 1]


@njit(cache=True, nogil=True)
def root_of(parent, i):
    """Root of i in the union-find forest, halving the path."""
    for _ in range(i + 1):  # parents have lower numbers
        if parent[i] == i:
            break
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def cluster_strips(
    ints, place, n, ws, hs, column_m_per_x, tan_limit, near_share, cover_share, cover_m, parent, frontier
):  # fmt: skip
    """Writes CLUSTER (numbered from 0 in order of first appearance); returns the number of clusters.

    place: see place_strips. column_m_per_x: width of one column at 1 m. tan_limit: the largest tangent of azimuth of the
    view. near_share (of Ws), cover_share, cover_m: what a later strip may stand for, see `covers`.
    parent, frontier: (N,) int32 scratch."""
    size = 0
    near = (near_share * ws) ** 2
    beyond = ws * math.sqrt(1.0 + tan_limit * tan_limit)
    for i in range(n):
        parent[i] = i
        root = i
        u = ints[i, U]
        kept = 0
        for k in range(size):
            j = frontier[k]
            # a ray passes x * (t - t_j) / sqrt(1 + t^2) beside it: no later column comes within Ws of it any more
            if (u - ints[j, U] - 1) * column_m_per_x * place[j, X] > beyond:
                continue
            vertical = max(place[i, Z_TOP] - place[j, Z_BOTTOM], place[j, Z_TOP] - place[i, Z_BOTTOM])
            apart = (place[i, X] - place[j, X]) ** 2 + (place[i, Y] - place[j, Y]) ** 2
            if vertical < hs and apart < ws * ws:
                other = root_of(parent, j)
                if other != root:
                    parent[max(root, other)] = min(root, other)
                    root = min(root, other)
                # what a later strip close by reaches past on both ends need not be kept: that one stands for it
                if apart < near and ints[j, U] < u and covers(place, i, j, cover_share, cover_m):
                    continue
            frontier[kept] = j
            kept += 1
        frontier[kept] = i
        size = kept + 1
    return number_clusters(ints, parent, n)


@njit(cache=True, nogil=True)
def covers(place, i, j, share, least_m):
    """Whether strip i reaches at least as high and as low as strip j, give or take a share of its height and least_m."""
    slack = share * (place[j, Z_BOTTOM] - place[j, Z_TOP]) + least_m
    return place[i, Z_TOP] <= place[j, Z_TOP] + slack and place[i, Z_BOTTOM] >= place[j, Z_BOTTOM] - slack


@njit(cache=True, nogil=True)
def number_clusters(ints, parent, n):
    """Numbers the roots 0, 1, ... in order of their first strip; returns how many there are."""
    count = 0
    for i in range(n):
        r = root_of(parent, i)
        if r == i:
            ints[i, CLUSTER] = count
            count += 1
        else:
            ints[i, CLUSTER] = ints[r, CLUSTER]
    return count


@njit(cache=True, nogil=True)
def cluster_paper(ints, place, n, ws, last_of_cluster):
    """Algorithm 1 as printed: distance to the last strip of each cluster, nearest below Ws takes it; returns the count.

    last_of_cluster: (N,) int32 scratch. The gap counts no height. Clusters that meet later stay apart."""
    count = 0
    for i in range(n):
        best, nearest = -1, ws
        for c in range(count):
            j = last_of_cluster[c]
            gap = math.hypot(place[i, X] - place[j, X], place[i, Y] - place[j, Y])
            if gap < nearest:
                best, nearest = c, gap
        if best < 0:
            best = count
            count += 1
        ints[i, CLUSTER] = best
        last_of_cluster[best] = i
    return count

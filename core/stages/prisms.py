"""Section 3, Figure 2: connected planes cut into layers, each layer a side profile of polygons.

One view sees front faces only, so profiles are open sheets (`closed = False`); they close as views come together. Where
layers would take more room than the planes' own heights, each run of planes with the same heights is a prism.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from .prism_table import NO_PRISMS, PrismTable

AX, AY, BX, BY, TOP, BOTTOM = range(6)


@kernel
def join_heights(heights, join_m, out):
    """out: each height replaced by the least of its group, a group spanning at most join_m from its least member up."""
    least = -np.inf
    for k in np.argsort(heights, kind="mergesort"):
        if heights[k] - least > join_m:
            least = heights[k]
        out[k] = least


@inner
def meet(p, q, end_m):
    """Whether the right end of plane p is the left end of plane q."""
    return abs(p[BX] - q[AX]) < end_m and abs(p[BY] - q[AY]) < end_m


@kernel
def connect(planes, end_m, component):
    """component (N,) int64 out: the least number of the planes connected with each: ends meet and heights overlap.

    Only such planes share a profile; cutting one at another's height would add edges and say nothing."""
    n = planes.shape[0]
    left = np.empty(n, np.float64)
    for k in range(n):
        component[k] = k
        left[k] = planes[k, AY] / planes[k, AX]
    order = np.argsort(left, kind="mergesort")
    left = left[order]
    for k in range(n):
        p = planes[k]
        t = p[BY] / p[BX]
        slack = end_m * (1.0 + abs(t)) / max(p[BX] - end_m, end_m)
        first = np.searchsorted(left, t - slack)
        for m in range(first, n):
            if left[m] > t + slack:
                break
            q = planes[order[m]]
            if meet(p, q, end_m) and min(p[BOTTOM], q[BOTTOM]) > max(p[TOP], q[TOP]):
                a, b = _root(component, k), _root(component, order[m])
                component[max(a, b)] = min(a, b)
    for k in range(n):
        component[k] = _root(component, k)


@inner
def _root(component, k):
    for _ in range(component.shape[0]):
        if component[k] == k:
            break
        component[k] = component[component[k]]
        k = component[k]
    return k


@inner
def same_planes(first, last, a, b):
    """Whether layers a and b of a group are reached by the same planes."""
    others = 0
    for k in range(first.shape[0]):
        others += (first[k] <= a < last[k]) != (first[k] <= b < last[k])
    return others == 0


@inner
def write_layers(planes, members, cuts, first, last, end_m, size, edges, heights, starts, plane_of):
    """Adds the profiles of each layer of a connected group to the tables; returns (prisms, edges).

    Neighbouring layers with the same planes are one. members: in order from left to right; first, last: index of each
    one's top and bottom among the cuts. Writes nothing where the tables are full."""
    begin = 0
    for layer in range(cuts.shape[0] - 1):
        if layer + 2 < cuts.shape[0] and same_planes(first, last, layer, layer + 1):
            continue
        before = -1
        for k in range(members.shape[0]):
            if not first[k] <= layer < last[k]:
                continue
            if before < 0 or not meet(planes[before], planes[members[k]], end_m):
                size = _begin(size, edges, cuts[begin], cuts[layer + 1], heights, starts)
            before = members[k]
            edges = _add(edges, before, plane_of)
        begin = layer + 1
    return size, edges


@inner
def write_runs(planes, members, cuts, first, last, end_m, size, edges, heights, starts, plane_of):
    """Adds runs of meeting planes of the same heights to the tables; returns (prisms, edges)."""
    before = -1
    for k in range(members.shape[0]):
        goes_on = before >= 0 and first[before] == first[k] and last[before] == last[k]
        if not goes_on or not meet(planes[members[before]], planes[members[k]], end_m):
            size = _begin(size, edges, cuts[first[k]], cuts[last[k]], heights, starts)
        before = k
        edges = _add(edges, members[k], plane_of)
    return size, edges


@inner
def _begin(size, edges, top, bottom, heights, starts):
    if size < heights.shape[0]:
        heights[size, 0], heights[size, 1], starts[size] = top, bottom, edges
    return size + 1


@inner
def _add(edges, plane, plane_of):
    if edges < plane_of.shape[0]:
        plane_of[edges] = plane
    return edges + 1


@kernel
def cut_into_prisms(planes, join_m, end_m, heights, starts, plane_of):
    """(prisms, edges) of planes (N, 6) float32. heights (M, 2) float32, starts (M,) and plane_of (E,) int32: tables of
    prisms, out: top and bottom, first edge, plane of each edge.

    Tops closer than join_m become the highest of them, bottoms the lowest: z is down, so both only ever grow a plane. A
    group is written as layers or as runs, whichever takes fewer vertices and prisms; a group of n planes never takes
    more than n prisms and n edges."""
    n = planes.shape[0]
    component = np.empty(n, np.int64)
    connect(planes, end_m, component)
    turn = np.empty(n, np.float64)
    for k in range(n):
        turn[k] = math.atan2(planes[k, AY] + planes[k, BY], planes[k, AX] + planes[k, BX])
    order = np.argsort(turn, kind="mergesort")
    order = order[np.argsort(component[order], kind="mergesort")]
    size, edges, a = 0, 0, 0
    for b in range(1, n + 1):
        if b < n and component[order[b]] == component[order[a]]:
            continue
        members = order[a:b]
        a = b
        tops, bottoms = np.empty(members.shape[0], np.float32), np.empty(members.shape[0], np.float32)
        join_heights(planes[members, TOP], join_m, tops)
        join_heights(-planes[members, BOTTOM], join_m, bottoms)
        bottoms = -bottoms
        cuts = np.unique(np.concatenate((tops, bottoms)))
        first, last = np.searchsorted(cuts, tops), np.searchsorted(cuts, bottoms)
        runs = write_runs(planes, members, cuts, first, last, end_m, size, edges, heights, starts, plane_of)
        if members.shape[0] > 1:
            room = 2 * (runs[0] - size) + runs[1] - edges
            free = heights[heights.shape[0] :], starts[starts.shape[0] :], plane_of[plane_of.shape[0] :]
            layers = write_layers(planes, members, cuts, first, last, end_m, size, edges, *free)
            if 2 * (layers[0] - size) + layers[1] - edges < room:
                runs = write_layers(planes, members, cuts, first, last, end_m, size, edges, heights, starts, plane_of)
        size, edges = runs
    return size, edges


@inner
def draw_profiles(planes, margin_m, cluster, starts, plane_of, vertices, margins, clusters, begins):
    """Vertices (V, 2), greatest margin (N,), cluster (N,) and first vertex (N + 1,) of each of N prisms, out: one vertex
    before its edges, the left end of its first plane, and the right end of each."""
    at = 0
    for k in range(margins.shape[0]):
        first = plane_of[starts[k]]
        clusters[k], begins[k] = cluster[first], at
        vertices[at, 0], vertices[at, 1] = planes[first, AX], planes[first, AY]
        at += 1
        most = margin_m[first]
        for edge in range(starts[k], starts[k + 1]):
            p = plane_of[edge]
            vertices[at, 0], vertices[at, 1] = planes[p, BX], planes[p, BY]
            at += 1
            most = max(most, margin_m[p])
        margins[k] = most
    begins[margins.shape[0]] = at


@kernel
def write_prisms(
    planes, margin_m, cluster, join_m, end_m, heights, starts, plane_of, vertices, margins, clusters, begins
):  # fmt: skip
    """(prisms, edges): tables of both by `cut_into_prisms` and `draw_profiles`, out, with room for all."""
    size, edges = cut_into_prisms(planes, join_m, end_m, heights, starts[:-1], plane_of)
    starts[size] = edges
    draw_profiles(planes, margin_m, cluster, starts, plane_of, vertices, margins[:size], clusters, begins)
    return size, edges


def layered_prisms(
    planes: NDArray[np.float32], margin_m: NDArray[np.float32], cluster: NDArray[np.int32], join_m: float, end_m: float
) -> PrismTable:
    """The multi-layer prisms of a frame. planes: (N, 6) as in FrameModel; every plane stands in each layer it reaches.

    join_m: heights closer than this are one cut; end_m: ends closer than this are one vertex."""
    n = len(planes)
    if not n:
        return NO_PRISMS
    room = 3 * n
    heights, vertices = np.empty((room, 2), np.float32), np.empty((2 * room, 2), np.float32)
    starts, plane_of, begins = np.empty(room + 1, np.int32), np.empty(room, np.int32), np.empty(room + 1, np.int32)
    margins, clusters = np.empty(room, np.float32), np.empty(room, np.int32)
    size, edges = write_prisms(
        planes, margin_m, cluster, join_m, end_m, heights, starts, plane_of, vertices, margins, clusters, begins
    )
    return PrismTable.written(
        clusters[:size], heights[:size], np.zeros(size, bool), margins[:size], begins[: size + 1], starts[: size + 1],
        vertices[: edges + size], plane_of[:edges],
    )  # fmt: skip

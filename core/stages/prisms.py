"""Section 3, Figure 2: connected planes cut into layers, each layer a side profile of polygons.

One view sees front faces only, so profiles are open sheets (`closed = False`); they close as views come together. Where
layers would take more room than the planes' own heights, each run of planes with the same heights is a prism.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from .prism_table import NO_PRISMS, PrismTable

AX, AY, BX, BY, TOP, BOTTOM = range(6)
"""Columns of the planes of a FrameModel, which are a plain float32 table."""


class Group(NamedTuple):
    """A connected group of planes: members in order from left to right, the cuts between layers, index of each one's top and
    bottom among the cuts."""

    members: Any
    cuts: Any
    first: Any
    last: Any


class Profiles(NamedTuple):
    """Tables of prisms, out: heights (M, 2) float32 top and bottom, starts (M,) int32 first edge, plane_of (E,) int32 the
    plane of each edge. Nothing is written where they are full."""

    heights: Any
    starts: Any
    plane_of: Any


class Outlines(NamedTuple):
    """Tables of the same prisms, out: vertices (V, 2) float32, greatest margin (M,) float32, cluster (M,) and first vertex
    (M + 1,) int32."""

    vertices: Any
    margins: Any
    clusters: Any
    begins: Any


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
def write_layers(planes, group, end_m, size, edges, out):
    """Adds the profiles of each layer of a connected group to the tables; returns (prisms, edges).

    Neighbouring layers with the same planes are one. group: Group; out: Profiles."""
    members, cuts, first, last = group.members, group.cuts, group.first, group.last
    begin = 0
    for layer in range(cuts.shape[0] - 1):
        if layer + 2 < cuts.shape[0] and same_planes(first, last, layer, layer + 1):
            continue
        before = -1
        for k in range(members.shape[0]):
            if not first[k] <= layer < last[k]:
                continue
            if before < 0 or not meet(planes[before], planes[members[k]], end_m):
                size = _begin(size, edges, cuts[begin], cuts[layer + 1], out)
            before = members[k]
            edges = _add(edges, before, out)
        begin = layer + 1
    return size, edges


@inner
def write_runs(planes, group, end_m, size, edges, out):
    """Adds runs of meeting planes of the same heights to the tables; returns (prisms, edges). group: Group; out: Profiles."""
    members, cuts, first, last = group.members, group.cuts, group.first, group.last
    before = -1
    for k in range(members.shape[0]):
        goes_on = before >= 0 and first[before] == first[k] and last[before] == last[k]
        if not goes_on or not meet(planes[members[before]], planes[members[k]], end_m):
            size = _begin(size, edges, cuts[first[k]], cuts[last[k]], out)
        before = k
        edges = _add(edges, members[k], out)
    return size, edges


@inner
def _begin(size, edges, top, bottom, out):
    if size < out.heights.shape[0]:
        out.heights[size, 0], out.heights[size, 1], out.starts[size] = top, bottom, edges
    return size + 1


@inner
def _add(edges, plane, out):
    if edges < out.plane_of.shape[0]:
        out.plane_of[edges] = plane
    return edges + 1


@kernel
def cut_into_prisms(planes, join_m, end_m, out):
    """(prisms, edges) of planes (N, 6) float32. out: Profiles.

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
        group = Group(members, cuts, first, last)
        runs = write_runs(planes, group, end_m, size, edges, out)
        if members.shape[0] > 1:
            room = 2 * (runs[0] - size) + runs[1] - edges
            heights, starts, plane_of = out.heights, out.starts, out.plane_of
            none = Profiles(heights[heights.shape[0] :], starts[starts.shape[0] :], plane_of[plane_of.shape[0] :])
            layers = write_layers(planes, group, end_m, size, edges, none)
            if 2 * (layers[0] - size) + layers[1] - edges < room:
                runs = write_layers(planes, group, end_m, size, edges, out)
        size, edges = runs
    return size, edges


@inner
def draw_profiles(count, planes, margin_m, cluster, profiles, out):
    """Fills Outlines of `count` prisms: one vertex before its edges, the left end of its first plane, and the right end of
    each. profiles: Profiles."""
    starts, plane_of, vertices, margins = profiles.starts, profiles.plane_of, out.vertices, out.margins
    at = 0
    for k in range(count):
        first = plane_of[starts[k]]
        out.clusters[k], out.begins[k] = cluster[first], at
        vertices[at, 0], vertices[at, 1] = planes[first, AX], planes[first, AY]
        at += 1
        most = margin_m[first]
        for edge in range(starts[k], starts[k + 1]):
            p = plane_of[edge]
            vertices[at, 0], vertices[at, 1] = planes[p, BX], planes[p, BY]
            at += 1
            most = max(most, margin_m[p])
        margins[k] = most
    out.begins[count] = at


@kernel
def write_prisms(planes, margin_m, cluster, join_m, end_m, profiles, outlines):
    """(prisms, edges): `cut_into_prisms` and `draw_profiles`. profiles, outlines: out, with room for all, and one start more."""
    starts = profiles.starts
    size, edges = cut_into_prisms(planes, join_m, end_m, Profiles(profiles.heights, starts[:-1], profiles.plane_of))
    starts[size] = edges
    draw_profiles(size, planes, margin_m, cluster, profiles, outlines)
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
    profiles, outlines = Profiles(heights, starts, plane_of), Outlines(vertices, margins, clusters, begins)
    size, edges = write_prisms(planes, margin_m, cluster, join_m, end_m, profiles, outlines)
    return PrismTable.from_trusted(
        cluster=clusters[:size],
        heights_m=heights[:size],
        closed=np.zeros(size, bool),
        margin_m=margins[:size],
        vertex_begin=begins[: size + 1],
        edge_begin=starts[: size + 1],
        vertices_m=vertices[: edges + size],
        plane=plane_of[:edges],
    )

"""Multi-layer prisms (Section 3, Figure 2): connected planes cut into layers of height, each with polygonal profiles.

Input: the published planes. Output: `PrismTable`. One view contains front faces only, so that profiles are open
(`closed = False`). Where layers would need more vertices and prisms than the planes with their own heights, each run
of planes of the same heights is a prism."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from ..union_find import root_of
from .prism_table import NO_PRISMS, PrismTable

AX, AY, BX, BY, TOP, BOTTOM = range(6)
"""Columns of the planes of a FrameModel, a float32 table."""


class Group(NamedTuple):
    """A connected group of K planes."""

    members: Any  # (K,) planes from left to right
    cuts: Any  # heights at which the layers are separated
    first: Any  # (K,) index of the top of each plane in `cuts`
    last: Any  # (K,) index of the bottom of each plane in `cuts`


class Profiles(NamedTuple):
    """Output tables of M prisms with E edges. Nothing is written beyond their size."""

    heights: Any  # (M, 2) float32 top and bottom
    starts: Any  # (M,) int32 first edge of a prism
    plane_of: Any  # (E,) int32 plane of an edge


@kernel
def join_heights(heights, join_m, out):
    """Replaces each height by the least one of its group: out. A group spans at most join_m."""
    least = -np.inf
    for k in np.argsort(heights, kind="mergesort"):
        if heights[k] - least > join_m:
            least = heights[k]
        out[k] = least


@inner
def meet(p, q, end_m):
    """True if the right end of plane p is the left end of plane q."""
    return abs(p[BX] - q[AX]) < end_m and abs(p[BY] - q[AY]) < end_m


@kernel
def connect(planes, end_m, component):
    """Computes the connected groups of planes: those whose ends meet and whose heights overlap.

    Only such planes share a profile. Cutting a plane at the height of another one would add edges without
    information.

    Args:
        planes: (N, 6) float32.
        end_m: ends closer than this meet.
        component: (N,) int64 out, the least index of the planes connected with each."""
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
                a, b = root_of(component, k), root_of(component, order[m])
                component[max(a, b)] = min(a, b)
    for k in range(n):
        component[k] = root_of(component, k)


@inner
def same_planes(first, last, a, b):
    """True if the same planes of a group extend into the layers a and b."""
    others = 0
    for k in range(first.shape[0]):
        others += (first[k] <= a < last[k]) != (first[k] <= b < last[k])
    return others == 0


@inner
def write_layers(planes, group, end_m, size, edges, out):
    """Appends the profiles of each layer of a group to the tables; returns (prisms, edges).

    Neighbouring layers with the same planes are joined. group: Group; out: Profiles."""
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
    """Appends runs of meeting planes of the same heights to the tables; returns (prisms, edges). group: Group; out:
    Profiles."""
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
    """Appends a prism; returns the number of prisms."""
    if size < out.heights.shape[0]:
        out.heights[size, 0], out.heights[size, 1], out.starts[size] = top, bottom, edges
    return size + 1


@inner
def _add(edges, plane, out):
    """Appends an edge; returns the number of edges."""
    if edges < out.plane_of.shape[0]:
        out.plane_of[edges] = plane
    return edges + 1


@kernel
def cut_into_prisms(planes, join_m, end_m, out):
    """Makes prisms of planes, (N, 6) float32; returns (prisms, edges). out: Profiles.

    Tops closer than join_m become the highest of them, bottoms the lowest, so that planes only grow. A group is
    written as layers or as runs, whichever needs fewer vertices and prisms. A group of n planes has at most n prisms
    and n edges."""
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
        layers = write_layers(planes, group, end_m, size, edges, out)
        found = write_runs(planes, group, end_m, size, edges, out)
        if 2 * layers[0] + layers[1] < 2 * found[0] + found[1]:
            found = write_layers(planes, group, end_m, size, edges, out)
        size, edges = found
    return size, edges


@kernel
def write_prisms(planes, margin_m, cluster, join_m, end_m):
    """Returns cluster, heights_m, margin_m, vertex_begin, edge_begin, vertices_m and plane of PrismTable. The vertices of
    a prism are the left end of its first plane, then the right end of each plane."""
    room = 3 * len(planes)
    heights, starts, plane_of = np.empty((room, 2), np.float32), np.empty(room + 1, np.int32), np.empty(room, np.int32)
    size, edges = cut_into_prisms(planes, join_m, end_m, Profiles(heights, starts, plane_of))
    starts[size] = edges
    vertices, begins = np.empty((edges + size, 2), np.float32), np.empty(size + 1, np.int32)
    margins, clusters = np.empty(size, np.float32), np.empty(size, np.int32)
    at = 0
    for k in range(size):
        first = plane_of[starts[k]]
        clusters[k], begins[k], margins[k] = cluster[first], at, margin_m[first]
        vertices[at, 0], vertices[at, 1] = planes[first, AX], planes[first, AY]
        at += 1
        for edge in range(starts[k], starts[k + 1]):
            p = plane_of[edge]
            vertices[at, 0], vertices[at, 1] = planes[p, BX], planes[p, BY]
            at += 1
            margins[k] = max(margins[k], margin_m[p])
    begins[size] = at
    return clusters, heights[:size], margins, begins, starts[: size + 1], vertices, plane_of[:edges]


def layered_prisms(
    planes: NDArray[np.float32], margin_m: NDArray[np.float32], cluster: NDArray[np.int32], join_m: float, end_m: float
) -> PrismTable:
    """Returns the multi-layer prisms of a frame. Each plane is part of each layer into which it extends.

    Args:
        planes: (N, 6) float32 as in FrameModel.
        margin_m: (N,) float32.
        cluster: (N,) int32.
        join_m: heights closer than this are one cut.
        end_m: ends closer than this are one vertex."""
    if not len(planes):
        return NO_PRISMS
    clusters, heights, margins, begins, starts, vertices, plane_of = write_prisms(
        planes, margin_m, cluster, join_m, end_m
    )
    return PrismTable(
        cluster=clusters,
        heights_m=heights,
        closed=np.zeros(len(clusters), bool),
        margin_m=margins,
        vertex_begin=begins,
        edge_begin=starts,
        vertices_m=vertices,
        plane=plane_of,
    )

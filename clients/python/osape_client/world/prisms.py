"""The world's planes as layered prisms: side profiles that close are solid, others are open sheets.

Planes that follow each other around corners (corners.py) make a chain; walking along it free space is on the right, so
a chain that comes back to its beginning the other way round than the clock, seen from above, encloses what it stands for. A profile that runs the other way round
encloses free space (a courtyard), one that crosses itself is no profile: both stay open.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..model import Prism
from .corners import NONE, encloses, followers

Floats = NDArray[np.float64]
LAYER_JOIN_M = 0.25
"""Tops or bottoms closer than this are one cut (Params.layer_join_m)."""


def world_prisms(
    planes: NDArray[np.float32], margin_m: NDArray[np.float32], hits: NDArray[np.int32] | None = None
) -> tuple[Prism, ...]:
    """The prisms of a world's planes, hits: observations of each; each plane stands in every layer of its chain that it reaches into."""
    rows = planes.astype(np.float64)
    found: list[Prism] = []
    around = followers(rows, hits)
    for number, (members, ring) in enumerate(_chains(around.after)):
        tops, bottoms = _joined(rows[members, 4]), -_joined(-rows[members, 5])
        cuts = np.unique(np.concatenate([tops, bottoms]))
        layers: list[tuple[float, float, list[tuple[bool, list[int]]]]] = []
        for top, bottom in pairwise(cuts.tolist()):
            runs = _runs((tops <= top) & (bottoms >= bottom), ring)
            if layers and layers[-1][2] == runs:  # the same planes: one layer
                layers[-1] = (layers[-1][0], bottom, runs)
            else:
                layers.append((top, bottom, runs))
        for top, bottom, runs in layers:
            found += _layer(number, top, bottom, runs, members, rows, around.corner, margin_m)
    return tuple(found)


def _chains(after: NDArray[np.int32]) -> list[tuple[NDArray[np.int64], bool]]:
    """(planes in order, whether the last leads to the first) of each chain."""
    seen, out = np.zeros(len(after), bool), []
    heads = np.setdiff1d(np.arange(len(after)), after[after >= 0])
    for begin in [*heads.tolist(), *range(len(after))]:  # what is left then has no head: rings
        members, k = [], begin
        while k != NONE and not seen[k]:
            seen[k] = True
            members.append(k)
            k = int(after[k])
        if members:
            out.append((np.array(members), k == begin))
    return out


def _joined(heights: Floats) -> Floats:
    """Each height replaced by the least of its group; a group spans at most LAYER_JOIN_M from its least member up."""
    out, least = heights.copy(), -np.inf
    for k in np.argsort(heights, kind="stable"):
        if heights[k] - least > LAYER_JOIN_M:
            least = float(heights[k])
        out[k] = least
    return out


def _runs(on: NDArray[np.bool_], ring: bool) -> list[tuple[bool, list[int]]]:
    """(closed, places in the chain) of each run of planes that reach into a layer."""
    n = len(on)
    if ring and on.all():
        return [(True, list(range(n)))]
    begin = int(np.argmin(on)) if ring else 0  # a ring is opened where a plane is missing
    out: list[tuple[bool, list[int]]] = []
    going = False
    for k in ((begin + m) % n for m in range(n)):
        if not on[k]:
            going = False
        elif going:
            out[-1][1].append(k)
        else:
            out.append((False, [k]))
            going = True
    return out


def _layer(
    number: int,
    top: float,
    bottom: float,
    runs: list[tuple[bool, list[int]]],
    members: NDArray[np.int64],
    planes: Floats,
    corner: Floats,
    margin_m: NDArray[np.float32],
) -> list[Prism]:
    out = []
    for ring, places in runs:
        mine = members[places]
        closed = ring and encloses(corner[mine])
        last = corner[mine[-1:]] if ring else planes[mine[-1:], 2:4]
        begin = last if ring else planes[mine[:1], 0:2]
        vertices = np.concatenate([begin, corner[mine[:-1]], last])
        out.append(
            Prism(
                cluster=number,
                top_m=top,
                bottom_m=bottom,
                closed=closed,
                margin_m=float(margin_m[mine].max()),
                vertices_m=(vertices[1:] if closed else vertices).astype(np.float32),
                plane=(np.roll(mine, -1) if closed else mine).astype(np.int32),
            )
        )
    return out


def inside(solid: Prism, points: Floats, grow_m: float = 0.0) -> NDArray[np.bool_]:
    """(M,) whether points (M, 3) lie within a closed prism, its top and bottom grown by so much."""
    v = solid.vertices_m.astype(np.float64)
    within = (points[:, 2] >= solid.top_m - grow_m) & (points[:, 2] <= solid.bottom_m + grow_m)
    within &= (points[:, :2] >= v.min(axis=0)).all(axis=1) & (points[:, :2] <= v.max(axis=0)).all(axis=1)
    rows = np.flatnonzero(within)
    odd = np.zeros(len(rows), bool)
    x, y = points[rows, 0], points[rows, 1]
    for (ax, ay), (bx, by) in zip(v, np.roll(v, -1, axis=0), strict=True):
        if ay == by:
            continue
        odd ^= ((ay > y) != (by > y)) & (x < ax + (bx - ax) * (y - ay) / (by - ay))
    within[rows] = odd
    return within


def way_inside(solid: Prism, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
    """(M,) whether ways a -> b begin or end in a closed prism, or pass through its roof, its floor or one of its sides; a ball
    as near to roof and floor as its radius. The planes do not cover the sides where they end short of a corner."""
    out = inside(solid, a, radius_m) | inside(solid, b, radius_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        for z in (solid.top_m - radius_m, solid.bottom_m + radius_m):
            share = (z - a[:, 2]) / (b[:, 2] - a[:, 2])
            on = np.flatnonzero((share >= 0.0) & (share <= 1.0))
            if len(on):
                at = a[on] + share[on, None] * (b[on] - a[on])
                at[:, 2] = 0.5 * (solid.top_m + solid.bottom_m)
                out[on] |= inside(solid, at)
    v = solid.vertices_m.astype(np.float64)
    rest = np.flatnonzero(
        ~out
        & (np.maximum(a, b)[:, :2] >= v.min(axis=0)).all(axis=1)
        & (np.minimum(a, b)[:, :2] <= v.max(axis=0)).all(axis=1)
    )
    if len(rest):
        for begin, end in zip(v, np.roll(v, -1, axis=0), strict=True):
            out[rest] |= _through_side(solid, begin, end, a[rest], b[rest], radius_m)
    return out


def _through_side(solid: Prism, begin: Floats, end: Floats, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
    """(M,) whether ways a -> b cross the side of a prism between two vertices, its top and bottom grown by a radius."""
    side, way = end - begin, b - a
    before, after = ((p[:, 0] - begin[0]) * side[1] - (p[:, 1] - begin[1]) * side[0] for p in (a, b))
    opposite = (before <= 0.0) != (after <= 0.0)
    share = np.divide(before, before - after, out=np.zeros(len(a)), where=opposite)
    at = a + share[:, None] * way
    along = (at[:, :2] - begin) @ side
    within = (at[:, 2] >= solid.top_m - radius_m) & (at[:, 2] <= solid.bottom_m + radius_m)
    return np.asarray(opposite & within & (along >= 0.0) & (along <= side @ side))

"""Which plane of the world follows which around a corner, and where that corner is.

The planes of a world are never cut to fit each other: what was seen of one stays an obstacle. A side's end is known to the
noise along the way it was seen, and what is round was seen as planes that touch it, so at corners planes run past each
other, or end short of it. The corner is where their lines cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
NONE = -1
END_M = 0.05
"""Ends nearer than this meet where they are."""
FLAT = 0.2
"""Sine of the angle below which two lines have no crossing worth the name; their ends meet halfway, within MEET_M / 2."""
MEET_M = 0.5
"""So much may a plane end short of a corner; and past one where free space is inside of the corner."""
PAST_M, PAST_SHARE = 2.0, 0.6
"""So far, and so much of its length, may a plane run past a corner that the solid is inside of."""
OVERLAP = 0.5
"""Share of the lower plane's height that both must have."""
BIG_M2 = 2.0
LOOKS = (5, 10, 20, 40)
"""Planes that are smaller, and then those that were seen less often, stand back where they keep a profile from closing."""
_MOST_EDGES = 400
"""Not tuning: longer profiles are not tried for crossings, and stay open."""
_MOST_BESIDE = 1024
"""Not tuning: an end with more beginnings around it has no corner, and its profile stays open."""
_ENDS = 1024
"""Not tuning: ends that are looked at together: about 300 MB of scratch memory at the most."""
_CELL_M = 2.0 * PAST_M
"""Not tuning: farther apart than this no two ends can be that have one corner."""


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """after: (N,) int32, the plane that follows at the b end of each, -1: none; corner: (N, 2), where it does."""

    after: NDArray[np.int32]
    corner: Floats


def followers(planes: Floats, hits: NDArray[np.int32] | None = None) -> Around:
    """The follower of each plane (N, 6) a_x, a_y, b_x, b_y, top, bottom; at most one follows, and is followed by, each.
    hits: (N,) observations of each; None: equal.

    Of several those that are larger and were seen more often go first, then those that run past each other most: of planes
    that touch something round these are the neighbours."""
    looks = np.full(len(planes), LOOKS[0], np.int32) if hits is None else hits
    found = _matched(planes, looks, np.arange(len(planes)))
    area = np.hypot(*(planes[:, 2:4] - planes[:, 0:2]).T) * (planes[:, 5] - planes[:, 4])
    for least in LOOKS:
        ring = in_solids(found)
        left = np.flatnonzero((area >= BIG_M2) & (looks >= least) & ~ring)
        again = _matched(planes, looks, left)
        new = in_solids(again)
        found.after[new], found.corner[new] = again.after[new], again.corner[new]
        found.after[np.isin(found.after, np.flatnonzero(new)) & ~new] = NONE  # each is followed once
    return found


def in_solids(around: Around) -> NDArray[np.bool_]:
    """(N,) whether following leads each plane back to itself, around what it stands for."""
    after, n = around.after, len(around.after)
    solid, seen = np.zeros(n, np.bool_), np.zeros(n, np.int64)
    for begin in range(n):
        k, way = begin, []
        while k != NONE and seen[k] == 0:
            seen[k] = begin + 1
            way.append(k)
            k = int(after[k])
        if k != NONE and seen[k] == begin + 1:
            ring = way[way.index(k) :]
            solid[ring] = encloses(around.corner[ring])
    return solid


def encloses(vertices: Floats) -> bool:
    """Whether a closed profile is a simple polygon with what it stands for inside: its area, x north and y east, is
    negative where free space is on the right."""
    if not 3 <= len(vertices) <= _MOST_EDGES:
        return False
    x, y = (vertices - vertices[0]).T
    area = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return area < 0.0 and is_simple(vertices)


def is_simple(vertices: Floats) -> bool:
    """Whether no two edges of a closed polygon touch but neighbours at their common end."""
    a, b = vertices, np.roll(vertices, -1, axis=0)
    n = len(a)
    for i in range(n - 1):
        k = np.arange(i + 2, n - (1 if i == 0 else 0))
        e, f = b[i] - a[i], b[k] - a[k]
        to_a, to_b = a[k] - a[i], b[k] - a[i]
        side_a, side_b = e[0] * to_a[:, 1] - e[1] * to_a[:, 0], e[0] * to_b[:, 1] - e[1] * to_b[:, 0]
        back, on = a[i] - a[k], b[i] - a[k]
        side_c, side_d = f[:, 0] * back[:, 1] - f[:, 1] * back[:, 0], f[:, 0] * on[:, 1] - f[:, 1] * on[:, 0]
        if ((side_a * side_b <= 0.0) & (side_c * side_d <= 0.0)).any():
            return False
    return True


def _matched(planes: Floats, looks: NDArray[np.int32], rows: Indices) -> Around:
    after, corner = np.full(len(planes), NONE, np.int32), np.zeros((len(planes), 2))
    taken = np.zeros(len(planes), np.bool_)
    first, second, at = _candidates(planes, looks, rows)
    for i, k, place in zip(first.tolist(), second.tolist(), at, strict=True):
        if after[i] == NONE and not taken[k]:
            after[i], corner[i], taken[k] = k, place, True
    return Around(after, corner)


def _candidates(planes: Floats, looks: NDArray[np.int32], rows: Indices) -> tuple[Indices, Indices, Floats]:
    """(first, second, corner) of all pairs that may follow each other, the best first."""
    begins = _sorted_cells(planes[rows, 0:2])
    found = [
        _rated(planes, looks, rows[begin + i], rows[k])
        for begin in range(0, max(1, len(rows)), _ENDS)
        for i, k in [_near(planes[rows[begin : begin + _ENDS], 2:4], begins)]
    ]
    i, k, corner, gap, past, size = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((k, i, gap, -past, -size))
    return i[order], k[order], corner[order]


def _rated(
    planes: Floats, looks: NDArray[np.int32], i: Indices, k: Indices
) -> tuple[Indices, Indices, Floats, Floats, Floats, Floats]:
    """(first, second, corner, gap, length past each other, size) of those of the pairs i, k that may follow each other."""
    p, q = planes[i], planes[k]
    height = np.minimum(p[:, 5] - p[:, 4], q[:, 5] - q[:, 4])
    both = np.minimum(p[:, 5], q[:, 5]) - np.maximum(p[:, 4], q[:, 4])
    length_p, length_q = np.hypot(*(p[:, 2:4] - p[:, 0:2]).T), np.hypot(*(q[:, 2:4] - q[:, 0:2]).T)
    e, f = (p[:, 2:4] - p[:, 0:2]) / length_p[:, None], (q[:, 2:4] - q[:, 0:2]) / length_q[:, None]
    sine, to = _cross(e, f), q[:, 0:2] - p[:, 0:2]
    gap = np.hypot(*(q[:, 0:2] - p[:, 2:4]).T)
    flat = np.abs(sine) < FLAT
    safe = np.where(flat, 1.0, sine)
    past_p, past_q = length_p - _cross(to, f) / safe, _cross(to, e) / safe
    solid_inside = sine < 0.0  # the follower turns away from the free space, which is on the right
    limit_p, limit_q = (
        np.where(solid_inside, np.minimum(PAST_M, PAST_SHARE * n), np.minimum(MEET_M, PAST_SHARE * n))
        for n in (length_p, length_q)
    )
    crossing = ~flat & (past_p <= limit_p) & (past_q <= limit_q) & (np.minimum(past_p, past_q) >= -MEET_M)
    good = (i != k) & (both >= OVERLAP * height) & (both > 0.0)
    good &= (gap < END_M) | crossing | (flat & (gap <= 0.5 * MEET_M))
    corner = p[:, 0:2] + (length_p - past_p)[:, None] * e
    corner[flat] = 0.5 * (p[:, 2:4] + q[:, 0:2])[flat]
    corner[gap < END_M] = p[gap < END_M, 2:4]
    size = height * np.minimum(length_p, length_q) * np.minimum(looks[i], looks[k])
    size = np.floor(0.5 * np.log2(np.maximum(size, 1e-6)))
    past = np.where(flat, -gap, past_p + past_q)
    return i[good], k[good], corner[good], gap[good], past[good], size[good]


def _sorted_cells(begins: Floats) -> tuple[Indices, Indices]:
    """(codes of the cells of beginnings, increasing; the row of each)."""
    cell = np.floor(begins / _CELL_M).astype(np.int64)
    code = cell[:, 0] * (1 << 24) + cell[:, 1]
    order = np.argsort(code, kind="stable")
    return code[order], order


def _near(ends: Floats, begins: tuple[Indices, Indices]) -> tuple[Indices, Indices]:
    """(row of an end, row of a beginning) of all that lie in the same or neighbouring cells; none for an end with more than
    _MOST_BESIDE of them. begins: of `_sorted_cells`."""
    cell, (code, order) = np.floor(ends / _CELL_M).astype(np.int64), begins
    around = np.array(list(product((-1, 0, 1), repeat=2)))
    wanted = (cell[:, None, 0] + around[:, 0]) * (1 << 24) + cell[:, None, 1] + around[:, 1]
    low, high = np.searchsorted(code, wanted, "left"), np.searchsorted(code, wanted, "right")
    count = np.where((high - low).sum(axis=1, keepdims=True) <= _MOST_BESIDE, high - low, 0).ravel()
    first = np.repeat(low.ravel() - (np.cumsum(count) - count), count)
    return np.repeat(np.arange(len(ends)), count.reshape(wanted.shape).sum(axis=1)), order[
        first + np.arange(len(first))
    ]


def _cross(u: Floats, v: Floats) -> Floats:
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])

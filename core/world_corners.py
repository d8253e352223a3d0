"""Which plane of the world follows which around a corner, and where that corner is. Only numpy.

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
PAST_M, PAST_SHARE = 1.5, 0.6
"""So far, and so much of its length, may a plane run past a corner that the solid is inside of."""
OVERLAP = 0.5
"""Share of the lower plane's height that both must have."""
BIG_M2 = 2.0
"""Planes smaller than this stand back where they keep a profile from closing."""
_CELL_M = 2.0 * PAST_M
"""Not tuning: farther apart than this no two ends can be that have one corner."""


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """after: (N,) int32, the plane that follows at the b end of each, -1: none; corner: (N, 2), where it does."""

    after: NDArray[np.int32]
    corner: Floats


def followers(planes: Floats) -> Around:
    """The follower of each plane (N, 6) a_x, a_y, b_x, b_y, top, bottom; at most one follows, and is followed by, each.

    Of several the larger planes go first, then those that run past each other most: of planes
    that touch something round these are the neighbours."""
    found = _matched(planes, np.arange(len(planes)))
    area = np.hypot(*(planes[:, 2:4] - planes[:, 0:2]).T) * (planes[:, 5] - planes[:, 4])
    left = np.flatnonzero((area >= BIG_M2) & ~in_rings(found.after))
    again = _matched(planes, left)
    ring = in_rings(again.after)
    if ring.any():
        after, corner = found.after.copy(), found.corner.copy()
        after[np.isin(after, np.flatnonzero(ring))] = NONE
        after[ring], corner[ring] = again.after[ring], again.corner[ring]
        return Around(after, corner)
    return found


def in_rings(after: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(N,) whether following leads each plane back to itself."""
    n = len(after)
    ring, state = np.zeros(n, np.bool_), np.zeros(n, np.int64)
    for begin in range(n):
        k, way = begin, []
        while k != NONE and state[k] == 0:
            state[k] = begin + 1
            way.append(k)
            k = int(after[k])
        if k != NONE and state[k] == begin + 1:
            ring[way[way.index(k) :]] = True
    return ring


def _matched(planes: Floats, rows: Indices) -> Around:
    after, corner = np.full(len(planes), NONE, np.int32), np.zeros((len(planes), 2))
    taken = np.zeros(len(planes), np.bool_)
    first, second, at = _candidates(planes, rows)
    for i, k, place in zip(first.tolist(), second.tolist(), at, strict=True):
        if after[i] == NONE and not taken[k]:
            after[i], corner[i], taken[k] = k, place, True
    return Around(after, corner)


def _candidates(planes: Floats, rows: Indices) -> tuple[Indices, Indices, Floats]:
    """(first, second, corner) of all pairs that may follow each other, the best first."""
    i, k = _near(planes[rows, 2:4], planes[rows, 0:2])
    i, k = rows[i], rows[k]
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
    size = np.floor(0.5 * np.log2(np.maximum(height * np.minimum(length_p, length_q), 1e-6)))
    past = np.where(flat, -gap, past_p + past_q)
    order = np.lexsort((k, i, gap, -past, -size))
    order = order[good[order]]
    return i[order], k[order], corner[order]


def _near(ends: Floats, begins: Floats) -> tuple[Indices, Indices]:
    """(row of an end, row of a beginning) of all that lie in the same or neighbouring cells."""
    cell_b, cell_a = (np.floor(xy / _CELL_M).astype(np.int64) for xy in (ends, begins))
    code = cell_a[:, 0] * (1 << 24) + cell_a[:, 1]
    order = np.argsort(code, kind="stable")
    code = code[order]
    found_i, found_k = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for dx, dy in product((-1, 0, 1), repeat=2):
        wanted = (cell_b[:, 0] + dx) * (1 << 24) + cell_b[:, 1] + dy
        low, high = np.searchsorted(code, wanted, "left"), np.searchsorted(code, wanted, "right")
        count = high - low
        begin = np.repeat(low - (np.cumsum(count) - count), count)
        found_i.append(np.repeat(np.arange(len(ends)), count))
        found_k.append(order[begin + np.arange(len(begin))])
    return np.concatenate(found_i), np.concatenate(found_k)


def _cross(u: Floats, v: Floats) -> Floats:
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])

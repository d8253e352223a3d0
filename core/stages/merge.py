"""Section 5.3, the merge: pieces that one plane can stand for become one, cheapest pair first (Eq. 17).

All pairs of neighbouring pieces wait by their cost. A pair that comes out with a cost that no longer holds,
because one of the two has grown since, is weighed again and goes back; so each pair is looked at a few times, whatever
the order, and moments are added, never summed again.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner, inner_inline, kernel
from .evidence import uncovered_share
from .merge_cost import (
    R_BEHIND,
    R_EMPTY_WEIGHT,
    R_GAP,
    R_MOST_EMPTY,
    R_SIGMA_S,
    R_SIGMAS,
    R_SLACK,
    REFUSED,
    apart,
    costs_of_next,
    fill_tiles,
    front_on,
    of_piece,
    pair_cost,
    weigh,
)
from .planes import FRONT, MIDDLE, P_CLUSTER, P_SUPPORT, T0, T1, Z0, Z1, A, B, distance_at
from .priority_queue import STEPS, begin, put, take

_SAME = 1e-9
"""Not tuning: costs that differ by less are one cost, but for rounding."""
_WINDOW = 1.25
"""Not tuning: gaps are measured at the mean distance of both planes, the window at that of one."""
_MORE_THAN_T = 1000.0
"""Not tuning: no tangent of azimuth is so large."""
_SLOTS = 4096
"""Not tuning: room for pairs just weighed; a pair whose slot another one took is weighed once more, and comes out alike."""
_MOST_LOOKS = 64
"""Not tuning: a bound on looks per pair that no frame has come near."""


@inner_inline
def cover_cost(planes, i, j, a, b, rules, grid, frame, masks, mask_frame, run):
    """What the joined rectangle of i and j on the line s = a + b*t costs for the empty cells that it takes in."""
    p = planes[i, T0], planes[i, T1], planes[i, Z0], planes[i, Z1]
    q = planes[j, T0], planes[j, T1], planes[j, Z0], planes[j, Z1]
    share = uncovered_share(
        min(p[0], q[0]), max(p[1], q[1]), min(p[2], q[2]), max(p[3], q[3]), a, b, p, q, rules[R_BEHIND],
        rules[R_SIGMAS] * rules[R_SIGMA_S], rules[R_GAP], rules[R_SLACK], grid, frame, masks, mask_frame, run,
    )  # fmt: skip
    return REFUSED if share > rules[R_MOST_EMPTY] else rules[R_EMPTY_WEIGHT] * share


@kernel
def weigh_neighbours(
    count, planes, plane_ints, traits, order, age, most, partners, rules, tiles, next_cost, cost, pair
):  # fmt: skip
    """Pairs of living planes of one cluster that may be one: fills the tables cost and pair, returns how many.

    order: (count,) planes by cluster and first tangent. Each plane is weighed with at most `most` of the next in that order; the
    cheapest `partners` of them become pairs."""
    best_cost, best = np.empty(partners), np.empty(partners, np.int32)
    size, alive = 0, 0
    for k in range(count):
        if plane_ints[order[k], P_SUPPORT] >= 0:
            order[alive] = order[k]
            alive += 1
    fill_tiles(order, alive, traits, tiles)
    start, group = np.empty(alive), np.empty(alive, np.int32)
    for k in range(alive):
        start[k], group[k] = planes[order[k], T0], plane_ints[order[k], P_CLUSTER]
    for k in range(alive):
        i = order[k]
        far = planes[i, T1] + _WINDOW * rules[R_GAP] / planes[i, MIDDLE]
        end = k + 1
        for _ in range(min(alive - end, most)):
            if start[end] > far or group[end] != group[k]:
                break
            end += 1
        if end == k + 1:
            continue
        costs_of_next(tiles, k, end, rules, next_cost)
        found, limit = 0, 1.0
        for m in range(k + 1, end):
            c = next_cost[m]
            if not c < limit:
                continue
            at = min(found, partners - 1)
            for _ in range(partners):
                if at == 0 or best_cost[at - 1] <= c:
                    break
                best_cost[at], best[at] = best_cost[at - 1], best[at - 1]
                at -= 1
            best_cost[at], best[at] = c, order[m]
            found = min(found + 1, partners)
            if found == partners:
                limit = best_cost[found - 1]
        for m in range(found):
            cost[size] = best_cost[m]
            pair[size, 0], pair[size, 1], pair[size, 2] = i, best[m], -2 - age[i] - age[best[m]]
            size += 1
    return size


@kernel
def join_planes(
    count, planes, plane_ints, moments, parent, rules, rounds, most, partners, grid, frame, masks, mask_frame, traits, order,
    age, tiles, next_cost, cost, pair, after, heap,
):  # fmt: skip
    """Joins planes of one cluster, cheapest pair first, until none fits; dead ones get a negative support.

    parent: (N,) int32, the plane that took each one over, itself at first. rules: by the R_ indices. grid, frame: see
    evidence.py; masks, mask_frame: openings.py. Scratch: traits (N, TRAITS) float64, order, age (N,) int32; tiles, next_cost:
    see `costs_of_next`; cost, pair, after, heap: see cheapest.py, with N * partners entries. A merged plane has the
    neighbours of its parts; each of at most `rounds` rounds looks for new ones.
    What pair[k, 2] says about a cost: the sum of both planes' ages where it is whole, -2 less that where what the join
    covers is not in it yet."""
    run = np.zeros(grid.shape[1] + 2, np.int32)
    looked = np.full((_SLOTS, 3), -1, np.int32)
    waits, at = np.empty(STEPS, np.int32), np.empty(2, np.int64)
    for k in range(count):
        age[k] = 0
        weigh(planes, moments, traits, k, rules)
    joined = 0
    order[:count] = np.argsort(_MORE_THAN_T * plane_ints[:count, P_CLUSTER] + planes[:count, T0], kind="mergesort")
    for _round in range(rounds):
        before = joined
        size = weigh_neighbours(
            count, planes, plane_ints, traits, order, age, most, partners, rules, tiles, next_cost, cost, pair
        )
        begin(waits, at)
        for k in range(size):
            put(cost, pair, waits, after, heap, at, k)
        for _ in range(_MOST_LOOKS * cost.shape[0]):
            k = take(cost, pair, waits, after, heap, at)
            if k < 0:
                break
            i, j, known = root_of(parent, pair[k, 0]), root_of(parent, pair[k, 1]), pair[k, 2]
            if i == j:
                continue
            if j < i:
                i, j = j, i
            if apart(planes, i, j, rules[R_GAP]):
                continue
            version = age[i] + age[j]
            if known != version and known != -2 - version:
                slot = (i * 7919 + j) % looked.shape[0]
                if looked[slot, 0] == i and looked[slot, 1] == j and looked[slot, 2] == version:
                    continue  # the same two have been weighed as they are: refused, or waiting already
                looked[slot, 0], looked[slot, 1], looked[slot, 2] = i, j, version
            now, a, b = pair_cost(of_piece(traits, i), of_piece(traits, j), rules)
            if known != version:
                known = -2 - version
                if now <= cost[k] + _SAME:
                    now += cover_cost(planes, i, j, a, b, rules, grid, frame, masks, mask_frame, run)
                    known = version
                if not now < 1.0:
                    continue
                if now > cost[k] + _SAME:
                    cost[k], pair[k, 0], pair[k, 1], pair[k, 2] = now, i, j, known
                    put(cost, pair, waits, after, heap, at, k)
                    continue
            absorb(planes, plane_ints, moments, traits, i, j, a, b)
            weigh(planes, moments, traits, i, rules)
            parent[j] = i
            age[i] += age[j] + 1
            joined += 1
        if joined == before:
            break


@inner
def root_of(parent, k):
    """The plane that stands for plane k by now, halving the path."""
    for _ in range(parent.shape[0]):
        if parent[k] == k:
            break
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@inner_inline
def absorb(planes, plane_ints, moments, traits, i, j, a, b):
    """Makes plane i, on the line s = a + b*t, stand for j too; j gets a negative support."""
    p, q = planes[i], planes[j]
    p[FRONT] = max(front_on(of_piece(traits, i), a, b), front_on(of_piece(traits, j), a, b))
    p[A], p[B] = a, b
    p[T0], p[T1] = min(p[T0], q[T0]), max(p[T1], q[T1])
    p[MIDDLE] = distance_at(p, 0.5 * (p[T0] + p[T1]))
    p[Z0], p[Z1] = min(p[Z0], q[Z0]), max(p[Z1], q[Z1])
    for m in range(6):
        moments[i, m] += moments[j, m]
    plane_ints[i, P_SUPPORT] += plane_ints[j, P_SUPPORT]
    plane_ints[j, P_SUPPORT] = -1

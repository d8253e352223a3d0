"""Section 5.3, the merge: pieces that one plane can stand for become one, cheapest pair first (Eq. 17).

All pairs of neighbouring pieces are in a priority queue. A pair whose cost is outdated, because one of the two has grown
since, is scored again and put back; so each pair is scored a few times at most. Moments are added, never summed again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, inner_inline, kernel
from .evidence import Rectangle, uncovered_share
from .line_fit import add_moments
from .merge_cost import (
    REFUSED,
    TILE,
    TRAITS,
    apart,
    costs_of_next,
    fill_tiles,
    front_on,
    of_piece,
    pair_cost,
    score_piece,
)
from .planes import distance_at
from .priority_queue import Queue, clear_queue, pop, push, queue_buffers

_SAME = 1e-9
"""Not tuning: costs that differ by less are one cost, but for rounding."""
_WINDOW = 1.25
"""Not tuning: gaps are measured at the mean distance of both planes, the window at that of one."""
_MORE_THAN_T = 1000.0
"""Not tuning: no tangent of azimuth is so large."""
_SLOTS = 4096
"""Not tuning: room for pairs just scored; a pair whose slot another one took is scored once more, with the same result."""
_MOST_TRIES = 64
"""Not tuning: a bound on tries per pair that no frame has come near."""


class MergeBuffers(NamedTuple):
    """Scratch of `join_planes` for N planes: traits (N, TRAITS) float64, order and age (N,) int32; tiles, next_cost: see
    `costs_of_next`; queue: with merge_partners entries for each plane."""

    traits: NDArray[np.float64]
    order: NDArray[np.int32]
    age: NDArray[np.int32]
    tiles: NDArray[np.float64]
    next_cost: NDArray[np.float64]
    queue: Queue


def merge_buffers(planes: int, partners: int) -> MergeBuffers:
    """Scratch for so many planes with so many partners each."""
    return MergeBuffers(
        np.zeros((planes, TRAITS)),
        np.zeros(planes, np.int32),
        np.zeros(planes, np.int32),
        np.zeros(-(-planes // TILE) * TRAITS * TILE),
        np.zeros(planes),
        queue_buffers(planes * partners),
    )


@inner_inline
def cover_cost(p, q, a, b, rules, evidence, openings, run):
    """What the joined rectangle of planes p and q on the line s = a + b*t costs for the empty cells that it takes in."""
    one, other = Rectangle(p.t0, p.t1, p.top_m, p.bottom_m), Rectangle(q.t0, q.t1, q.top_m, q.bottom_m)
    joined = Rectangle(min(p.t0, q.t0), max(p.t1, q.t1), min(p.top_m, q.top_m), max(p.bottom_m, q.bottom_m))
    share = uncovered_share(joined, a, b, one, other, rules, evidence, openings, run)
    return REFUSED if share > rules.most_empty else rules.empty_weight * share


@kernel
def propose_pairs(count, planes, rules, settings, buffers):
    """Pairs of planes of one cluster that may be one: fills the entries of the queue, returns how many.

    buffers.order: (count,) planes by cluster and first tangent. Each plane is scored with at most merge_candidates of the
    next in that order; the cheapest merge_partners of them become pairs."""
    order, age, entries = buffers.order, buffers.age, buffers.queue.entries
    most, partners = settings.merge_candidates, settings.merge_partners
    best_cost, best = np.empty(partners), np.empty(partners, np.int32)
    found_pairs, alive = 0, 0
    for k in range(count):
        if planes[order[k]].support >= 0:
            order[alive] = order[k]
            alive += 1
    fill_tiles(order, alive, buffers.traits, buffers.tiles)
    start, group = np.empty(alive), np.empty(alive, np.int32)
    for k in range(alive):
        start[k], group[k] = planes[order[k]].t0, planes[order[k]].cluster
    for k in range(alive):
        i = order[k]
        far = planes[i].t1 + _WINDOW * rules.gap_m / planes[i].middle_m
        end = k + 1
        for _ in range(min(alive - end, most)):
            if start[end] > far or group[end] != group[k]:
                break
            end += 1
        if end == k + 1:
            continue
        costs_of_next(buffers.tiles, k, end, rules, buffers.next_cost)
        found, limit = 0, 1.0
        for m in range(k + 1, end):
            c = buffers.next_cost[m]
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
            entry = entries[found_pairs]
            entry.cost = best_cost[m]
            entry.first, entry.second, entry.version = i, best[m], -2 - age[i] - age[best[m]]
            found_pairs += 1
    return found_pairs


@kernel
def join_planes(count, room, planes, parent, rules, settings, evidence, openings, buffers):
    """Joins planes of one cluster, cheapest pair first, until none fits; those joined to another get a negative support.

    planes: (N,) PLANE, of which `count` exist; room: `plane_room` of the frame. parent: (N,) int32, the plane that took each one over, itself at first. rules,
    settings: records of MERGE_RULES and PLANE_SETTINGS. evidence: Evidence; openings: OpeningMasks; buffers: MergeBuffers.
    A merged plane has the neighbours of its parts; each of at most merge_rounds rounds looks for new ones.
    `version` of a queue entry: the sum of both planes' ages where its cost is whole, -2 less that where the cost of what
    the join covers is missing."""
    traits, order, age, queue = buffers.traits, buffers.order, buffers.age, buffers.queue
    entries = queue.entries
    run = np.zeros(evidence.nearest.shape[1] + 2, np.int32)
    scored = np.full((_SLOTS, 3), -1, np.int32)
    place = np.empty(count)
    for k in range(count):
        age[k] = 0
        score_piece(planes[k], traits, k, rules)
        place[k] = _MORE_THAN_T * planes[k].cluster + planes[k].t0
    joined = 0
    order[:count] = np.argsort(place, kind="mergesort")
    tries = _MOST_TRIES * room * settings.merge_partners
    for _round in range(settings.merge_rounds):
        before = joined
        proposed = propose_pairs(count, planes, rules, settings, buffers)
        clear_queue(queue)
        for k in range(proposed):
            push(queue, k)
        for _ in range(tries):
            k = pop(queue)
            if k < 0:
                break
            entry = entries[k]
            i, j, known = root_of(parent, entry.first), root_of(parent, entry.second), entry.version
            if i == j:
                continue
            if j < i:
                i, j = j, i
            if apart(planes[i], planes[j], rules.gap_m):
                continue
            version = age[i] + age[j]
            if known != version and known != -2 - version and was_scored(scored, i, j, version):
                continue
            now, a, b = pair_cost(of_piece(traits, i), of_piece(traits, j), rules)
            if known != version:
                known = -2 - version
                if now <= entry.cost + _SAME:
                    now += cover_cost(planes[i], planes[j], a, b, rules, evidence, openings, run)
                    known = version
                if not now < 1.0:
                    continue
                if now > entry.cost + _SAME:
                    entry.cost, entry.first, entry.second, entry.version = now, i, j, known
                    push(queue, k)
                    continue
            absorb(planes, traits, i, j, a, b)
            score_piece(planes[i], traits, i, rules)
            parent[j] = i
            age[i] += age[j] + 1
            joined += 1
        if joined == before:
            break


@inner_inline
def was_scored(scored, i, j, version):
    """Whether planes i and j have been scored at this version: they were refused, or wait in the queue. Notes them if not.

    scored: (_SLOTS, 3) int64, the pairs scored last."""
    slot = (i * 7919 + j) % scored.shape[0]
    if scored[slot, 0] == i and scored[slot, 1] == j and scored[slot, 2] == version:
        return True
    scored[slot, 0], scored[slot, 1], scored[slot, 2] = i, j, version
    return False


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
def absorb(planes, traits, i, j, a, b):
    """Makes plane i, on the line s = a + b*t, stand for j too; j gets a negative support."""
    p, q = planes[i], planes[j]
    p.front_m = max(front_on(of_piece(traits, i), a, b), front_on(of_piece(traits, j), a, b))
    p.a, p.b = a, b
    p.t0, p.t1 = min(p.t0, q.t0), max(p.t1, q.t1)
    p.middle_m = distance_at(p, 0.5 * (p.t0 + p.t1))
    p.top_m, p.bottom_m = min(p.top_m, q.top_m), max(p.bottom_m, q.bottom_m)
    add_moments(p, q)
    p.support += q.support
    q.support = -1

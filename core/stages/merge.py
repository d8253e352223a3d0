"""Plane merge (Section 5.3): planes that one plane can replace are joined, the cheapest pair first.

Input and output: the table of planes. The paper merges two neighbours if their angle and gap are small; here a cost
decides (merge_cost.py), and the empty space that the joined rectangle would cover (evidence.py).

All pairs of neighbouring planes are in a priority queue. If one plane of a pair has grown since the pair was scored,
it is scored again and put back, so that each pair is scored a few times at most. Moments are added (Eq. 17), so that
strips are not read again."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, kernel
from ..union_find import root_of
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
from .priority_queue import ENTRY, QUEUE_STATE, STEPS, Queue, clear_queue, pop, push

_EMPTY_WEIGHT = 0.5
"""Cost of a merge whose rectangle is all empty."""
_SAME = 1e-9
"""Costs that differ by less are equal except for rounding."""
_WINDOW = 1.25
"""Factor on the search window: gaps are measured at the mean distance of both planes, the window at that of one."""
_MORE_THAN_T = 1000.0
"""A number greater than any tangent of azimuth."""
_SLOTS = 4096
"""Size of the hash table of pairs scored last. A pair whose slot was taken is scored again, with the same result."""
_MOST_TRIES = 64
"""Greatest number of queue entries per pair, which no frame has reached. It limits the time."""


class MergeBuffers(NamedTuple):
    """Scratch memory of `join_planes` for N planes."""

    traits: Any  # (N, TRAITS) float64, see `score_piece`
    order: Any  # (N,) int32, planes by cluster and first tangent
    age: Any  # (N,) int32, number of merges of a plane
    tiles: Any  # tiles, next_cost: see `costs_of_next`
    next_cost: Any
    queue: Queue  # with merge_partners entries per plane


@inner_inline
def cover_cost(p, q, a, b, settings, cover):
    """Returns the cost of the empty cells that the joined rectangle of planes p and q on the line s = a + b t would
    cover. cover: Cover."""
    one, other = Rectangle(p.t0, p.t1, p.top_m, p.bottom_m), Rectangle(q.t0, q.t1, q.top_m, q.bottom_m)
    joined = Rectangle(min(p.t0, q.t0), max(p.t1, q.t1), min(p.top_m, q.top_m), max(p.bottom_m, q.bottom_m))
    share = uncovered_share(joined, a, b, one, other, settings, cover)
    return REFUSED if share > settings.merge_empty_share else _EMPTY_WEIGHT * share


@kernel
def propose_pairs(count, planes, settings, buffers):
    """Writes pairs of planes of one cluster that may be one to the entries of the queue; returns their number.

    Each plane is scored with at most merge_candidates of the next planes in buffers.order. The cheapest
    merge_partners of them become pairs."""
    order, age, entries = buffers.order, buffers.age, buffers.queue.entries
    best_cost, best = np.empty(settings.merge_partners), np.empty(settings.merge_partners, np.int32)
    found_pairs, alive = 0, 0
    for k in range(count):
        if planes[order[k]].support >= 0:
            order[alive] = order[k]
            alive += 1
    fill_tiles(order, alive, buffers.traits, buffers.tiles)
    for k in range(alive):
        i = order[k]
        end = end_of_neighbours(k, min(alive, k + 1 + settings.merge_candidates), planes, order, settings.gap_m)
        costs_of_next(buffers.tiles, k, end, settings, buffers.next_cost)
        found = 0
        for m in range(k + 1, end):
            found = keep_cheapest(buffers.next_cost[m], order[m], found, best_cost, best)
        for m in range(found):
            entry = entries[found_pairs]
            entry.cost, entry.first, entry.second = best_cost[m], i, best[m]
            entry.version, entry.complete = age[i] + age[best[m]], False
            found_pairs += 1
    return found_pairs


@inner
def end_of_neighbours(k, end, planes, order, gap_m):
    """Returns the end of the planes after position k of `order`, and before `end`, that belong to the cluster of plane
    order[k] and do not begin farther aside than gap_m."""
    plane = planes[order[k]]
    far = plane.t1 + _WINDOW * gap_m / plane.middle_m
    for m in range(k + 1, end):
        other = planes[order[m]]
        if other.t0 > far or other.cluster != plane.cluster:
            return m
    return end


@inner
def keep_cheapest(cost, plane, found, best_cost, best):
    """Inserts a plane into the list of the `found` cheapest partners, sorted by cost; returns their new number. Costs of 1
    or more are refused.

    best_cost: (P,) float64; best: (P,) int32. If all P places are taken, the dearest partner is dropped."""
    partners = len(best)
    if not cost < (best_cost[partners - 1] if found == partners else 1.0):
        return found
    at = min(found, partners - 1)
    for _ in range(partners):
        if at == 0 or best_cost[at - 1] <= cost:
            break
        best_cost[at], best[at] = best_cost[at - 1], best[at - 1]
        at -= 1
    best_cost[at], best[at] = cost, plane
    return min(found + 1, partners)


@kernel
def join_planes(count, tables, settings, cover):
    """Joins planes of one cluster, the cheapest pair first, until no pair fits. Joined planes get a negative support.

    A merged plane has the neighbours of its parts; each of at most merge_rounds rounds searches new ones.
    tables: PlaneTables, planes and parent in and out."""
    planes, pairs = tables.planes, count * settings.merge_partners
    traits, place = np.empty((count, TRAITS)), np.empty(count)
    for k in range(count):
        score_piece(planes[k], traits, k, settings)
        place[k] = _MORE_THAN_T * planes[k].cluster + planes[k].t0
    order = np.argsort(place, kind="mergesort").astype(np.int32)
    entries, lists, heap = np.empty(pairs, ENTRY), np.empty(STEPS, np.int32), np.empty(pairs, np.int32)
    queue = Queue(entries, lists, heap, np.empty(1, QUEUE_STATE))
    tiles, next_cost = np.empty(-(-count // TILE) * TRAITS * TILE), np.empty(count)
    buffers = MergeBuffers(traits, order, np.zeros(count, np.int32), tiles, next_cost, queue)
    scored = np.full((_SLOTS, 3), -1, np.int32)
    tries = _MOST_TRIES * len(planes) * settings.merge_partners
    for _ in range(settings.merge_rounds):
        proposed = propose_pairs(count, planes, settings, buffers)
        if join_proposed(proposed, tries, tables, settings, cover, scored, buffers) == 0:
            break


@inner
def join_proposed(proposed, tries, tables, settings, cover, scored, buffers):
    """Joins the first `proposed` pairs in the entries of the queue, the cheapest first; returns the number of joins.

    The version of a pair is the sum of the ages of both planes. A cost of an older version is computed again, and the pair
    returns to the queue if it costs more now. What the joined plane would cover takes longest, and is computed last.

    tries: greatest number of queue entries to take. scored: (_SLOTS, 3) int32, see `was_scored`."""
    planes, parent = tables.planes, tables.parent
    traits, age, queue = buffers.traits, buffers.age, buffers.queue
    joined = 0
    clear_queue(queue)
    for k in range(proposed):
        push(queue, k)
    for _ in range(tries):
        k = pop(queue)
        if k < 0:
            break
        entry = queue.entries[k]
        first, second = root_of(parent, entry.first), root_of(parent, entry.second)
        i, j = min(first, second), max(first, second)
        if i == j or apart(planes[i], planes[j], settings.gap_m):
            continue
        version = age[i] + age[j]
        current = entry.version == version
        if not current and was_scored(scored, i, j, version):
            continue
        cost, a, b = pair_cost(of_piece(traits, i), of_piece(traits, j), settings)
        if not (current and entry.complete):
            complete = cost <= entry.cost + _SAME
            if complete:
                cost += cover_cost(planes[i], planes[j], a, b, settings, cover)
            if not cost < 1.0:
                continue
            if cost > entry.cost + _SAME:
                entry.cost, entry.first, entry.second, entry.version, entry.complete = cost, i, j, version, complete
                push(queue, k)
                continue
        absorb(planes, traits, i, j, a, b)
        score_piece(planes[i], traits, i, settings)
        parent[j] = i
        age[i] += age[j] + 1
        joined += 1
    return joined


@inner_inline
def was_scored(scored, i, j, version):
    """True if the pair (i, j) was scored at this version; otherwise records it.

    Such a pair was refused or is in the queue. scored: (_SLOTS, 3) int64, the pairs scored last."""
    slot = (i * 7919 + j) % scored.shape[0]
    if scored[slot, 0] == i and scored[slot, 1] == j and scored[slot, 2] == version:
        return True
    scored[slot, 0], scored[slot, 1], scored[slot, 2] = i, j, version
    return False


@inner_inline
def absorb(planes, traits, i, j, a, b):
    """Merges plane j into plane i, on the line s = a + b t. Plane j gets a negative support."""
    p, q = planes[i], planes[j]
    p.front_m = max(front_on(of_piece(traits, i), a, b), front_on(of_piece(traits, j), a, b))
    p.a, p.b = a, b
    p.t0, p.t1 = min(p.t0, q.t0), max(p.t1, q.t1)
    p.middle_m = distance_at(p, 0.5 * (p.t0 + p.t1))
    p.top_m, p.bottom_m = min(p.top_m, q.top_m), max(p.bottom_m, q.bottom_m)
    add_moments(p, q)
    p.support += q.support
    q.support = -1

"""Section 5.3, the merge: pieces that one plane can stand for become one, cheapest pair first (Eq. 17).

All pairs of neighbouring pieces go into a heap by their cost. A pair that comes out with a cost that no longer holds,
because one of the two has grown since, is weighed again and goes back; so each pair is looked at a few times, whatever
the order, and moments are added, never summed again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .evidence import nearest_seen, uncovered_share
from .kernels import inner, kernel
from .level import ViewGeometry
from .lines import fit_pair, misfit_pair
from .params import Params
from .planes import FRONT, LEAST_S, MIDDLE, P_CLUSTER, P_SUPPORT, T0, T1, Z0, Z1, A, B, distance_at
from .scratch import Scratch
from .types import Intrinsics

# indices of the rules of merging
(
    R_TOLERANCE, R_SIGMAS, R_NOISE_CAP, R_PRIOR, R_TURN, R_LONG, R_SPREAD, R_SIGMA_S, R_EMPTY_WEIGHT, R_MOST_EMPTY, R_GAP,
    R_BEHIND, R_SLACK, R_SHIFT,
) = range(14)  # fmt: skip
# columns of what is kept of each plane's strips
F_MEAN, F_VARIANCE, F_SCALE, F_ALLOWED, F_X0, F_X1 = range(6)
_SAME = 1e-9
"""Not tuning: costs that differ by less are one cost, but for rounding."""
_SURELY = 2.0
"""Not tuning: how much more than what both allow lets `in_depth_apart` answer without a fit."""
_WINDOW = 1.25
"""Not tuning: gaps are measured at the mean distance of both planes, the window at that of one."""
_MORE_THAN_T = 1000.0
"""Not tuning: no tangent of azimuth is so large."""
_SLOTS = 4096
"""Not tuning: room for pairs just weighed; a pair whose slot another one took is weighed once more, and comes out alike."""
_MOST_LOOKS = 64
"""Not tuning: a bound on looks per pair that no frame has come near."""
REFUSED = 2.0
"""Cost of what may not be: anything from 1 up is too much."""


@inner
def push(heap_cost, heap_pair, size, cost, i, j, age):
    """Puts (cost, i, j, known) into the heap of `size` entries; returns the new size. Equal costs: lower i, then j first.

    known: the sum of both planes' ages where the cost is whole, -2 less it where what the join covers is not in it yet."""
    k = size
    for _ in range(64):
        if k == 0:
            break
        up = (k - 1) >> 1
        if not _before(cost, i, j, heap_cost[up], heap_pair[up, 0], heap_pair[up, 1]):
            break
        _move(heap_cost, heap_pair, up, k)
        k = up
    heap_cost[k] = cost
    heap_pair[k, 0], heap_pair[k, 1], heap_pair[k, 2] = i, j, age
    return size + 1


@inner
def drop_first(heap_cost, heap_pair, size):
    """Takes the first entry out of the heap; returns the new size."""
    size -= 1
    cost, i, j, age = heap_cost[size], heap_pair[size, 0], heap_pair[size, 1], heap_pair[size, 2]
    k = 0
    for _ in range(64):
        child = 2 * k + 1
        if child >= size:
            break
        other = child + 1
        if other < size and _before(
            heap_cost[other], heap_pair[other, 0], heap_pair[other, 1],
            heap_cost[child], heap_pair[child, 0], heap_pair[child, 1],
        ):  # fmt: skip
            child = other
        if not _before(heap_cost[child], heap_pair[child, 0], heap_pair[child, 1], cost, i, j):
            break
        _move(heap_cost, heap_pair, child, k)
        k = child
    heap_cost[k] = cost
    heap_pair[k, 0], heap_pair[k, 1], heap_pair[k, 2] = i, j, age
    return size


@inner
def _move(heap_cost, heap_pair, k, to):
    heap_cost[to] = heap_cost[k]
    heap_pair[to, 0], heap_pair[to, 1], heap_pair[to, 2] = heap_pair[k, 0], heap_pair[k, 1], heap_pair[k, 2]


@inner
def _before(cost_a, i_a, j_a, cost_b, i_b, j_b):
    if cost_a != cost_b:
        return cost_a < cost_b
    return i_a < i_b or (i_a == i_b and j_a < j_b)


@inner
def weigh(planes, moments, fits, k, rules):
    """Row k of fits out, by the F_ indices: mean and variance of the tangents of plane k's strips; what a new line may be
    off, in 1/x, and one over that; distances at both ends.

    Noise of the plane, R_SIGMAS of it, allows for more than R_TOLERANCE, but for at most R_NOISE_CAP times that."""
    w = moments[k, 0]
    mean = moments[k, 1] / w
    s = max(planes[k, A] + planes[k, B] * mean, LEAST_S)
    tolerance = rules[R_TOLERANCE]
    noise = min(rules[R_SIGMAS] / (s * s * math.sqrt(w)), rules[R_NOISE_CAP] * tolerance)
    fits[k, F_MEAN], fits[k, F_VARIANCE] = mean, max(0.0, moments[k, 3] / w - mean * mean)
    fits[k, F_ALLOWED] = (tolerance + noise) * s * s
    fits[k, F_SCALE] = 1.0 / fits[k, F_ALLOWED]
    fits[k, F_X0] = 1.0 / max(planes[k, A] + planes[k, B] * planes[k, T0], LEAST_S)
    fits[k, F_X1] = 1.0 / max(planes[k, A] + planes[k, B] * planes[k, T1], LEAST_S)


@inner
def deviation_squared(planes, fits, k, a, b):
    """Square of how far a new line leaves the strips of plane k, root mean square, over what is allowed.

    The distance is along the ray, so that walls seen edge-on are judged as strictly as others."""
    turn = b - planes[k, B]
    off = a - planes[k, A] + turn * fits[k, F_MEAN]
    return fits[k, F_SCALE] * fits[k, F_SCALE] * (off * off + turn * turn * fits[k, F_VARIANCE])


@inner
def apart(planes, i, j, gap_m):
    """Whether two planes are too far from each other, across or down, to be one."""
    if max(planes[i, Z0], planes[j, Z0]) - min(planes[i, Z1], planes[j, Z1]) > gap_m:
        return True
    aside = max(planes[i, T0], planes[j, T0]) - min(planes[i, T1], planes[j, T1])
    return aside * 0.5 * (planes[i, MIDDLE] + planes[j, MIDDLE]) > gap_m


@inner
def in_depth_apart(planes, fits, i, j):
    """Whether two planes that share tangents are so far apart there that no line would serve both: a quick answer before
    `pair_cost`."""
    t0, t1 = max(planes[i, T0], planes[j, T0]), min(planes[i, T1], planes[j, T1])
    if t0 >= t1:
        return False
    off = abs(planes[i, A] - planes[j, A] + (planes[i, B] - planes[j, B]) * 0.5 * (t0 + t1))
    return off > _SURELY * (fits[i, F_ALLOWED] + fits[j, F_ALLOWED])


@inner
def front_on(planes, fits, k, a, b):
    """How far the near side of plane k's strips stands out in front of the line s = a + b*t, at most: FRONT of k there."""
    first = 1.0 / (a + b * planes[k, T0]) - fits[k, F_X0]
    last = 1.0 / (a + b * planes[k, T1]) - fits[k, F_X1]
    return planes[k, FRONT] + max(first, last)


@inner
def pair_cost(planes, moments, fits, i, j, rules):
    """(cost, a, b) of one plane for both i and j, what it would cover apart: REFUSED where one line cannot serve both.

    The cost is the worst of: how far the line leaves the strips of either (`deviation_squared`), how far all strips lie
    from it, and how far it would shift the weightier one towards the camera; each over what is allowed."""
    a, b, mean = fit_pair(moments, i, j, rules[R_PRIOR])
    worst = max(deviation_squared(planes, fits, i, a, b), deviation_squared(planes, fits, j, a, b))
    if worst >= 1.0:
        return REFUSED, 0.0, 0.0
    s = a + b * mean
    left, right = a + b * min(planes[i, T0], planes[j, T0]), a + b * max(planes[i, T1], planes[j, T1])
    if left < 0.5 * s or right < 0.5 * s:
        return REFUSED, 0.0, 0.0
    t0, t1 = min(planes[i, T1], planes[j, T1]), max(planes[i, T0], planes[j, T0])
    if t0 < t1:
        x0, x1 = 1.0 / (a + b * t0), 1.0 / (a + b * t1)
        if (x0 - x1) ** 2 + (t0 * x0 - t1 * x1) ** 2 > rules[R_GAP] * rules[R_GAP]:
            return REFUSED, 0.0, 0.0
    if min(planes[i, T1] - planes[i, T0], planes[j, T1] - planes[j, T0]) > rules[R_LONG] * s:
        cross = planes[i, A] * planes[j, B] - planes[j, A] * planes[i, B]
        dot = planes[i, A] * planes[j, A] + planes[i, B] * planes[j, B]
        if dot <= 0.0 or abs(cross) > rules[R_TURN] * dot:
            return REFUSED, 0.0, 0.0
    shift = max(0.0, max(front_on(planes, fits, i, a, b), front_on(planes, fits, j, a, b)))
    weightier = i if moments[i, 0] > moments[j, 0] else j
    moved = (shift - max(0.0, planes[weightier, FRONT])) * s * s / (rules[R_SHIFT] * s * s + rules[R_SIGMA_S])
    if moved >= 1.0:
        return REFUSED, 0.0, 0.0
    allowed = rules[R_SPREAD] * s * s + rules[R_SIGMA_S]
    spread = misfit_pair(moments, i, j, a, b) / (allowed * allowed)
    return max(max(moved, 0.0), math.sqrt(max(worst, spread))), a, b


@inner
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
    count, planes, plane_ints, moments, fits, order, age, most, partners, rules, heap_cost, heap_pair
):  # fmt: skip
    """Fills the heap with pairs of living planes of one cluster that may be one; returns how many.

    order: (count,) planes by cluster and first tangent. Each plane is weighed with at most `most` of the next in that order; the
    cheapest `partners` of them go into the heap."""
    best_cost, best = np.empty(partners), np.empty(partners, np.int32)
    size, alive = 0, 0
    for k in range(count):
        if plane_ints[order[k], P_SUPPORT] >= 0:
            order[alive] = order[k]
            alive += 1
    for k in range(alive):
        i = order[k]
        far = planes[i, T1] + _WINDOW * rules[R_GAP] / planes[i, MIDDLE]
        cluster = plane_ints[i, P_CLUSTER]
        found = 0
        for m in range(k + 1, min(alive, k + 1 + most)):
            j = order[m]
            if planes[j, T0] > far or plane_ints[j, P_CLUSTER] != cluster:
                break
            if max(planes[i, Z0], planes[j, Z0]) - min(planes[i, Z1], planes[j, Z1]) > rules[R_GAP]:
                continue
            if in_depth_apart(planes, fits, i, j):
                continue
            cost, _, _ = pair_cost(planes, moments, fits, i, j, rules)
            if cost >= 1.0 or (found == partners and cost >= best_cost[found - 1]):
                continue
            at = min(found, partners - 1)
            for _ in range(partners):
                if at == 0 or best_cost[at - 1] <= cost:
                    break
                best_cost[at], best[at] = best_cost[at - 1], best[at - 1]
                at -= 1
            best_cost[at], best[at] = cost, j
            found = min(found + 1, partners)
        for m in range(found):
            size = push(heap_cost, heap_pair, size, best_cost[m], i, best[m], -2 - age[i] - age[best[m]])
    return size


@kernel
def join_planes(
    count, planes, plane_ints, moments, parent, rules, rounds, most, partners, grid, frame, masks, mask_frame, fits, order,
    age, heap_cost, heap_pair,
):  # fmt: skip
    """Joins planes of one cluster, cheapest pair first, until none fits; dead ones get a negative support.

    parent: (N,) int32, the plane that took each one over, itself at first. rules: by the R_ indices. grid, frame: see
    evidence.py; masks, mask_frame: openings.py. fits: (N, 6) float64, order, age: (N,) int32, heap_cost
    (N * partners,) float64 and heap_pair (N * partners, 3) int32: scratch. A merged plane has the neighbours of its
    parts; each of at most `rounds` rounds looks for new ones."""
    run = np.zeros(grid.shape[1] + 2, np.int32)
    looked = np.full((_SLOTS, 3), -1, np.int32)
    for k in range(count):
        age[k] = 0
        weigh(planes, moments, fits, k, rules)
    joined = 0
    order[:count] = np.argsort(_MORE_THAN_T * plane_ints[:count, P_CLUSTER] + planes[:count, T0], kind="mergesort")
    for _round in range(rounds):
        before = joined
        size = weigh_neighbours(
            count, planes, plane_ints, moments, fits, order, age, most, partners, rules, heap_cost, heap_pair
        )
        for _ in range(_MOST_LOOKS * heap_cost.shape[0]):
            if size == 0:
                break
            cost, known = heap_cost[0], heap_pair[0, 2]
            i, j = root_of(parent, heap_pair[0, 0]), root_of(parent, heap_pair[0, 1])
            size = drop_first(heap_cost, heap_pair, size)
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
                    continue  # the same two have been weighed as they are: refused, or in the heap already
                looked[slot, 0], looked[slot, 1], looked[slot, 2] = i, j, version
            now, a, b = pair_cost(planes, moments, fits, i, j, rules)
            if known != version:
                known = -2 - version
                if now <= cost + _SAME:
                    now += cover_cost(planes, i, j, a, b, rules, grid, frame, masks, mask_frame, run)
                    known = version
                if now >= 1.0:
                    continue
                if now > cost + _SAME:
                    size = push(heap_cost, heap_pair, size, now, i, j, known)
                    continue
            absorb(planes, plane_ints, moments, fits, i, j, a, b)
            weigh(planes, moments, fits, i, rules)
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


@inner
def absorb(planes, plane_ints, moments, fits, i, j, a, b):
    """Makes plane i, on the line s = a + b*t, stand for j too; j gets a negative support."""
    p, q = planes[i], planes[j]
    p[FRONT] = max(front_on(planes, fits, i, a, b), front_on(planes, fits, j, a, b))
    p[A], p[B] = a, b
    p[T0], p[T1] = min(p[T0], q[T0]), max(p[T1], q[T1])
    p[MIDDLE] = distance_at(p, 0.5 * (p[T0] + p[T1]))
    p[Z0], p[Z1] = min(p[Z0], q[Z0]), max(p[Z1], q[Z1])
    for m in range(6):
        moments[i, m] += moments[j, m]
    plane_ints[i, P_SUPPORT] += plane_ints[j, P_SUPPORT]
    plane_ints[j, P_SUPPORT] = -1


def merge_rules(view: ViewGeometry, ke_per_m: float, p: Params) -> NDArray[np.float64]:
    """(14,) float64 for the kernels here, by the R_ indices. R_SIGMA_S is the noise of a strip of the fewest pixels."""
    out = np.zeros(14)
    for index, value in (
        (R_TOLERANCE, p.merge_distance_m), (R_SIGMAS, p.line_sigmas), (R_NOISE_CAP, p.merge_noise_cap),
        (R_PRIOR, 1.0 / (p.link_slope_px * p.link_slope_px)), (R_TURN, math.tan(math.radians(p.plane_angle_deg))),
        (R_LONG, p.merge_long_share * p.passable_width_m), (R_SPREAD, p.merge_spread_m),
        (R_SIGMA_S, max(ke_per_m, p.min_sigma_px / view.f_px) / math.sqrt(p.min_support_px)), (R_EMPTY_WEIGHT, p.merge_empty_weight),
        (R_MOST_EMPTY, p.merge_empty_share), (R_BEHIND, p.evidence_behind_m), (R_SLACK, p.opening_slack_m),
        (R_SHIFT, p.merge_shift_m),
        (R_GAP, min(p.join_gap_m, p.join_share * p.passable_width_m, p.join_share * p.passable_height_m)),
    ):  # fmt: skip
        out[index] = value
    return out


def merge_planes(
    count: int, planes: NDArray[np.float64], plane_ints: NDArray[np.int32], moments: NDArray[np.float64],
    parent: NDArray[np.int32], strips: tuple[NDArray[np.int32], NDArray[np.float32], int], view: ViewGeometry,
    image: Intrinsics, ke_per_m: float, masks: NDArray[np.uint8], mask_frame: NDArray[np.float64], params: Params, scratch: Scratch,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:  # fmt: skip
    """`join_planes` on the evidence of the strips (ints, floats, number); returns the grid of evidence and its frame."""
    cell, size, room = params.evidence_cell_px, len(planes), len(planes) * params.merge_partners
    grid = scratch("seen", (-(-view.cols // cell), -(-view.rows // cell)), np.float32)
    frame = nearest_seen(*strips, view, image, cell, grid)
    join_planes(
        count, planes, plane_ints, moments, parent, merge_rules(view, ke_per_m, params), params.merge_rounds,
        params.merge_candidates, params.merge_partners, grid, frame, masks, mask_frame,
        scratch("fits", (size, 6), np.float64), scratch("order", (size,), np.int32), scratch("age", (size,), np.int32),
        scratch("pair_cost", (room,), np.float64), scratch("pairs", (room, 3), np.int32),
    )  # fmt: skip
    return grid, frame

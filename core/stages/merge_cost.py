"""What it costs to make one plane of two pieces, from what is kept of each (Eq. 17): no look at a strip is needed.

Traits of a piece: its line, tangents, heights and misfit in front; the moments of its strips; and what follows from these.
They come as a tuple, so that the same formula serves one pair, and many side by side in one instruction.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inline_ieee, inner, inner_ieee
from ..params import Params
from .line_fit import misfit
from .planes import FRONT, LEAST_S, MIDDLE, T0, T1, Z0, Z1, A, B
from .view_geometry import ViewGeometry

# indices of the rules of merging
(
    R_TOLERANCE, R_SIGMAS, R_NOISE_CAP, R_PRIOR, R_TURN, R_LONG, R_SPREAD, R_SIGMA_S, R_EMPTY_WEIGHT, R_MOST_EMPTY, R_GAP,
    R_BEHIND, R_SLACK, R_SHIFT,
) = range(14)  # fmt: skip
# columns of the traits of a piece: as of a plane, first; its moments; mean and variance of the tangents of its strips; one over
# what a new line may be off them, in 1/x, and that itself; its distances at both ends
(
    Q_A, Q_B, Q_T0, Q_T1, Q_Z0, Q_Z1, Q_FRONT, Q_W, Q_T, Q_S, Q_TT, Q_TS, Q_SS, Q_MEAN, Q_VARIANCE, Q_SCALE, Q_ALLOWED, Q_X0, Q_X1,
) = range(19)  # fmt: skip
TRAITS = 19
TILE = 64
"""Not tuning: pieces whose traits lie side by side."""
_SURELY = 2.0
"""Not tuning: how much more than what both allow lets `surely_apart` answer without a fit."""
REFUSED = 2.0
"""Cost of what may not be: anything from 1 up is too much."""


@inner
def weigh(planes, moments, traits, k, rules):
    """Row k of traits (N, TRAITS) float64 out.

    Noise of the plane, R_SIGMAS of it, allows for more than R_TOLERANCE, but for at most R_NOISE_CAP times that."""
    a, b, t0, t1 = planes[k, A], planes[k, B], planes[k, T0], planes[k, T1]
    traits[k, Q_A], traits[k, Q_B], traits[k, Q_T0], traits[k, Q_T1] = a, b, t0, t1
    traits[k, Q_Z0], traits[k, Q_Z1], traits[k, Q_FRONT] = planes[k, Z0], planes[k, Z1], planes[k, FRONT]
    for m in range(6):
        traits[k, Q_W + m] = moments[k, m]
    w = moments[k, 0]
    mean = moments[k, 1] / w
    s = max(a + b * mean, LEAST_S)
    tolerance = rules[R_TOLERANCE]
    noise = min(rules[R_SIGMAS] / (s * s * math.sqrt(w)), rules[R_NOISE_CAP] * tolerance)
    allowed = (tolerance + noise) * s * s
    traits[k, Q_MEAN], traits[k, Q_VARIANCE] = mean, max(0.0, moments[k, 3] / w - mean * mean)
    traits[k, Q_ALLOWED], traits[k, Q_SCALE] = allowed, 1.0 / allowed
    traits[k, Q_X0], traits[k, Q_X1] = 1.0 / max(a + b * t0, LEAST_S), 1.0 / max(a + b * t1, LEAST_S)


@inner
def of_piece(traits, k):
    """The traits of piece k, from a table (N, TRAITS)."""
    return (
        traits[k, 0], traits[k, 1], traits[k, 2], traits[k, 3], traits[k, 4], traits[k, 5], traits[k, 6], traits[k, 7],
        traits[k, 8], traits[k, 9], traits[k, 10], traits[k, 11], traits[k, 12], traits[k, 13], traits[k, 14], traits[k, 15],
        traits[k, 16], traits[k, 17], traits[k, 18],
    )  # fmt: skip


@inline_ieee
def deviation_squared(p, a, b):
    """Square of how far a new line leaves the strips of p, root mean square, over what is allowed.

    The distance is along the ray, so that walls seen edge-on are judged as strictly as others."""
    turn = b - p[Q_B]
    off = a - p[Q_A] + turn * p[Q_MEAN]
    return p[Q_SCALE] * p[Q_SCALE] * (off * off + turn * turn * p[Q_VARIANCE])


@inner
def apart(planes, i, j, gap_m):
    """Whether two planes are too far from each other, across or down, to be one."""
    if max(planes[i, Z0], planes[j, Z0]) - min(planes[i, Z1], planes[j, Z1]) > gap_m:
        return True
    aside = max(planes[i, T0], planes[j, T0]) - min(planes[i, T1], planes[j, T1])
    return aside * 0.5 * (planes[i, MIDDLE] + planes[j, MIDDLE]) > gap_m


@inline_ieee
def surely_apart(p, q, gap_m):
    """Whether two pieces are more than gap_m apart in height, or share tangents and are so far apart in depth there that no
    line would serve both: a quick answer beside `pair_cost`."""
    t0, t1 = max(p[Q_T0], q[Q_T0]), min(p[Q_T1], q[Q_T1])
    off = abs(p[Q_A] - q[Q_A] + (p[Q_B] - q[Q_B]) * 0.5 * (t0 + t1))
    in_depth = (t0 < t1) & (off > _SURELY * (p[Q_ALLOWED] + q[Q_ALLOWED]))
    return in_depth | (max(p[Q_Z0], q[Q_Z0]) - min(p[Q_Z1], q[Q_Z1]) > gap_m)


@inline_ieee
def front_on(p, a, b):
    """How far the near side of p's strips stands out in front of the line s = a + b*t, at most: FRONT of p there."""
    first = 1.0 / (a + b * p[Q_T0]) - p[Q_X0]
    last = 1.0 / (a + b * p[Q_T1]) - p[Q_X1]
    return p[Q_FRONT] + max(first, last)


@inline_ieee
def pair_cost(p, q, rules):
    """(cost, a, b) of one plane for both p and q, what it would cover apart: REFUSED where one line cannot serve both.

    The line is that of `fit_line` for both together. The cost is the worst of: how far it leaves the strips of either
    (`deviation_squared`), how far all strips lie from it, and how far it would shift the weightier one towards the
    camera; each over what is allowed. Without any branch, so that a processor may do several pairs at a time."""
    w, t, s = p[Q_W] + q[Q_W], p[Q_T] + q[Q_T], p[Q_S] + q[Q_S]
    tt, ts, ss = p[Q_TT] + q[Q_TT], p[Q_TS] + q[Q_TS], p[Q_SS] + q[Q_SS]
    each = 1.0 / w
    t_mean, s_mean = t * each, s * each
    b = (ts - t * s_mean) / (max(0.0, tt - t * t_mean) + rules[R_PRIOR])
    a = s_mean - b * t_mean
    worst = max(deviation_squared(p, a, b), deviation_squared(q, a, b))
    at = a + b * t_mean
    left, right = a + b * min(p[Q_T0], q[Q_T0]), a + b * max(p[Q_T1], q[Q_T1])
    refused = (worst >= 1.0) | (left < 0.5 * at) | (right < 0.5 * at)
    # distances of all four ends on the line; the gap between those that face each other
    p0, p1, q0, q1 = 1.0 / (a + b * p[Q_T0]), 1.0 / (a + b * p[Q_T1]), 1.0 / (a + b * q[Q_T0]), 1.0 / (a + b * q[Q_T1])
    t0, t1 = min(p[Q_T1], q[Q_T1]), max(p[Q_T0], q[Q_T0])
    x0, x1 = p1 if p[Q_T1] < q[Q_T1] else q1, q0 if p[Q_T0] < q[Q_T0] else p0
    ahead, aside = x0 - x1, t0 * x0 - t1 * x1
    refused |= (t0 < t1) & (ahead * ahead + aside * aside > rules[R_GAP] * rules[R_GAP])
    # long ones must agree in direction
    cross = p[Q_A] * q[Q_B] - q[Q_A] * p[Q_B]
    dot = p[Q_A] * q[Q_A] + p[Q_B] * q[Q_B]
    both_long = min(p[Q_T1] - p[Q_T0], q[Q_T1] - q[Q_T0]) > rules[R_LONG] * at
    refused |= both_long & ((dot <= 0.0) | (abs(cross) > rules[R_TURN] * dot))
    shift = max(0.0, max(p[Q_FRONT] + max(p0 - p[Q_X0], p1 - p[Q_X1]), q[Q_FRONT] + max(q0 - q[Q_X0], q1 - q[Q_X1])))
    front = p[Q_FRONT] if p[Q_W] > q[Q_W] else q[Q_FRONT]
    moved = (shift - max(0.0, front)) * at * at / (rules[R_SHIFT] * at * at + rules[R_SIGMA_S])
    refused |= moved >= 1.0
    allowed = rules[R_SPREAD] * at * at + rules[R_SIGMA_S]
    spread = misfit(w, t, s, tt, ts, ss, a, b) / (allowed * allowed)
    cost = max(max(moved, 0.0), math.sqrt(max(worst, spread)))
    return (REFUSED if refused else cost), a, b


@inner
def fill_tiles(order, count, traits, tiles):
    """tiles (ceil(count / TILE) * TRAITS * TILE,) float64 out: for each TILE pieces in `order` all of one trait, then of the
    next. What lies at a known distance may be fetched for many pieces at a time."""
    for k in range(count):
        at = k // TILE * TRAITS * TILE + k % TILE
        for c in range(TRAITS):
            tiles[at + c * TILE] = traits[order[k], c]


@inline_ieee
def of_tile(tiles, at):
    """The traits of the piece whose first one is tiles[at]. at: uint64: indices without a sign need no look at it."""
    return (
        tiles[at], tiles[at + np.uint64(TILE)], tiles[at + np.uint64(2 * TILE)], tiles[at + np.uint64(3 * TILE)],
        tiles[at + np.uint64(4 * TILE)], tiles[at + np.uint64(5 * TILE)], tiles[at + np.uint64(6 * TILE)],
        tiles[at + np.uint64(7 * TILE)], tiles[at + np.uint64(8 * TILE)], tiles[at + np.uint64(9 * TILE)],
        tiles[at + np.uint64(10 * TILE)], tiles[at + np.uint64(11 * TILE)], tiles[at + np.uint64(12 * TILE)],
        tiles[at + np.uint64(13 * TILE)], tiles[at + np.uint64(14 * TILE)], tiles[at + np.uint64(15 * TILE)],
        tiles[at + np.uint64(16 * TILE)], tiles[at + np.uint64(17 * TILE)], tiles[at + np.uint64(18 * TILE)],
    )  # fmt: skip


@inner_ieee
def costs_of_next(tiles, k, end, rules, costs):
    """costs[m] of `pair_cost` for piece k with each of the pieces k + 1 <= m < end, REFUSED where `surely_apart`."""
    p = of_tile(tiles, np.uint64(k // TILE * TRAITS * TILE + k % TILE))
    gap = rules[R_GAP]
    for tile in range((k + 1) // TILE, (end - 1) // TILE + 1):
        begin, before = np.uint64(tile * TRAITS * TILE), np.uint64(tile * TILE)
        for lane in range(np.uint64(max(k + 1 - tile * TILE, 0)), np.uint64(min(end - tile * TILE, TILE))):
            q = of_tile(tiles, begin + lane)
            cost, _, _ = pair_cost(p, q, rules)
            costs[before + lane] = REFUSED if surely_apart(p, q, gap) else cost


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

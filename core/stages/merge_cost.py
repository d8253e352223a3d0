"""What it costs to make one plane of two pieces, from what is kept of each (Eq. 17): no strip is needed.

A piece is a `Piece` of its traits, so that the same formula serves one pair, and many side by side in one instruction.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inline_ieee, inner, inner_ieee, record, record_of
from ..params import Params
from .line_fit import misfit
from .planes import LEAST_S
from .view_geometry import ViewGeometry

MERGE_RULES = record(
    ("tolerance_m", np.float64),
    ("sigmas", np.float64),
    ("noise_cap", np.float64),
    ("slope_prior", np.float64),
    ("turn", np.float64),
    ("long_m", np.float64),
    ("spread_m", np.float64),
    ("sigma_s", np.float64),
    ("empty_weight", np.float64),
    ("most_empty", np.float64),
    ("gap_m", np.float64),
    ("behind_m", np.float64),
    ("slack_m", np.float64),
    ("shift_m", np.float64),
    ("smear_s", np.float64),
)
"""Rules of the merge. tolerance_m: how far a line may leave the strips of a piece; sigmas: of noise beyond that, up to
noise_cap times it; slope_prior: weight of a slope of 0; turn: tangent of the angle within which pieces longer than long_m
agree; spread_m: how far strips may lie from the line; sigma_s: noise of 1/x of a strip of the fewest pixels;
empty_weight, most_empty: cost and limit of empty cells covered; gap_m: gap between pieces; behind_m: evidence so far
behind the plane counts; slack_m: how far an opening may be covered; shift_m: shift towards the camera; smear_s: error of 1/x that all pixels of a
surface have in common, of a camera that smears its edges."""


class Piece(NamedTuple):
    """Properties of a piece for the merge, all float64: its line s = a + b*t, tangents, heights and misfit in front; the moments of
    its strips; mean and variance of their tangents; one over what a new line may be off them, in 1/x, and that itself;
    distances at both ends."""

    a: Any
    b: Any
    t0: Any
    t1: Any
    top_m: Any
    bottom_m: Any
    front_m: Any
    w: Any
    t: Any
    s: Any
    tt: Any
    ts: Any
    ss: Any
    mean_t: Any
    variance_t: Any
    scale: Any
    allowed: Any
    x0: Any
    x1: Any


TRAITS = len(Piece._fields)
TILE = 64
"""Not tuning: pieces whose traits lie side by side."""
_SURELY = 2.0
"""Not tuning: how much more than what both allow lets `surely_apart` answer without a fit."""
REFUSED = 2.0
"""Cost of what may not be: anything from 1 up is too much."""


@inner
def score_piece(plane, traits, k, rules):
    """Writes the traits of a plane as row k of traits (N, TRAITS) float64. rules: a record of MERGE_RULES.

    Noise of the plane, `sigmas` of it, allows for more than tolerance_m, but for at most noise_cap times that."""
    a, b, t0, t1 = plane.a, plane.b, plane.t0, plane.t1
    w = plane.sum_w
    mean = plane.sum_t / w
    s = max(a + b * mean, LEAST_S)
    tolerance = rules.tolerance_m
    noise = rules.sigmas / (s * s * math.sqrt(w)) + rules.smear_s / (s * s)
    noise = min(noise, rules.noise_cap * tolerance)
    allowed = (tolerance + noise) * s * s
    piece = Piece(
        a,
        b,
        t0,
        t1,
        plane.top_m,
        plane.bottom_m,
        plane.front_m,
        w,
        plane.sum_t,
        plane.sum_s,
        plane.sum_tt,
        plane.sum_ts,
        plane.sum_ss,
        mean,
        max(0.0, plane.sum_tt / w - mean * mean),
        1.0 / allowed,
        allowed,
        1.0 / max(a + b * t0, LEAST_S),
        1.0 / max(a + b * t1, LEAST_S),
    )
    for c in range(TRAITS):
        traits[k, c] = piece[c]


@inner
def of_piece(traits, k):
    """The Piece of row k of traits (N, TRAITS)."""
    row = traits[k]
    return Piece(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9],
        row[10], row[11], row[12], row[13], row[14], row[15], row[16], row[17], row[18],
    )  # fmt: skip


@inline_ieee
def deviation_squared(p, a, b):
    """Square of how far a new line leaves the strips of p, root mean square, over what is allowed.

    The distance is along the ray, so that walls seen edge-on are judged as strictly as others."""
    turn = b - p.b
    off = a - p.a + turn * p.mean_t
    return p.scale * p.scale * (off * off + turn * turn * p.variance_t)


@inner
def apart(p, q, gap_m):
    """Whether two planes are too far from each other, across or down, to be one."""
    if max(p.top_m, q.top_m) - min(p.bottom_m, q.bottom_m) > gap_m:
        return True
    aside = max(p.t0, q.t0) - min(p.t1, q.t1)
    return aside * 0.5 * (p.middle_m + q.middle_m) > gap_m


@inline_ieee
def surely_apart(p, q, gap_m):
    """Whether two pieces are more than gap_m apart in height, or share tangents and are so far apart in depth there that no
    line would serve both: a quick answer beside `pair_cost`."""
    t0, t1 = max(p.t0, q.t0), min(p.t1, q.t1)
    off = abs(p.a - q.a + (p.b - q.b) * 0.5 * (t0 + t1))
    in_depth = (t0 < t1) & (off > _SURELY * (p.allowed + q.allowed))
    return in_depth | (max(p.top_m, q.top_m) - min(p.bottom_m, q.bottom_m) > gap_m)


@inline_ieee
def front_on(p, a, b):
    """How far the near side of p's strips stands out in front of the line s = a + b*t, at most: FRONT of p there."""
    first = 1.0 / (a + b * p.t0) - p.x0
    last = 1.0 / (a + b * p.t1) - p.x1
    return p.front_m + max(first, last)


@inline_ieee
def pair_cost(p, q, rules):
    """(cost, a, b) of one plane for both p and q, what it would cover apart: REFUSED where one line cannot serve both.

    The line is that of `fit_line` for both together. The cost is the worst of: how far it leaves the strips of either
    (`deviation_squared`), how far all strips lie from it, and how far it would shift the weightier one towards the
    camera; each over what is allowed. Without any branch, so that a processor may do several pairs at a time."""
    w, t, s = p.w + q.w, p.t + q.t, p.s + q.s
    tt, ts, ss = p.tt + q.tt, p.ts + q.ts, p.ss + q.ss
    each = 1.0 / w
    t_mean, s_mean = t * each, s * each
    b = (ts - t * s_mean) / (max(0.0, tt - t * t_mean) + rules.slope_prior)
    a = s_mean - b * t_mean
    worst = max(deviation_squared(p, a, b), deviation_squared(q, a, b))
    at = a + b * t_mean
    left, right = a + b * min(p.t0, q.t0), a + b * max(p.t1, q.t1)
    refused = (worst >= 1.0) | (left < 0.5 * at) | (right < 0.5 * at)
    # distances of all four ends on the line; the gap between those that face each other
    p0, p1, q0, q1 = 1.0 / (a + b * p.t0), 1.0 / (a + b * p.t1), 1.0 / (a + b * q.t0), 1.0 / (a + b * q.t1)
    t0, t1 = min(p.t1, q.t1), max(p.t0, q.t0)
    x0, x1 = p1 if p.t1 < q.t1 else q1, q0 if p.t0 < q.t0 else p0
    ahead, aside = x0 - x1, t0 * x0 - t1 * x1
    refused |= (t0 < t1) & (ahead * ahead + aside * aside > rules.gap_m * rules.gap_m)
    # long ones must agree in direction
    cross = p.a * q.b - q.a * p.b
    dot = p.a * q.a + p.b * q.b
    both_long = min(p.t1 - p.t0, q.t1 - q.t0) > rules.long_m * at
    refused |= both_long & ((dot <= 0.0) | (abs(cross) > rules.turn * dot))
    shift = max(0.0, max(p.front_m + max(p0 - p.x0, p1 - p.x1), q.front_m + max(q0 - q.x0, q1 - q.x1)))
    front = p.front_m if p.w > q.w else q.front_m
    moved = (shift - max(0.0, front)) * at * at / (rules.shift_m * at * at + rules.sigma_s + rules.smear_s)
    refused |= moved >= 1.0
    allowed = rules.spread_m * at * at + rules.sigma_s + rules.smear_s
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
    """The Piece whose first trait is tiles[at]. at: uint64: an unsigned index needs no test whether it counts from the end."""
    return Piece(
        tiles[at], tiles[at + np.uint64(1 * TILE)], tiles[at + np.uint64(2 * TILE)], tiles[at + np.uint64(3 * TILE)],
        tiles[at + np.uint64(4 * TILE)], tiles[at + np.uint64(5 * TILE)], tiles[at + np.uint64(6 * TILE)], tiles[at + np.uint64(7 * TILE)],
        tiles[at + np.uint64(8 * TILE)], tiles[at + np.uint64(9 * TILE)], tiles[at + np.uint64(10 * TILE)], tiles[at + np.uint64(11 * TILE)],
        tiles[at + np.uint64(12 * TILE)], tiles[at + np.uint64(13 * TILE)], tiles[at + np.uint64(14 * TILE)], tiles[at + np.uint64(15 * TILE)],
        tiles[at + np.uint64(16 * TILE)], tiles[at + np.uint64(17 * TILE)], tiles[at + np.uint64(18 * TILE)],
    )  # fmt: skip


@inner_ieee
def costs_of_next(tiles, k, end, rules, costs):
    """costs[m] of `pair_cost` for piece k with each of the pieces k + 1 <= m < end, REFUSED where `surely_apart`."""
    p = of_tile(tiles, np.uint64(k // TILE * TRAITS * TILE + k % TILE))
    gap = rules.gap_m
    for tile in range((k + 1) // TILE, (end - 1) // TILE + 1):
        begin, before = np.uint64(tile * TRAITS * TILE), np.uint64(tile * TILE)
        for lane in range(np.uint64(max(k + 1 - tile * TILE, 0)), np.uint64(min(end - tile * TILE, TILE))):
            q = of_tile(tiles, begin + lane)
            cost, _, _ = pair_cost(p, q, rules)
            costs[before + lane] = REFUSED if surely_apart(p, q, gap) else cost


def merge_rules(view: ViewGeometry, ke_per_m: float, p: Params, smeared: bool = False) -> NDArray[Any]:
    """(1,) MERGE_RULES of a view and its noise. smeared: whether the camera smears its edges."""
    gap_m = p.smear_join_gap_m if smeared else p.join_gap_m
    return record_of(
        MERGE_RULES,
        p,
        tolerance_m=p.merge_distance_m,
        sigmas=p.line_sigmas,
        noise_cap=p.smear_noise_cap if smeared else p.merge_noise_cap,
        slope_prior=1.0 / (p.link_slope_px * p.link_slope_px),
        turn=math.tan(math.radians(p.plane_angle_deg)),
        long_m=p.merge_long_share * p.passable_width_m,
        spread_m=p.merge_spread_m,
        sigma_s=max(ke_per_m, p.min_sigma_px / view.f_px) / math.sqrt(p.min_support_px),
        empty_weight=p.merge_empty_weight,
        most_empty=p.smear_empty_share if smeared else p.merge_empty_share,
        behind_m=p.evidence_behind_m,
        slack_m=p.opening_slack_m,
        shift_m=p.merge_shift_m,
        smear_s=p.smear_merge_sigmas * ke_per_m if smeared else 0.0,
        gap_m=min(gap_m, p.join_share * p.passable_width_m, p.join_share * p.passable_height_m),
    )

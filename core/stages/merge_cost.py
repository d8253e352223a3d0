"""Cost of replacing two planes by one (Section 5.3), from the moments of each (Eq. 17); strips are not read.

A plane is represented by a `Piece` of its traits, so that one formula serves a single pair and, vectorised, many
pairs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inline_ieee, inner, inner_ieee
from .line_fit import LINE_SIGMAS, misfit
from .planes import LEAST_S


class Piece(NamedTuple):
    """Traits of a plane for the merge, all float64."""

    a: Any  # a, b: line s = a + b t
    b: Any
    t0: Any  # t0, t1: tangents of azimuth of its ends
    t1: Any
    top_m: Any  # top_m, bottom_m: heights
    bottom_m: Any
    front_m: Any  # of PLANE
    w: Any  # w, t, s, tt, ts, ss: moments of its strips
    t: Any
    s: Any
    tt: Any
    ts: Any
    ss: Any
    mean_t: Any  # mean_t, variance_t: mean and variance of the tangents of its strips
    variance_t: Any
    scale: Any  # 1 / allowed
    allowed: Any  # greatest distance of a new line from its strips, in 1/x
    x0: Any  # x0, x1: forward distance of its ends
    x1: Any


TRAITS = len(Piece._fields)
TILE = 64
"""Number of pieces whose traits are stored side by side."""
_SURELY = 2.0
"""Factor on the allowed deviation, beyond which `surely_apart` refuses a pair without a fit."""
REFUSED = 2.0
"""Cost of a pair that must not be merged. Any cost of 1 or more is too great."""


@inner
def score_piece(plane, traits, k, settings):
    """Writes the traits of a plane to row k of traits, (N, TRAITS) float64. settings: a record of VIEW_SETTINGS.

    The allowed deviation is merge_distance_m and LINE_SIGMAS of the plane's noise; the latter is limited to noise_cap *
    merge_distance_m."""
    a, b, t0, t1 = plane.a, plane.b, plane.t0, plane.t1
    w = plane.sum_w
    mean = plane.sum_t / w
    s = max(a + b * mean, LEAST_S)
    tolerance = settings.merge_distance_m
    noise = LINE_SIGMAS / (s * s * math.sqrt(w)) + settings.smear_s / (s * s)
    noise = min(noise, settings.noise_cap * tolerance)
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
    """Returns the Piece of row k of traits, (N, TRAITS)."""
    row = traits[k]
    return Piece(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9],
        row[10], row[11], row[12], row[13], row[14], row[15], row[16], row[17], row[18],
    )  # fmt: skip


@inline_ieee
def deviation_squared(p, a, b):
    """Returns the square of the deviation of a new line from the strips of p, root mean square, over what is allowed.

    The deviation is measured along the ray, so that walls seen edge-on are judged as strictly as others."""
    turn = b - p.b
    off = a - p.a + turn * p.mean_t
    return p.scale * p.scale * (off * off + turn * turn * p.variance_t)


@inner
def apart(p, q, gap_m):
    """True if the horizontal or vertical gap between two planes exceeds gap_m."""
    if max(p.top_m, q.top_m) - min(p.bottom_m, q.bottom_m) > gap_m:
        return True
    aside = max(p.t0, q.t0) - min(p.t1, q.t1)
    return aside * 0.5 * (p.middle_m + q.middle_m) > gap_m


@inline_ieee
def surely_apart(p, q, gap_m):
    """True if two pieces cannot be merged, so that `pair_cost` need not be computed.

    Either the vertical gap exceeds gap_m, or they share tangents of azimuth at which their distances differ too much
    for one line."""
    t0, t1 = max(p.t0, q.t0), min(p.t1, q.t1)
    off = abs(p.a - q.a + (p.b - q.b) * 0.5 * (t0 + t1))
    in_depth = (t0 < t1) & (off > _SURELY * (p.allowed + q.allowed))
    return in_depth | (max(p.top_m, q.top_m) - min(p.bottom_m, q.bottom_m) > gap_m)


@inline_ieee
def front_on(p, a, b):
    """Returns an estimate of front_m of p for the line s = a + b t: by the distance between the two lines at the ends of p, which
    can be greater between them. `measure_planes` computes front_m from the strips after all merges."""
    first = 1.0 / (a + b * p.t0) - p.x0
    last = 1.0 / (a + b * p.t1) - p.x1
    return p.front_m + max(first, last)


@inline_ieee
def pair_cost(p, q, settings):
    """Returns (cost, a, b) of one plane for both p and q, without the cost of covered cells; REFUSED if one line
    cannot serve both.

    The line is that of `fit_line` for the moments of both (Eq. 17). The cost is the maximum of three quotients over
    what is allowed (ours): the deviation from the strips of either piece, the distance of all strips from the line,
    and the shift of the piece of greater weight towards the camera. There is no branch, so that several pairs are
    computed per instruction."""
    w, t, s = p.w + q.w, p.t + q.t, p.s + q.s
    tt, ts, ss = p.tt + q.tt, p.ts + q.ts, p.ss + q.ss
    each = 1.0 / w
    t_mean, s_mean = t * each, s * each
    b = (ts - t * s_mean) / (max(0.0, tt - t * t_mean) + settings.slope_prior)
    a = s_mean - b * t_mean
    worst = max(deviation_squared(p, a, b), deviation_squared(q, a, b))
    at = a + b * t_mean
    left, right = a + b * min(p.t0, q.t0), a + b * max(p.t1, q.t1)
    refused = (worst >= 1.0) | (left < 0.5 * at) | (right < 0.5 * at)
    # distances of all four ends on the line, and the gap between the two facing ends
    p0, p1, q0, q1 = 1.0 / (a + b * p.t0), 1.0 / (a + b * p.t1), 1.0 / (a + b * q.t0), 1.0 / (a + b * q.t1)
    t0, t1 = min(p.t1, q.t1), max(p.t0, q.t0)
    x0, x1 = p1 if p.t1 < q.t1 else q1, q0 if p.t0 < q.t0 else p0
    ahead, aside = x0 - x1, t0 * x0 - t1 * x1
    refused |= (t0 < t1) & (ahead * ahead + aside * aside > settings.gap_m * settings.gap_m)
    # long pieces must agree in direction
    cross = p.a * q.b - q.a * p.b
    dot = p.a * q.a + p.b * q.b
    both_long = min(p.t1 - p.t0, q.t1 - q.t0) > settings.long_m * at
    refused |= both_long & ((dot <= 0.0) | (abs(cross) > settings.turn * dot))
    shift = max(0.0, max(p.front_m + max(p0 - p.x0, p1 - p.x1), q.front_m + max(q0 - q.x0, q1 - q.x1)))
    front = p.front_m if p.w > q.w else q.front_m
    moved = (
        (shift - max(0.0, front)) * at * at / (settings.merge_shift_m * at * at + settings.sigma_s + settings.smear_s)
    )
    refused |= moved >= 1.0
    allowed = settings.merge_spread_m * at * at + settings.sigma_s + settings.smear_s
    spread = misfit(w, t, s, tt, ts, ss, a, b) / (allowed * allowed)
    cost = max(max(moved, 0.0), math.sqrt(max(worst, spread)))
    return (REFUSED if refused else cost), a, b


@inner
def fill_tiles(order, count, traits, tiles):
    """Copies the traits of the planes in `order` to tiles, (ceil(count / TILE) * TRAITS * TILE,) float64.

    A tile holds one trait of TILE pieces, then the next trait, and so on, so that the traits of several pieces are
    loaded by one instruction."""
    for k in range(count):
        at = k // TILE * TRAITS * TILE + k % TILE
        for c in range(TRAITS):
            tiles[at + c * TILE] = traits[order[k], c]


@inline_ieee
def of_tile(tiles, at):
    """Returns the Piece whose first trait is tiles[at]. at: uint64, because an unsigned index needs no test for
    negative values."""
    return Piece(
        tiles[at], tiles[at + np.uint64(1 * TILE)], tiles[at + np.uint64(2 * TILE)], tiles[at + np.uint64(3 * TILE)],
        tiles[at + np.uint64(4 * TILE)], tiles[at + np.uint64(5 * TILE)], tiles[at + np.uint64(6 * TILE)], tiles[at + np.uint64(7 * TILE)],
        tiles[at + np.uint64(8 * TILE)], tiles[at + np.uint64(9 * TILE)], tiles[at + np.uint64(10 * TILE)], tiles[at + np.uint64(11 * TILE)],
        tiles[at + np.uint64(12 * TILE)], tiles[at + np.uint64(13 * TILE)], tiles[at + np.uint64(14 * TILE)], tiles[at + np.uint64(15 * TILE)],
        tiles[at + np.uint64(16 * TILE)], tiles[at + np.uint64(17 * TILE)], tiles[at + np.uint64(18 * TILE)],
    )  # fmt: skip


@inner_ieee
def costs_of_next(tiles, k, end, settings, costs):
    """Computes `pair_cost` of piece k with each of the pieces k + 1..end - 1; REFUSED where `surely_apart`.

    Args:
        tiles: of `fill_tiles`.
        k: a piece, by its position in the order.
        end: end of the pieces.
        costs: (N,) float64 out."""
    p = of_tile(tiles, np.uint64(k // TILE * TRAITS * TILE + k % TILE))
    gap = settings.gap_m
    for tile in range((k + 1) // TILE, (end - 1) // TILE + 1):
        begin, before = np.uint64(tile * TRAITS * TILE), np.uint64(tile * TILE)
        for lane in range(np.uint64(max(k + 1 - tile * TILE, 0)), np.uint64(min(end - tile * TILE, TILE))):
            q = of_tile(tiles, begin + lane)
            cost, _, _ = pair_cost(p, q, settings)
            costs[before + lane] = REFUSED if surely_apart(p, q, gap) else cost

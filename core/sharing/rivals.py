"""Other places at which the frame of a neighbour might be, such as one period of a row of trees or of a facade aside."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .correlation import REACH_SPREADS, Floats, Grid, Scores
from .placement import Placement
from .samples import PRIOR_SIGMAS, SamplePair
from .search import COARSE, EVIDENCE_PER_M, centres, log_probability, scored, searched, turns

COMMON = Grid(COARSE.cell_m, COARSE.turn_rad, 0.5, flat=True)
"""Counts the samples in the common area: within 1.5 m of own ones."""
AROUND = Grid(COARSE.cell_m, COARSE.turn_rad, 2.5 / REACH_SPREADS, flat=True)
"""Counts the samples where the own vehicle has observed something: within 2.5 m of own ones. Within 1.5 m, sides of houses
along a street would not count where they do not match."""
PEAK = Grid(0.1, COARSE.turn_rad, COARSE.spread_m)
"""Compares the best place with others. On the coarse grid their scores depend on how far they are from its cells: of a
facade with a period of 3 m, 7.5 cells, places one period apart differed by a factor of 1000 or more."""
MOST_RIVALS, RIVAL_APART_M = 8, 0.7
"""Greatest number of other places that are compared, and their distance."""
RIVAL_M = 1.6
"""Least distance of another place."""
LEAST_RIVAL_M = 40.0
"""Least length in the common area of another place at which the share of it that matches is compared. It is less than the
least length of a fit, because at the true place less of a row may be common."""
LEAST_FAIR_M = 25.0
"""The same for `Rivals.fair_log_odds`, in the area of AROUND."""
SHARE_M, LEAST_SHARE_M = 0.6, 1.0
"""Distance from the best place at which its share is taken; least length by which a share is divided."""


@dataclass(frozen=True, slots=True)
class Rivals:
    """How the best place compares with the others."""

    log_odds: float  # of the best place against the most probable other one
    share: float  # greatest share of the common area that matches at another place, over that at the best place
    # least log-odds of the best place against another one if as much were common at both as at that with less: a place
    # must not be the best because more is common there
    fair_log_odds: float


def rivals_of(
    pairs: tuple[SamplePair, ...], centre: Floats, prior: Placement, coarse: Scores, reach_m: float, fine_m: float
) -> Rivals:
    """Returns how the best place of a search on the COARSE grid, up to reach_m, compares with the others.

    centre: relative to the pivot; fine_m: greatest length that matches around the best place on a finer grid."""
    value = log_probability(coarse, prior)
    best = np.unravel_index(int(np.argmax(value)), value.shape)
    shift = coarse.shift_m
    off = float(shift[best[1]]), float(shift[best[2]])
    apart_m = np.hypot(shift[:, None] - off[0], shift[None] - off[1])
    far, near = apart_m > RIVAL_M, apart_m <= SHARE_M
    others = _separate(shift, np.where(far, value.max(axis=0), -np.inf))
    log_odds = _log_odds(pairs, centre, prior, off, others)
    common_m = searched(pairs, centre, prior, COMMON, reach_m).value
    share = np.where(common_m >= LEAST_RIVAL_M, coarse.value / np.maximum(common_m, LEAST_SHARE_M), 0.0)
    best_share = max(float(share[:, near].max()), fine_m / max(float(common_m[best]), LEAST_SHARE_M))
    within = far & (np.hypot(shift[:, None], shift[None]) <= PRIOR_SIGMAS * prior.sigma_m)
    rival_share = float(share[:, within].max(initial=0.0)) / max(best_share, 1e-9)
    around_m = searched(pairs, centre, prior, AROUND, reach_m).value
    fair = _fair_log_odds(coarse, value, around_m, max(fine_m, float(coarse.value[best])))
    fair_log_odds = float(fair[(around_m >= LEAST_FAIR_M) & far].min(initial=math.inf))
    return Rivals(log_odds, rival_share, fair_log_odds)


def _fair_log_odds(coarse: Scores, value: Floats, around_m: Floats, best_m: float) -> Floats:
    """Returns the log-odds of the best place against each other one, (K, C, C), if the length around own samples were
    that of the place where it is less.

    value: log-probability of each place; around_m: length around own samples; best_m: length that matches at the best
    place."""
    best = np.unravel_index(int(np.argmax(value)), value.shape)
    without = value - EVIDENCE_PER_M * coarse.value  # by the positions alone
    best_share = best_m / max(float(around_m[best]), LEAST_SHARE_M)
    share = coarse.value / np.maximum(around_m, LEAST_SHARE_M)
    length_m = np.minimum(around_m, around_m[best])
    return np.asarray(without[best] - without + EVIDENCE_PER_M * length_m * (best_share - share))


def _separate(shift_m: Floats, value: Floats) -> list[tuple[float, float]]:
    """Returns the most probable other places, each RIVAL_APART_M from the others along x or y.

    shift_m: (C,) shifts of the coarse grid; value: (C, C) log-probability of each, -inf: none of another place."""
    left, found = value.copy(), list[tuple[float, float]]()
    while len(found) < MOST_RIVALS and np.isfinite(left).any():
        i, j = np.unravel_index(int(np.argmax(left)), left.shape)
        x, y = float(shift_m[i]), float(shift_m[j])
        found.append((x, y))
        left[np.ix_(np.abs(shift_m - x) < RIVAL_APART_M, np.abs(shift_m - y) < RIVAL_APART_M)] = -np.inf
    return found


def _log_odds(
    pairs: tuple[SamplePair, ...],
    centre: Floats,
    prior: Placement,
    off: tuple[float, float],
    rivals: list[tuple[float, float]],
) -> float:
    """Returns the logarithm of the probability of the place `off` over that of the most probable rival, each at the
    best place within a cell of the coarse grid."""
    places = np.array([off, *rivals])
    turn_rad = turns(prior, PEAK)
    at = (places[:, None] + centres(centre, turn_rad, prior)).reshape(-1, 2)
    found = scored(pairs, at, np.tile(turn_rad, len(places)), PEAK, COARSE.cell_m)
    values = found.value.reshape(len(places), len(turn_rad), *found.value.shape[1:])
    best = []
    for k, (place, value) in enumerate(zip(places, values, strict=True)):
        x, y = found.shift_m + place[0], found.shift_m + place[1]
        logs = log_probability(replace(found, value=value, turn_rad=turn_rad), prior, (place[0], place[1]))
        other = np.hypot(x[:, None] - off[0], y - off[1]) > RIVAL_M
        best.append(float(logs[:, other if k else slice(None)].max(initial=-math.inf)))
    return best[0] - max(best[1:], default=-math.inf)

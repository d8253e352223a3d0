"""Places the frame of a neighbour by planes that both vehicles have observed: x, y, z and yaw, with their uncertainty.

1. The neighbour's planes are shifted and rotated on a grid around the place given by the positions, and compared with
the own planes (`correlation.py`).
2. Around the best place a fine grid gives the probability of each shift and rotation: the prior by the positions times
exp(score). Its mean is the place, its covariance the uncertainty (Olson 2009): large along a street whose facades do
not determine the place, and large where two places fit.
3. The height follows from tops and bottoms of planes at the same place, if enough agree.
4. The fit is refused if too little matches, if planes in the common area do not agree, if another place is probable,
too, if the place is uncertain, or if it contradicts the positions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from .correlation import Floats, Grid, turned
from .placement import Placement
from .rivals import Rivals, rivals_of
from .samples import (
    MOST_OWN_SAMPLES,
    MOST_SAMPLES,
    PRIOR_SIGMAS,
    SAMPLE_M,
    SamplePair,
    Samples,
    common_samples,
    inside,
    sample_pairs,
    samples_of,
)
from .search import COARSE, centres, log_probability, searched

FINE = Grid(0.1, math.radians(0.5), 0.2)
FINE_REACH_M, FINE_EXTENDED_M = 1.2, 1.5
"""Reach of the fine grid, and by how much long planes are extended for it: by more than it reaches."""
MATCH_M = 0.3
"""Greatest distance of a sample that matches."""
OVERLAP_M = 1.5
"""A sample with a sample of the other vehicle within this distance should match."""
LEAST_AGREEING = 0.7
"""Least share of the samples in the common area that match, mean of both vehicles. In simulated streets and rows of
trees it was 0.67 to 0.87 for true places, up to 0.66 for other streets (one of 24 fits: 0.70), and up to 0.683 for places
one period of a row of trees off."""
LEAST_MATCHED_M, LEAST_MATCHED_PLANES = 70.0, 6
"""Least length and number of matched planes of each vehicle. With less, vehicles that fly towards each other have
observed opposite ends of the same obstacles only, and their fits were up to 0.9 m wrong."""
SYSTEMATIC_M = 0.2
"""Standard deviation of what all obstacles have in common, such as their thickness between opposite views."""
MOST_PRIOR_M, MOST_PRIOR_RAD = 6.0, math.radians(10.0)
"""Greatest uncertainty of the place by position, which determines the size of the search."""
MAX_SIGMA_M, MAX_SIGMA_YAW_RAD = 0.6, math.radians(2.5)
LEAST_LOG_ODDS = 3.0
"""Another place must be less probable by exp(LEAST_LOG_ODDS)."""
MOST_RIVAL_SHARE = 1.05
"""At no other place may a share of the common area match that is this much greater: in a row of similar trees more of them
match where more of the row is common. For true places it was 0.79 to 1.03, for places one period off 1.08 to 1.16."""
LEAST_FAIR_LOG_ODDS = 0.0
"""No other place may be more probable if as much were common there. For places one period of a row of trees off it was
-0.5 at most, for true places 0.1 or more where the positions are 3 m wrong."""
MOST_EDGE = 0.1
"""Greatest probability at the edge of the fine grid, of its shifts or rotations. A place beyond the edge would be found
at the edge, with a small uncertainty."""
POSITION_SIGMAS = 4.0
Z_TOLERANCE_M, LEAST_HEIGHTS, LEAST_HEIGHT_SHARE = 0.3, 4, 0.35


class FitResult(Code):
    """Result of a fit: ACCEPTED, or why it is refused."""

    ACCEPTED = "accepted", "the frames are aligned by planes of both vehicles"
    TOO_LITTLE = "too_little", "too few planes in common"
    AMBIGUOUS = "ambiguous", "another place fits almost as well"
    INCONSISTENT = "inconsistent", "planes in the common area do not agree"
    UNOBSERVABLE = "unobservable", "the common planes do not fix the place in every direction"
    AGAINST_POSITION = "against_position", "the fit contradicts the positions"
    TOO_UNCERTAIN = "too_uncertain", "the positions are too uncertain to begin with"
    FAILED = "failed", "the fit could not be computed"


@dataclass(frozen=True, slots=True)
class Fit:
    """A fit."""

    result: FitResult  # result
    placement: Placement  # refined if the result is ACCEPTED, otherwise that by position
    agreeing: float = math.nan  # share of the samples in the common area that match


@dataclass(frozen=True, slots=True)
class _Posterior:
    """Probability of the place of the neighbour's frame."""

    place: tuple[float, float, float]  # x, y of the centre in the own frame, yaw
    covariance: Floats  # (3, 3) of place
    rivals: Rivals  # how it compares with other places
    edge: float  # probability at the edge of the fine grid, of its shifts or rotations

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the centre in the most uncertain direction."""
        return math.hypot(SYSTEMATIC_M, math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))

    @property
    def sigma_yaw_rad(self) -> float:
        """Standard deviation of the yaw."""
        return math.sqrt(float(self.covariance[2, 2]))


@dataclass(frozen=True, slots=True)
class _Matches:
    """Samples of both vehicles at the same place."""

    # other, own: (K,) rows of the planes of matched samples of the neighbour, and of the nearest own samples
    other: NDArray[np.intp]
    own: NDArray[np.intp]
    own_planes: int  # number of own planes with a match
    agreeing: float  # share of the samples in the common area that match, mean of both vehicles


def fit(other_box: Floats, own_box: Floats, prior: Placement) -> Fit:
    """Returns the fit of a neighbour's frame.

    Args:
        other_box: (M, 6) planes in the frame of the neighbour.
        own_box: (N, 6) planes in the own frame.
        prior: placement by position."""
    if prior.sigma_m > MOST_PRIOR_M or prior.sigma_yaw_rad > MOST_PRIOR_RAD:
        return Fit(FitResult.TOO_UNCERTAIN, prior)
    pivot = np.array([*prior.pivot_m[:2], *prior.pivot_m[:2], prior.pivot_m[2], prior.pivot_m[2]])
    other_box, own_box = other_box - pivot, own_box.astype(np.float64)
    other, own = common_samples(samples_of(other_box, MOST_SAMPLES), samples_of(own_box, MOST_OWN_SAMPLES), prior)
    if _too_little(other.plane) or _too_little(own.plane):
        return Fit(FitResult.TOO_LITTLE, prior)
    centre = other.points.mean(axis=0)
    other = replace(other, points=other.points - centre)
    fine_pairs = sample_pairs(other, own, own_box, FINE_EXTENDED_M)
    found = _posterior(sample_pairs(other, own, own_box), fine_pairs, centre, prior)
    matches = _matches(other, own, found.place)
    result = _judged(found, matches, centre, prior)
    if result is not FitResult.ACCEPTED:
        return Fit(result, prior, matches.agreeing)
    z_m, sigma_z_m = _height(other_box, own_box, matches, prior)
    x, y, yaw = found.place
    px, py = (centre + np.array(prior.pivot_m[:2])).tolist()
    placement = replace(
        prior,
        yaw_rad=yaw,
        pivot_m=(px, py, prior.pivot_m[2]),
        at_m=(x, y, z_m),
        sigma_m=found.sigma_m,
        sigma_z_m=sigma_z_m,
        sigma_yaw_rad=found.sigma_yaw_rad,
        refined=True,
    )
    return Fit(FitResult.ACCEPTED, placement, matches.agreeing)


def agree(a: Placement, b: Placement) -> bool:
    """True if two fits of the same frame agree to the sum of their standard deviations, at the middle of the planes."""
    there = a.points(np.array([b.pivot_m]))[0] - np.array(b.at_m)
    turned_rad = abs(math.remainder(a.yaw_rad - b.yaw_rad, math.tau))
    return math.hypot(there[0], there[1]) <= a.sigma_m + b.sigma_m and turned_rad <= a.sigma_yaw_rad + b.sigma_yaw_rad


def _too_little(plane: NDArray[np.intp]) -> bool:
    return SAMPLE_M * len(plane) < LEAST_MATCHED_M or len(np.unique(plane)) < LEAST_MATCHED_PLANES


def _posterior(
    pairs: tuple[SamplePair, ...], fine_pairs: tuple[SamplePair, ...], centre: Floats, prior: Placement
) -> _Posterior:
    """Returns the probability of the place of the centre. centre: relative to the pivot; fine_pairs: what the fine grid
    compares."""
    reach_m = PRIOR_SIGMAS * prior.sigma_m + 1.0
    coarse = searched(pairs, centre, prior, COARSE, reach_m)
    value = log_probability(coarse, prior)
    _, i, j = np.unravel_index(int(np.argmax(value)), value.shape)
    off = float(coarse.shift_m[i]), float(coarse.shift_m[j])
    fine = searched(fine_pairs, centre, prior, FINE, FINE_REACH_M, off)
    rivals = rivals_of(pairs, centre, prior, coarse, reach_m, float(fine.value.max()))
    value = log_probability(fine, prior, off)
    p = np.exp(value - value.max())
    p /= p.sum()
    x, y = (fine.shift_m + o for o in off)
    at = centres(centre, fine.turn_rad, prior)
    whole = np.zeros_like(p)
    v = np.stack([at[:, 0, None, None] + x[:, None] + whole, at[:, 1, None, None] + y + whole])
    v = np.concatenate([v, (fine.turn_rad[:, None, None] + whole)[None]]).reshape(3, -1)
    mean = v @ p.ravel()
    rest = v - mean[:, None]
    steps = np.array([FINE.cell_m, FINE.cell_m, FINE.turn_rad])
    covariance = (rest * p.ravel()) @ rest.T + np.diag(steps**2 / 12.0)
    place = float(mean[0]), float(mean[1]), math.remainder(float(mean[2]), math.tau)
    return _Posterior(place, covariance, rivals, 1.0 - float(p[1:-1, 1:-1, 1:-1].sum()))


def _matches(other: Samples, own: Samples, place: tuple[float, float, float]) -> _Matches:
    """Returns what matches at this place."""
    at = turned(other.points, place[2]) + np.array(place[:2])
    near = inside(own.points, at, OVERLAP_M)
    own = own.part(near)
    if not len(own.plane):
        none = np.zeros(0, np.intp)
        return _Matches(none, none, 0, 0.0)
    apart, nearest = np.empty(len(at)), np.empty(len(at), np.intp)
    own_apart = np.full(len(own.plane), np.inf)
    for begin in range(0, len(at), 256):
        rows = np.s_[begin : begin + 256]
        gap = np.hypot(at[rows, 0, None] - own.points[:, 0], at[rows, 1, None] - own.points[:, 1])
        nearest[rows], apart[rows] = np.argmin(gap, axis=1), gap.min(axis=1)
        own_apart = np.minimum(own_apart, gap.min(axis=0))
    matched = apart <= MATCH_M
    shares = [float((d <= MATCH_M).sum()) / max(1, int((d <= OVERLAP_M).sum())) for d in (apart, own_apart)]
    own_planes = len(np.unique(own.plane[own_apart <= MATCH_M]))
    return _Matches(other.plane[matched], own.plane[nearest[matched]], own_planes, 0.5 * sum(shares))


def _judged(found: _Posterior, matches: _Matches, centre: Floats, prior: Placement) -> FitResult:
    """Returns the result of a fit."""
    if _too_little(matches.other) or matches.own_planes < LEAST_MATCHED_PLANES:
        return FitResult.TOO_LITTLE
    if matches.agreeing < LEAST_AGREEING:
        return FitResult.INCONSISTENT
    rivals = found.rivals
    if not (
        rivals.log_odds >= LEAST_LOG_ODDS
        and rivals.share <= MOST_RIVAL_SHARE
        and rivals.fair_log_odds >= LEAST_FAIR_LOG_ODDS
    ):
        return FitResult.AMBIGUOUS
    if found.sigma_m > MAX_SIGMA_M or found.sigma_yaw_rad > MAX_SIGMA_YAW_RAD:
        return FitResult.UNOBSERVABLE
    x, y, yaw = found.place
    by_position = centres(centre, np.array([yaw]), prior)[0]
    far = math.hypot(x - by_position[0], y - by_position[1]) > POSITION_SIGMAS * prior.sigma_m
    if far or found.edge > MOST_EDGE:
        return FitResult.AGAINST_POSITION
    return FitResult.ACCEPTED


def _height(other_box: Floats, own_box: Floats, matches: _Matches, prior: Placement) -> tuple[float, float]:
    """Returns (z, its standard deviation): the difference on which most tops and bottoms agree, otherwise that by
    position."""
    pairs = np.unique(np.column_stack([matches.other, matches.own]), axis=0)
    difference = (own_box[pairs[:, 1], 4:6] - other_box[pairs[:, 0], 4:6]).ravel()
    difference = difference[np.abs(difference - prior.at_m[2]) <= POSITION_SIGMAS * prior.sigma_z_m]
    if len(difference) < LEAST_HEIGHTS:
        return prior.at_m[2], prior.sigma_z_m
    close = np.abs(difference[:, None] - difference[None]) <= Z_TOLERANCE_M
    best = int(np.argmax(close.sum(axis=1)))
    support = close[best]
    if support.sum() < max(LEAST_HEIGHTS, LEAST_HEIGHT_SHARE * len(difference)):
        return prior.at_m[2], prior.sigma_z_m
    return float(np.median(difference[support])), Z_TOLERANCE_M / 2.0

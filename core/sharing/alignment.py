"""Places the frame of a neighbour by planes that both vehicles have observed: a rigid fit of x, y, z and yaw.

1. The neighbour's planes are shifted and rotated on a grid around the place given by the positions, and compared with
the own planes (`correlation.py`).
2. The best shift is refined by least squares: distances of samples of the neighbour's planes to the lines of the own
planes, with Huber weights.
3. The height follows from tops and bottoms of matched planes, if enough agree.
4. The fit is refused if too little matches, if overlapping planes do not agree, if another shift fits almost as well,
if the planes do not determine the place in every direction, or if the fit contradicts the positions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from .correlation import FINE, balanced_weights, best_shift
from .placement import Floats, Placement

SAMPLE_M = 0.5
"""Distance of samples along planes."""
GATE_M, LAST_GATE_M = 1.2, 0.5
"""Greatest distance of a sample to its line, in the first and in the last steps."""
OVERLAP_M = 1.5
"""A sample with a parallel own plane within this distance should match."""
PARALLEL_RAD = math.radians(15.0)
STEPS = 12
HUBER_M = 0.15
LEAST_MATCHED_M = 20.0
LEAST_MATCHED_PLANES = 6
"""Least number of matched planes of each vehicle."""
MOST_PRIOR_M, MOST_PRIOR_RAD = 6.0, math.radians(10.0)
"""Greatest uncertainty of the place by position, which determines the size of the search."""
MOST_LENGTH_M, AROUND_M = 200.0, 40.0
"""Length of the longest planes that are used; radius around the middle in which samples count."""
LEAST_AGREEING = 0.6
"""Share of the overlapping length that must match."""
NOISE_M = 0.2
"""Noise of one sample, including that neighbouring samples of a plane are not independent."""
MAX_SIGMA_M, MAX_SIGMA_YAW_RAD = 0.25, math.radians(0.8)
POSITION_SIGMAS = 4.0
Z_TOLERANCE_M, LEAST_HEIGHTS, LEAST_HEIGHT_SHARE = 0.3, 4, 0.35
START_NOISE = np.array([0.15, 0.15, math.radians(0.6)])
"""Standard deviation of the fine search on the grid: x, y, yaw."""
MOST_RING = 0.93
"""Greatest score at 0.7 to 1 m from the best place, over the best score."""
MOST_RIVAL = 0.9
"""Greatest score of another place, over the best score."""
LEAST_SIGMA_M, LEAST_SIGMA_YAW_RAD = 0.5, math.radians(0.8)
"""Least uncertainty of a fit: accepted fits of vehicles that fly in opposite directions were up to 0.9 m wrong."""
FINE_REACH_M, FINE_REACH_RAD = 1.1, math.radians(1.5)
MOST_PLANES = 120
LEAST_LENGTH_M = 0.8


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
    """A fit.

    Attributes:
        result: result.
        placement: refined if the result is ACCEPTED, otherwise that by position.
        matched_m: length of matched planes.
        rms_m: root mean square of their distances."""

    result: FitResult
    placement: Placement
    matched_m: float = 0.0
    rms_m: float = math.nan


@dataclass(frozen=True, slots=True)
class _Segments:
    """N planes.

    Attributes:
        a, b: (N, 2) ends.
        along: (N, 2) directions.
        length: (N,).
        heights: (N, 2) top and bottom."""

    a: Floats
    b: Floats
    along: Floats
    length: Floats
    heights: Floats


@dataclass(frozen=True, slots=True)
class _Samples:
    """S samples of planes.

    Attributes:
        points: (S, 2) relative to the pivot.
        along: (S, 2) directions of their planes.
        plane: (S,) indices of their planes."""

    points: Floats
    along: Floats
    plane: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class _Solution:
    """Solution of the least squares.

    Attributes:
        place: x, y, yaw.
        info: (3, 3) information matrix.
        gap_m, nearest, matched: of the samples, see `_matches`."""

    place: tuple[float, float, float]
    info: Floats
    gap_m: Floats
    nearest: NDArray[np.intp]
    matched: NDArray[np.bool_]


def fit(other_box: Floats, own_box: Floats, prior: Placement) -> Fit:
    """Returns the fit of a neighbour's frame.

    Args:
        other_box: (M, 6) planes in the frame of the neighbour.
        own_box: (N, 6) planes in the own frame.
        prior: placement by position."""
    if prior.sigma_m > MOST_PRIOR_M or prior.sigma_yaw_rad > MOST_PRIOR_RAD:
        return Fit(FitResult.TOO_UNCERTAIN, prior)
    reach_m = 3.0 * prior.sigma_m + 1.0
    pivot = np.array([*prior.pivot_m[:2], *prior.pivot_m[:2], prior.pivot_m[2], prior.pivot_m[2]])
    own, other = _segments(own_box), _segments(other_box - pivot)
    other = _overlapping(other, own, prior, reach_m)
    if len(own.length) < LEAST_MATCHED_PLANES or len(other.length) < LEAST_MATCHED_PLANES:
        return Fit(FitResult.TOO_LITTLE, prior)
    samples, own_samples = _around(_samples(other), _samples(own), prior)
    if not len(samples.points) or not len(own_samples.points):
        return Fit(FitResult.TOO_LITTLE, prior)
    lines = samples.points, samples.along, own_samples.points, own_samples.along
    coarse, rival, _ = best_shift(*lines, (*prior.at_m[:2], prior.yaw_rad), reach_m, 3.0 * prior.sigma_yaw_rad)
    start, _, ring = best_shift(*lines, coarse, FINE_REACH_M, FINE_REACH_RAD, FINE)
    solution = _refined(samples, own, start)
    if solution is None:
        return Fit(FitResult.TOO_LITTLE, prior)
    (x, y, yaw), matched = solution.place, solution.matched
    matched_m, rms_m = SAMPLE_M * int(matched.sum()), float(np.sqrt(np.mean(solution.gap_m[matched] ** 2)))
    result = _judged(samples, own, solution, rival, ring)
    moved_m = math.hypot(x - prior.at_m[0], y - prior.at_m[1])
    turned_rad = abs(math.remainder(yaw - prior.yaw_rad, math.tau))
    if result is FitResult.ACCEPTED and (
        moved_m > POSITION_SIGMAS * prior.sigma_m or turned_rad > POSITION_SIGMAS * prior.sigma_yaw_rad
    ):
        result = FitResult.AGAINST_POSITION
    if result is not FitResult.ACCEPTED:
        return Fit(result, prior, matched_m, rms_m)
    covariance = np.linalg.inv(solution.info)
    z_m, sigma_z_m = _height(other, own, samples.plane[matched], solution.nearest[matched], prior)
    placement = replace(
        prior,
        yaw_rad=yaw,
        at_m=(x, y, z_m),
        sigma_m=max(LEAST_SIGMA_M, math.sqrt(max(covariance[0, 0], covariance[1, 1]))),
        sigma_z_m=sigma_z_m,
        sigma_yaw_rad=max(LEAST_SIGMA_YAW_RAD, math.sqrt(covariance[2, 2])),
        refined=True,
    )
    return Fit(FitResult.ACCEPTED, placement, matched_m, rms_m)


def agree(a: Placement, b: Placement) -> bool:
    """True if two fits of the same frame agree to 0.4 m and 1.2 degrees."""
    there = a.points(np.array([b.pivot_m]))[0] - np.array(b.at_m)
    turned = abs(math.remainder(a.yaw_rad - b.yaw_rad, math.tau))
    return math.hypot(there[0], there[1]) <= 0.4 and turned <= math.radians(1.2)


def _segments(box: Floats) -> _Segments:
    """Returns the longest planes of finite size."""
    length = np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1])
    fits = (length >= LEAST_LENGTH_M) & (length <= MOST_LENGTH_M)
    good = np.flatnonzero(np.isfinite(box).all(axis=1) & fits)
    good = np.sort(good[np.argsort(-length[good], kind="stable")[:MOST_PLANES]])
    a, b, size = box[good, 0:2], box[good, 2:4], length[good]
    return _Segments(a, b, (b - a) / size[:, None], size, box[good, 4:6])


def _overlapping(other: _Segments, own: _Segments, prior: Placement, reach_m: float) -> _Segments:
    """Returns the planes of the neighbour that may have been observed by the own vehicle, too."""
    if not len(own.length) or not len(other.length):
        return other
    c, s = math.cos(prior.yaw_rad), math.sin(prior.yaw_rad)
    R = np.array([[c, s], [-s, c]])
    low = np.minimum(own.a, own.b).min(axis=0) - reach_m
    high = np.maximum(own.a, own.b).max(axis=0) + reach_m
    ends = [end @ R + np.array(prior.at_m[:2]) for end in (other.a, other.b)]
    near = (np.maximum(*ends) >= low).all(axis=1) & (np.minimum(*ends) <= high).all(axis=1)
    return _Segments(other.a[near], other.b[near], other.along[near], other.length[near], other.heights[near])


def _samples(segments: _Segments) -> _Samples:
    """Returns samples along all planes, at least two on each."""
    count = np.maximum(2, np.ceil(segments.length / SAMPLE_M).astype(int))
    plane = np.repeat(np.arange(len(count)), count)
    share = np.concatenate([(np.arange(n) + 0.5) / n for n in count])
    points = segments.a[plane] + share[:, None] * (segments.b - segments.a)[plane]
    return _Samples(points, segments.along[plane], plane)


def _around(other: _Samples, own: _Samples, prior: Placement) -> tuple[_Samples, _Samples]:
    """Returns the samples within AROUND_M of the middle of those of the neighbour, which limits the grid of the
    search."""
    if not len(other.points):
        return other, own
    middle = np.median(other.points, axis=0)
    c, s = math.cos(prior.yaw_rad), math.sin(prior.yaw_rad)
    there = middle @ np.array([[c, s], [-s, c]]) + np.array(prior.at_m[:2])
    return _within(other, middle, AROUND_M), _within(own, there, 1.5 * AROUND_M)


def _within(samples: _Samples, middle: Floats, radius_m: float) -> _Samples:
    near = np.hypot(*(samples.points - middle).T) <= radius_m
    return _Samples(samples.points[near], samples.along[near], samples.plane[near])


def _refined(samples: _Samples, own: _Segments, start: tuple[float, float, float]) -> _Solution | None:
    """Returns the least-squares solution from a start; None: too little matches."""
    x, y, yaw = start
    info = np.zeros((3, 3))
    balance = balanced_weights(samples.along)
    balance *= len(balance) / balance.sum()
    for step in range(STEPS):
        gate_m = GATE_M if step < STEPS // 2 else LAST_GATE_M
        p, gap_m, nearest, near = _matches(samples, own, (x, y, yaw), gate_m)
        if SAMPLE_M * int(near.sum()) < LEAST_MATCHED_M or len(np.unique(samples.plane[near])) < LEAST_MATCHED_PLANES:
            return None
        normal = np.column_stack([-own.along[nearest, 1], own.along[nearest, 0]])[near]
        rows = _rows(normal, p[near] - np.array([x, y]), gap_m[near], NOISE_M)
        weight = balance[near]
        # the grid search determines what few planes show, such as the place along a street
        off = np.array([x - start[0], y - start[1], yaw - start[2]]) / START_NOISE
        J, r = np.concatenate([rows[0], np.diag(1.0 / START_NOISE)]), np.concatenate([rows[1], off])
        w = np.concatenate([weight, np.ones(3)])
        info = J.T @ J
        normal_matrix = (J * w[:, None]).T @ J
        if np.linalg.cond(normal_matrix) > 1e7:
            break
        dx, dy, dyaw = np.linalg.solve(normal_matrix, -(J * w[:, None]).T @ r).tolist()
        x, y, yaw = x + dx, y + dy, yaw + dyaw
    _, gap_m, nearest, near = _matches(samples, own, (x, y, yaw), LAST_GATE_M)
    if not near.any():
        return None
    return _Solution((x, y, math.remainder(yaw, math.tau)), info, gap_m, nearest, near)


def _rows(direction: Floats, arm: Floats, gap_m: Floats, noise_m: float) -> tuple[Floats, Floats]:
    """Returns (J (K, 3), residuals (K,)) in units of their noise, with Huber weights.

    direction: of the distances; arm: of the rotation."""
    J = np.column_stack([direction, direction[:, 1] * arm[:, 0] - direction[:, 0] * arm[:, 1]])
    scale = np.sqrt(np.minimum(1.0, HUBER_M / np.maximum(np.abs(gap_m), 1e-9))) / noise_m
    return J * scale[:, None], gap_m * scale


def _matches(
    samples: _Samples, own: _Segments, place: tuple[float, float, float], gate_m: float
) -> tuple[Floats, Floats, NDArray[np.intp], NDArray[np.bool_]]:
    """Matches samples with own planes.

    Returns:
        Samples (S, 2) in the own frame; signed distance of each to the nearest parallel own plane; that plane; True
            if it is within the gate."""
    x, y, yaw = place
    c, s = math.cos(yaw), math.sin(yaw)
    R = np.array([[c, s], [-s, c]])
    p, along = samples.points @ R + np.array([x, y]), samples.along @ R
    off = p[:, None, :] - own.a[None]
    t = (off * own.along[None]).sum(axis=2)
    gap = off[:, :, 1] * own.along[None, :, 0] - off[:, :, 0] * own.along[None, :, 1]
    beside = np.maximum(0.0, np.maximum(-t, t - own.length[None]))
    cost = np.hypot(gap, 2.0 * beside)
    cost[along @ own.along.T < math.cos(PARALLEL_RAD)] = np.inf
    nearest = np.argmin(cost, axis=1)
    rows = np.arange(len(p))
    near = (cost[rows, nearest] < gate_m) & (beside[rows, nearest] <= 0.3)
    return p, gap[rows, nearest], nearest, near


def _judged(samples: _Samples, own: _Segments, solution: _Solution, rival: float, ring: float) -> FitResult:
    """Returns the result of a fit. rival, ring: of `best_shift`."""
    matched, info = solution.matched, solution.info
    if SAMPLE_M * int(matched.sum()) < LEAST_MATCHED_M or len(np.unique(samples.plane[matched])) < LEAST_MATCHED_PLANES:
        return FitResult.TOO_LITTLE
    if len(np.unique(solution.nearest[matched])) < LEAST_MATCHED_PLANES:
        return FitResult.TOO_LITTLE
    *_, overlapping = _matches(samples, own, solution.place, OVERLAP_M)
    if matched.sum() < LEAST_AGREEING * overlapping.sum():
        return FitResult.INCONSISTENT
    values = np.linalg.eigvalsh(info)
    if not np.isfinite(values).all() or values[0] <= 1e-9 * values[-1]:
        return FitResult.UNOBSERVABLE
    covariance = np.linalg.inv(info)
    worst_m = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    if worst_m > MAX_SIGMA_M or math.sqrt(covariance[2, 2]) > MAX_SIGMA_YAW_RAD:
        return FitResult.UNOBSERVABLE
    if ring > MOST_RING:
        return FitResult.UNOBSERVABLE
    return FitResult.AMBIGUOUS if rival > MOST_RIVAL else FitResult.ACCEPTED


def _height(
    other: _Segments, own: _Segments, other_rows: NDArray[np.intp], own_rows: NDArray[np.intp], prior: Placement
) -> tuple[float, float]:
    """Returns (z, its standard deviation): the difference on which most tops and bottoms agree, otherwise that by
    position."""
    pairs = np.unique(np.column_stack([other_rows, own_rows]), axis=0)
    difference = (own.heights[pairs[:, 1]] - other.heights[pairs[:, 0]]).ravel()
    difference = difference[np.abs(difference - prior.at_m[2]) <= POSITION_SIGMAS * prior.sigma_z_m]
    if len(difference) < LEAST_HEIGHTS:
        return prior.at_m[2], prior.sigma_z_m
    close = np.abs(difference[:, None] - difference[None]) <= Z_TOLERANCE_M
    best = int(np.argmax(close.sum(axis=1)))
    support = close[best]
    if support.sum() < max(LEAST_HEIGHTS, LEAST_HEIGHT_SHARE * len(difference)):
        return prior.at_m[2], prior.sigma_z_m
    return float(np.median(difference[support])), Z_TOLERANCE_M / 2.0

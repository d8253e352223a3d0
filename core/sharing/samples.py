"""Samples of planes that are compared to align two frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .correlation import Floats, thinned, turned
from .placement import Placement

SAMPLE_M = 0.2
"""Distance of samples along planes."""
LONG_M, EXTENDED_M = 5.0, 3.0
"""Where a plane of at least LONG_M ends is often the end of the view, and differs between vehicles. Samples of long
planes are therefore compared with long own planes that are extended at both ends: they do not determine the place
along the plane."""
MOST_SAMPLES, MOST_OWN_SAMPLES = 3000, 6000
"""Greatest number of samples of a neighbour, and of the own planes."""
PRIOR_SIGMAS = 3.0
"""The search extends to this number of standard deviations of the place by position."""
MOST_LENGTH_M, AROUND_M = 200.0, 40.0
"""Length of the longest planes that are used; radius around the middle in which samples count."""
MOST_PLANES, LEAST_LENGTH_M = 300, 0.3
"""Greatest number of planes of a vehicle, the longest ones; length of the shortest."""


@dataclass(frozen=True, slots=True)
class Samples:
    """S samples of planes."""

    points: Floats  # (S, 2)
    plane: NDArray[np.intp]  # (S,) rows of their planes
    long: NDArray[np.bool_]  # (S,) planes of at least LONG_M

    def part(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Samples:
        """Returns some of the samples."""
        return Samples(self.points[rows], self.plane[rows], self.long[rows])


@dataclass(frozen=True, slots=True)
class SamplePair:
    """Samples to compare."""

    points: Floats  # (S, 2) of the neighbour, relative to the centre
    own: Floats  # (T, 2) own samples


def samples_of(box: Floats, most: int) -> Samples:
    """Returns samples along the longest planes of finite size, one in each cell of SAMPLE_M."""
    length = np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1])
    fits = np.isfinite(box).all(axis=1) & (length >= LEAST_LENGTH_M) & (length <= MOST_LENGTH_M)
    good = np.flatnonzero(fits)
    good = np.sort(good[np.argsort(-length[good], kind="stable")[:MOST_PLANES]])
    step_m = max(SAMPLE_M, float(length[good].sum()) / (4 * most))
    count = np.ceil(length[good] / step_m).astype(int)
    plane = np.repeat(good, count)
    share = (np.arange(len(plane)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / np.repeat(count, count)
    points = box[plane, 0:2] + share[:, None] * (box[plane, 2:4] - box[plane, 0:2])
    rows = thinned(points, SAMPLE_M)
    samples = Samples(points, plane, length[plane] >= LONG_M)
    return samples.part(rows[:: max(1, math.ceil(len(rows) / most))])


def sample_pairs(
    other: Samples, own: Samples, own_box: Floats, extended_m: float = EXTENDED_M
) -> tuple[SamplePair, ...]:
    """Returns what is compared: samples of short planes with the own planes, those of long planes also with the
    extensions of long own planes, by extended_m at each end."""
    box = own_box[np.unique(own.plane[own.long])]
    along = box[:, 2:4] - box[:, 0:2]
    along *= extended_m / np.maximum(np.hypot(along[:, 0], along[:, 1]), LONG_M)[:, None]
    ends = np.concatenate([np.column_stack([e - d, e + d]) for e, d in ((box[:, 0:2], along), (box[:, 2:4], along))])
    extended = samples_of(np.column_stack([ends, np.zeros((len(ends), 2))]), MOST_OWN_SAMPLES)
    pairs = (
        SamplePair(other.points[other.long], np.concatenate([own.points, extended.points])),
        SamplePair(other.points[~other.long], own.points),
    )
    return tuple(pair for pair in pairs if len(pair.points))


def common_samples(other: Samples, own: Samples, prior: Placement) -> tuple[Samples, Samples]:
    """Returns the samples that both vehicles may have observed, within AROUND_M, which limits the grid of the search."""
    if not len(other.plane) or not len(own.plane):
        return other, own
    reach_m = PRIOR_SIGMAS * prior.sigma_m + 1.0
    at = turned(other.points, prior.yaw_rad) + np.array(prior.at_m[:2])
    near = inside(at, own.points, reach_m)
    if not near.any():
        return other.part(near), own
    middle = np.median(at[near], axis=0)
    near &= np.hypot(*(at - middle).T) <= AROUND_M
    return other.part(near), own.part(np.hypot(*(own.points - middle).T) <= AROUND_M + reach_m)


def inside(points: Floats, others: Floats, reach_m: float) -> NDArray[np.bool_]:
    """Returns (S,): which points are within reach_m of the rectangle that contains the others."""
    low, high = others.min(axis=0) - reach_m, others.max(axis=0) + reach_m
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))

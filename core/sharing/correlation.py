"""Finds the shift and rotation at which samples of planes fit other planes best, by a search on a grid.

The method is correlative scan matching (Olson 2009), with the direction of the planes in addition."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DIRECTIONS = 12
RIVAL_M = 1.6
"""Least distance of another place."""
RING_M = (0.7, 1.0)
"""If the score is hardly lower at this distance, the place is not determined."""
MOST_SAMPLES = 250
HALF_SAMPLE_M = 0.25
"""Half of the distance of samples along a plane, up to which the score is that of the sample."""
LEAST_SAMPLES = 40
"""A direction with fewer samples has less weight than the others."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Steps of a search. cell_m, turn_rad: of shift and rotation; spread_m: standard deviation of the score around a
    plane."""

    cell_m: float
    turn_rad: float
    spread_m: float


COARSE = Grid(0.4, math.radians(1.0), 0.4)
FINE = Grid(0.1, math.radians(0.3), 0.25)


def best_shift(
    points: Floats,
    along: Floats,
    own_points: Floats,
    own_along: Floats,
    prior: tuple[float, float, float],
    reach_m: float,
    reach_rad: float,
    grid: Grid = COARSE,
) -> tuple[tuple[float, float, float], float, float]:
    """Finds the best shift and rotation. The same input gives the same result.

    Args:
        points: (S, 2) samples.
        along: (S, 2) directions of their planes.
        own_points: (T, 2) samples of the planes to fit.
        own_along: (T, 2) their directions.
        prior: (x, y, yaw), middle of the search.
        reach_m, reach_rad: limits of the search.
        grid: steps of the search.

    Returns:
        (x, y, yaw); the score of the best other place; the best score at RING_M. Both scores are shares of the best
            one."""
    step = max(1, math.ceil(len(points) / MOST_SAMPLES))
    points, along = points[::step], along[::step]
    weight = balanced_weights(along)
    cell_m = grid.cell_m
    cells = math.ceil(reach_m / cell_m)
    steps = math.ceil(reach_rad / grid.turn_rad)
    turns = np.arange(-steps, steps + 1) * grid.turn_rad
    turned = [_turned(points, along, prior[2] + turn) for turn in turns]
    low = np.floor((np.min([p.min(axis=0) for p, _ in turned], axis=0) + prior[:2]) / cell_m).astype(int) - cells - 2
    high = np.ceil((np.max([p.max(axis=0) for p, _ in turned], axis=0) + prior[:2]) / cell_m).astype(int) + cells + 2
    fields = _fields(own_points, own_along, low, high, grid)
    scores = np.stack([_scores(fields, p + np.array(prior[:2]), d, weight, low, cells, cell_m) for p, d in turned])
    k, i, j = np.unravel_index(int(np.argmax(scores)), scores.shape)
    best = float(scores[k, i, j])
    place = prior[0] + (i - cells) * cell_m, prior[1] + (j - cells) * cell_m, prior[2] + float(turns[k])
    ii, jj = np.indices(scores.shape[1:])
    distance_m = np.hypot(ii - i, jj - j) * cell_m
    rival = _share(scores, distance_m > RIVAL_M, best)
    return place, rival, _share(scores, (distance_m >= RING_M[0]) & (distance_m <= RING_M[1]), best)


def _share(scores: Floats, some: NDArray[np.bool_], best: float) -> float:
    """Returns the greatest score of some shifts over the best score; 1 if nothing fits."""
    if best <= 0.0:
        return 1.0
    return float(scores[:, some].max()) / best if some.any() else 0.0


def _turned(points: Floats, along: Floats, yaw_rad: float) -> tuple[Floats, Floats]:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R = np.array([[c, s], [-s, c]])
    return points @ R, along @ R


def _direction(along: Floats) -> NDArray[np.intp]:
    """Returns the bin of each direction."""
    angle = np.arctan2(along[:, 1], along[:, 0])
    return np.rint(angle * DIRECTIONS / math.tau).astype(int) % DIRECTIONS


def _fields(points: Floats, along: Floats, low: NDArray[np.int_], high: NDArray[np.int_], grid: Grid) -> Floats:
    """Returns the score of a sample in each cell by its direction, (DIRECTIONS, X, Y). Neighbouring directions count,
    too."""
    cell_m, spread_m = grid.cell_m, grid.spread_m
    fields = np.zeros((DIRECTIONS, *(high - low)))
    cell = np.floor(points / cell_m).astype(int)
    reach = math.ceil(2.0 * spread_m / cell_m)
    direction = _direction(along)
    for di in range(-reach, reach + 1):
        for dj in range(-reach, reach + 1):
            at = cell + np.array([di, dj])
            off = (at + 0.5) * cell_m - points
            across = off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]
            ahead = np.maximum(0.0, np.abs((off * along).sum(axis=1)) - HALF_SAMPLE_M)
            score = np.exp(-0.5 * (across**2 + ahead**2) / spread_m**2)
            inside = ((at >= low) & (at < high)).all(axis=1)
            for turn in (-1, 0, 1):
                rows = (direction[inside] + turn) % DIRECTIONS, *(at[inside] - low).T
                np.maximum.at(fields, rows, score[inside])
    return fields


def balanced_weights(along: Floats) -> Floats:
    """Returns weights of samples, (S,), so that planes of each direction have about the same weight in total.

    Otherwise long facades would outweigh the few planes across them, which alone determine the place along a street."""
    axis = _direction(along) % (DIRECTIONS // 2)
    count = np.bincount(axis, minlength=DIRECTIONS // 2)
    return np.asarray(1.0 / np.maximum(count[axis], LEAST_SAMPLES))


def _scores(
    fields: Floats, points: Floats, along: Floats, weight: Floats, low: NDArray[np.int_], cells: int, cell_m: float
) -> Floats:
    """Returns the summed score of all shifts, (2 cells + 1, 2 cells + 1)."""
    side = 2 * cells + 1
    total = np.zeros((side, side))
    cell = np.floor(points / cell_m).astype(int) - low - cells
    for (i, j), direction, w in zip(cell.tolist(), _direction(along).tolist(), weight.tolist(), strict=True):
        total += w * fields[direction, i : i + side, j : j + side]
    return total

"""The shift and turn at which samples of planes lie best on other planes: search on a grid (correlative scan matching,
Olson 2009), with the direction of the planes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DIRECTIONS = 12
RIVAL_M = 1.6
"""A second place counts as another one from this distance on."""
RING_M = (0.7, 1.0)
"""A score that is hardly lower at this distance does not fix the place."""
MOST_SAMPLES = 250
HALF_SAMPLE_M = 0.25
"""Half the distance of samples along a plane: between them the score is that on them."""
LEAST_SAMPLES = 40
"""A direction with fewer samples does not count as much as the others."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Steps of a search. cell_m, turn_rad: of shift and turn; spread_m: width of the score around a plane, standard deviation."""

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
    """((x, y, yaw), score of the best other place and of the best place at RING_M, as shares of the best). points, along: (S, 2) samples and directions of
    their planes; own_points, own_along: those they are to lie on; prior: middle of the search. The same input gives the same result."""
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
    """The greatest score of some shifts, as a share of the best; 1 where nothing fits at all."""
    if best <= 0.0:
        return 1.0
    return float(scores[:, some].max()) / best if some.any() else 0.0


def _turned(points: Floats, along: Floats, yaw_rad: float) -> tuple[Floats, Floats]:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    R = np.array([[c, s], [-s, c]])
    return points @ R, along @ R


def _direction(along: Floats) -> NDArray[np.intp]:
    """The bin of each direction."""
    angle = np.arctan2(along[:, 1], along[:, 0])
    return np.rint(angle * DIRECTIONS / math.tau).astype(int) % DIRECTIONS


def _fields(points: Floats, along: Floats, low: NDArray[np.int_], high: NDArray[np.int_], grid: Grid) -> Floats:
    """(DIRECTIONS, X, Y) score of a sample in each cell, by its direction; neighbouring directions count, too."""
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
    """(S,) weights of samples: planes of each direction count about as much in all, so that long facades do not outweigh the few
    planes across them, which alone fix the place along a street."""
    axis = _direction(along) % (DIRECTIONS // 2)
    count = np.bincount(axis, minlength=DIRECTIONS // 2)
    return np.asarray(1.0 / np.maximum(count[axis], LEAST_SAMPLES))


def _scores(
    fields: Floats, points: Floats, along: Floats, weight: Floats, low: NDArray[np.int_], cells: int, cell_m: float
) -> Floats:
    """(2 cells + 1, 2 cells + 1) summed score of all shifts."""
    side = 2 * cells + 1
    total = np.zeros((side, side))
    cell = np.floor(points / cell_m).astype(int) - low - cells
    for (i, j), direction, w in zip(cell.tolist(), _direction(along).tolist(), weight.tolist(), strict=True):
        total += w * fields[direction, i : i + side, j : j + side]
    return total

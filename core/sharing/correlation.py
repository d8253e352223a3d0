"""Scores shifts and rotations of samples of planes against other planes, on a grid.

The method is correlative scan matching (Olson 2009). Directions of planes are not compared: two vehicles that pass an
obstacle in opposite directions see other sides of it, but at the same place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..jit import inner

Floats = NDArray[np.float64]
REACH_SPREADS = 3.0
"""A sample has no score beyond this number of spreads from a plane."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Steps of a search."""

    cell_m: float  # cell_m, turn_rad: of shift and rotation
    turn_rad: float
    spread_m: float  # standard deviation of the score around a sample
    flat: bool = False  # the score is 1 within REACH_SPREADS times the spread


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """Scores of shifts and rotations."""

    value: Floats  # (K, C, C) sum over the samples, each from 0 to 1
    turn_rad: Floats  # (K,) rotations
    shift_m: Floats  # (C,) shifts along x and along y


def thinned(points: Floats, cell_m: float) -> NDArray[np.intp]:
    """Returns the indices of one sample (S, 2) in each occupied cell, ascending."""
    _, first = np.unique(np.floor(points / cell_m).astype(np.int64), axis=0, return_index=True)
    return np.sort(first)


def turned(points: Floats, yaw_rad: float) -> Floats:
    """Returns points, (S, 2), rotated about the origin."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def scores(
    points: Floats, centre_m: Floats, turn_rad: Floats, reach_m: float, own_points: Floats, grid: Grid
) -> Scores:
    """Scores all shifts up to reach_m.

    Args:
        points: (S, 2) samples, relative to the point about which they are rotated.
        centre_m: (K, 2) place of that point in the frame of own_points for each rotation, from which shifts count.
        turn_rad: (K,) rotations.
        reach_m: greatest shift along x and along y.
        own_points: (T, 2) samples of the planes to fit.
        grid: steps."""
    cell_m = grid.cell_m
    cells = math.ceil(reach_m / cell_m)
    places = [turned(points, yaw) + at for yaw, at in zip(turn_rad.tolist(), centre_m, strict=True)]
    low = np.floor(np.min([p.min(axis=0) for p in places], axis=0) / cell_m).astype(int) - cells - 1
    high = np.ceil(np.max([p.max(axis=0) for p in places], axis=0) / cell_m).astype(int) + cells + 2
    field = _field(own_points, low, high, grid)
    value = np.stack([_sums(field, p, low, cells, cell_m) for p in places])
    return Scores(value, turn_rad, np.asarray(np.arange(-cells, cells + 1) * cell_m, np.float64))


def _field(points: Floats, low: NDArray[np.int_], high: NDArray[np.int_], grid: Grid) -> Floats:
    """Returns the score of a sample in each cell: that of the nearest point."""
    field = np.zeros(high - low)
    cell = np.floor(points / grid.cell_m).astype(np.int64, order="C")
    reach = math.ceil(REACH_SPREADS * grid.spread_m / grid.cell_m)
    around = cell[:, :, None] + np.arange(-reach, reach + 1)
    off_m = (around + 0.5) * grid.cell_m - points[:, :, None]
    _raise_around(field, cell - low - reach, np.exp(-0.5 * (off_m / grid.spread_m) ** 2))
    if grid.flat:
        field = (field >= math.exp(-0.5 * REACH_SPREADS**2)).astype(np.float64)
    return field


def _sums(field: Floats, points: Floats, low: NDArray[np.int_], cells: int, cell_m: float) -> Floats:
    """Returns the summed score of all shifts, (2 cells + 1, 2 cells + 1)."""
    total = np.zeros((2 * cells + 1, 2 * cells + 1))
    _add_windows(total, field, np.floor(points / cell_m).astype(np.int64, order="C") - low - cells)
    return total


@inner
def _raise_around(field, first, factors):
    """Raises the field (I, J) around points to their scores. A score is the product of a factor along x and one along
    y.

    first: (T, 2) int64, first cell of the window of each point, which may extend beyond the field.
    factors: (T, 2, W)."""
    for t in range(len(first)):
        for a in range(factors.shape[2]):
            i = first[t, 0] + a
            if i < 0 or i >= field.shape[0]:
                continue
            for b in range(max(0, -first[t, 1]), min(factors.shape[2], field.shape[1] - first[t, 1])):
                j = first[t, 1] + b
                field[i, j] = max(field[i, j], factors[t, 0, a] * factors[t, 1, b])


@inner
def _add_windows(total, field, first):
    """Adds the windows of the field (I, J) that begin at the cells `first`, (S, 2) int64, to the total (W, W)."""
    for s in range(len(first)):
        column = first[s, 1]
        for a in range(total.shape[0]):
            # slices of one row are contiguous, so the inner loop is vectorised
            out, window = total[a], field[first[s, 0] + a, column : column + total.shape[1]]
            for b in range(len(out)):
                out[b] += window[b]

"""Scores of shifts and rotations against a plain sum over samples and points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.sharing.correlation import REACH_SPREADS, Grid, scores, turned

pytestmark = pytest.mark.nojit

Floats = NDArray[np.float64]
CELL_M, REACH_M = 0.5, 1.0


def naive(sample: Floats, own: Floats, grid: Grid) -> float:
    """The score of one sample: that of the centre of its cell and the nearest point."""
    centre = (np.floor(sample / grid.cell_m) + 0.5) * grid.cell_m
    nearest_m = min((math.dist(centre, point) for point in own), default=math.inf)
    if grid.flat:
        return float(nearest_m <= REACH_SPREADS * grid.spread_m)
    return math.exp(-0.5 * (nearest_m / grid.spread_m) ** 2)


number = st.floats(-4.0, 4.0)
points = st.lists(st.tuples(number, number), min_size=1, max_size=6).map(np.array)


@given(points, points, st.floats(-3.0, 3.0), st.tuples(number, number), st.booleans())
def test_scores_are_sums_over_the_samples(
    sample: Floats, own: Floats, yaw_rad: float, at_m: tuple[float, float], flat: bool
) -> None:
    grid = Grid(CELL_M, 0.1, 0.4, flat=flat)
    found = scores(sample, np.array([at_m, (0.0, 0.0)]), np.array([yaw_rad, 0.0]), REACH_M, own, grid)
    assert found.shift_m.tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    for k, (yaw, at) in enumerate(((yaw_rad, at_m), (0.0, (0.0, 0.0)))):
        placed = turned(sample, yaw) + np.array(at)
        for i, dx in enumerate(found.shift_m):
            for j, dy in enumerate(found.shift_m):
                cells = np.floor(placed / CELL_M) * CELL_M + np.array([dx, dy]) + 0.5 * CELL_M
                expected = sum(naive(cell, own, grid) for cell in cells)
                # beyond REACH_SPREADS a score may be left out: exp(-4.5) each
                low = expected - len(sample) * math.exp(-0.5 * REACH_SPREADS**2)
                assert low - 1e-9 <= found.value[k, i, j] <= expected + 1e-9


def test_a_sample_on_a_point_scores_most_where_the_shift_is_undone() -> None:
    grid = Grid(0.1, 0.1, 0.2)
    own = np.array([[3.0, 1.0], [5.0, -2.0], [4.0, 4.0]])
    sample = turned(own - np.array([4.0, 1.0]), -0.4)
    found = scores(sample, np.array([[4.5, 0.7]] * 3), np.array([0.2, 0.4, 0.6]), 1.0, own, grid)
    k, i, j = np.unravel_index(int(np.argmax(found.value)), found.value.shape)
    assert k == 1
    assert (found.shift_m[i], found.shift_m[j]) == (pytest.approx(-0.5, abs=0.11), pytest.approx(0.3, abs=0.11))

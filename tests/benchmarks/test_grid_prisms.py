"""The grid baseline on clouds with known outlines."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.grid_prisms import grid_prisms, obstacle_points, outlines
from benchmarks.metrics import distances
from drivers.simulated import camera_info, render


def grid(*rows: str) -> np.ndarray:
    return np.pad(np.array([[c == "#" for c in row] for row in rows]), 1)


def area(loop: np.ndarray) -> float:
    """Signed: positive where it runs clockwise seen from above (x forward, y right)."""
    x, y = loop[:, 0].astype(float), loop[:, 1].astype(float)
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_single_cell_is_a_square_with_the_free_side_on_the_right() -> None:
    (loop,) = outlines(grid("#"))
    assert sorted(map(tuple, loop.tolist())) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert area(loop) == -1.0  # counter-clockwise from above: the occupied side is on the left


def test_ring_has_an_outer_and_an_inner_outline() -> None:
    loops = outlines(grid("####", "#..#", "####"))
    assert sorted(area(loop) for loop in loops) == [-12.0, 2.0]
    assert all(len(loop) == 4 for loop in loops)


def test_cells_touching_by_a_corner_share_one_outline() -> None:
    loops = outlines(grid("##..", "##..", "..##"))
    assert [area(loop) for loop in loops] == [-6.0]


def test_outlines_hold_exactly_the_occupied_area() -> None:
    rng = np.random.Generator(np.random.PCG64(5))
    cells = np.pad(rng.random((30, 40)) < 0.4, 1)
    assert sum(area(loop) for loop in outlines(cells)) == -float(cells.sum())


def test_box_shaped_cloud_gives_its_four_sides_in_each_layer() -> None:
    rng = np.random.Generator(np.random.PCG64(6))
    points = rng.uniform([4.0, -1.0, -1.5], [6.0, 1.0, 1.9], (60000, 3))
    model = grid_prisms(points, 2.0, 0.2)
    assert model.polygons == 2
    assert len(model.planes) == 8
    assert model.bytes == 8 * 8 + 2 * 8
    for plane in model.planes:
        assert set(np.round(np.abs(plane[[0, 2]] - 5.0), 6)) <= {1.0}
        assert set(np.round(np.abs(plane[[1, 3]]), 6)) <= {1.0}
    assert {tuple(p[4:]) for p in model.planes} == {(-2.0, 0.0), (0.0, 2.0)}


def test_diagonal_wall_is_simplified_to_a_few_sides() -> None:
    s = np.linspace(0.0, 8.0, 20000)
    points = np.column_stack([4.0 + s, s - 4.0, np.zeros(len(s))])
    model = grid_prisms(points, 2.0, 0.2)
    assert 2 <= len(model.planes) <= 8


def test_few_points_are_noise_and_no_points_are_no_planes() -> None:
    assert len(grid_prisms(np.array([[5.0, 0.0, 0.0]] * 2), 2.0, 0.4).planes) == 0
    assert len(grid_prisms(np.zeros((0, 3)), 2.0, 0.4).planes) == 0


@pytest.mark.parametrize("cell_m", [0.1, 0.8])
def test_true_cloud_of_a_wall_is_modelled_within_a_cell(cell_m: float) -> None:
    frame = render("wall", camera_info(160, 120), pitch_rad=-0.2, roll_rad=0.2)
    points = obstacle_points(frame, 0.0)
    assert (2.0 - points[:, 2]).min() > 0.29
    model = grid_prisms(points, 2.0, cell_m)
    assert distances(points, model.planes).max() < 2.0 * cell_m

"""The grid baseline on clouds with known outlines."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fidelity.metrics import distances
from benchmarks.peers.cloud import cloud_of
from benchmarks.peers.grid_bodies import body_distances, prism_stops
from benchmarks.peers.grid_outlines import outlines, signed_area
from benchmarks.peers.grid_prisms import GridPrisms, facing_camera, grid_of, grid_prisms, obstacle_points, simplified
from drivers.simulation.source import camera_info, render

LOOK_NORTH = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def grid(*rows: str) -> np.ndarray:
    return np.pad(np.array([[c == "#" for c in row] for row in rows]), 1)


def walked(occupied: np.ndarray) -> list[list[tuple[int, int]]]:
    """All outlines by walking along the sides of the cells, one step at a time."""
    onward: dict[tuple[int, int], list[tuple[int, int]]] = {}
    sides = (((-1, 0), (0, 0), (0, 1)), ((0, 1), (0, 1), (1, 1)), ((1, 0), (1, 1), (1, 0)), ((0, -1), (1, 0), (0, 0)))
    for x, y in np.argwhere(occupied).tolist():
        for (dx, dy), start, end in sides:
            if not occupied[x + dx, y + dy]:
                onward.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    loops = []
    while any(onward.values()):
        first = at = min(k for k, v in onward.items() if v)
        loop, heading = [], (0, 0)
        while True:
            rightward = [heading[0] * (y - at[1]) - heading[1] * (x - at[0]) for x, y in onward[at]]
            to = onward[at].pop(rightward.index(max(rightward)))
            step = (to[0] - at[0], to[1] - at[1])
            if step != heading:
                loop.append(at)
            at, heading = to, step
            if at == first:
                break
        loops.append(loop)
    return loops


def test_single_cell_is_a_square_with_the_free_side_on_the_right() -> None:
    (loop,) = outlines(grid("#"))
    assert sorted(map(tuple, loop.tolist())) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert signed_area(loop) == -1.0  # counter-clockwise from above: the occupied side is on the left


def test_ring_has_an_outer_and_an_inner_outline() -> None:
    loops = outlines(grid("####", "#..#", "####"))
    assert sorted(signed_area(loop) for loop in loops) == [-12.0, 2.0]
    assert all(len(loop) == 4 for loop in loops)


def test_cells_touching_by_a_corner_share_one_outline() -> None:
    assert [signed_area(loop) for loop in outlines(grid("##..", "##..", "..##"))] == [-6.0]
    assert [signed_area(loop) for loop in outlines(grid("..##", "##..", "##.."))] == [-6.0]


@pytest.mark.parametrize("share", [0.1, 0.4, 0.6, 0.9])
def test_outlines_are_those_of_a_slow_walk_and_hold_exactly_the_occupied_area(share: float) -> None:
    cells = np.pad(np.random.Generator(np.random.PCG64(5)).random((30, 40)) < share, 1)
    loops = outlines(cells)
    assert sum(signed_area(loop) for loop in loops) == -float(cells.sum())
    assert sorted(sorted(map(tuple, loop.tolist())) for loop in loops) == sorted(sorted(w) for w in walked(cells))


def box_cloud() -> np.ndarray:
    rng = np.random.Generator(np.random.PCG64(6))
    return rng.uniform([4.0, -1.0, -1.5], [6.0, 1.0, 1.9], (60000, 3))


def test_box_shaped_cloud_gives_its_four_sides_in_each_layer() -> None:
    model = grid_prisms(box_cloud(), 2.0, 0.2)
    assert model.polygons == 2
    assert len(model.planes) == 8
    assert model.bytes == 8 * 8 + 2 * 8
    for plane in model.planes:
        assert set(np.round(np.abs(plane[[0, 2]] - 5.0), 6)) <= {1.0}
        assert set(np.round(np.abs(plane[[1, 3]]), 6)) <= {1.0}
    assert {tuple(p[4:]) for p in model.planes} == {(-2.0, 0.0), (0.0, 2.0)}
    assert model.layer.tolist() == [0] * 4 + [1] * 4
    assert facing_camera(model.planes).sum() == 2  # one front in each layer, its free side towards the camera
    np.testing.assert_allclose(model.planes[facing_camera(model.planes)][:, [0, 2]], 4.0)


def test_diagonal_wall_is_simplified_to_a_few_sides() -> None:
    s = np.linspace(0.0, 8.0, 20000)
    points = np.column_stack([4.0 + s, s - 4.0, np.zeros(len(s))])
    assert 2 <= len(grid_prisms(points, 2.0, 0.2).planes) <= 8
    assert len(grid_prisms(points, 2.0, 0.2, epsilon_cells=0.0).planes) > 100


def test_free_spots_too_small_to_pass_are_filled_and_larger_ones_kept() -> None:
    (hole,) = [loop for loop in outlines(grid("#####", "#...#", "#...#", "#...#", "#####")) if signed_area(loop) > 0]
    assert len(simplified(hole, 0.6, 0.75)) == 0  # 1.8 m wide
    assert len(simplified(hole, 0.7, 0.75)) == 4  # 2.1 m
    assert len(simplified(hole[::-1], 0.6, 0.75)) == 4  # an obstacle of that size


def test_few_points_are_noise_and_no_points_are_no_planes() -> None:
    assert len(grid_prisms(np.array([[5.0, 0.0, 0.0]] * 2), 2.0, 0.4).planes) == 0
    assert len(grid_prisms(np.zeros((0, 3)), 2.0, 0.4).planes) == 0


def test_near_cells_need_more_points_than_far_ones() -> None:
    # 5 % of 0.4 m x 0.6 m at 450 px: 97 points at 5 m, 6 at 20 m
    for x, count, sides in ((5.0, 90, 0), (5.0, 110, 4), (20.0, 10, 4)):
        assert len(grid_prisms(np.array([[x, 0.1, 0.0]] * count), 2.0, 0.4, focal_px=450.0).planes) == sides


@pytest.mark.parametrize("cell_m", [0.1, 0.8])
def test_true_cloud_of_a_wall_is_modelled_within_a_cell(cell_m: float) -> None:
    frame = render("wall", camera_info(160, 120), pitch_rad=-0.2, roll_rad=0.2)
    points = obstacle_points(frame, 0.0)
    assert (2.0 - points[:, 2]).min() == pytest.approx(0.25, abs=0.01)
    assert distances(points, grid_of(cloud_of(frame, 0.0), cell_m).planes).max() < 2.0 * cell_m


def box_model() -> GridPrisms:
    return grid_prisms(box_cloud(), 2.0, 0.2)


def test_bodies_hold_what_is_inside_and_are_as_far_as_their_nearest_side_or_lid() -> None:
    points = np.array([[5.0, 0.0, 1.0], [3.0, 0.0, 0.0], [5.0, 0.0, -2.5], [7.0, 1.5, 0.0], [5.0, 0.3, 2.4]])
    np.testing.assert_allclose(body_distances(box_model(), points), [0.0, 1.0, 0.5, np.hypot(1.0, 0.5), 0.4])
    assert np.isinf(body_distances(grid_prisms(np.zeros((0, 3)), 2.0, 0.4), points)).all()


def test_rays_stop_at_sides_and_lids_and_not_at_all_beside() -> None:
    k = camera_info(160, 120).intrinsics
    level = prism_stops(box_model(), k, LOOK_NORTH)
    assert level[60, 80] == pytest.approx(4.0)
    assert np.isinf(level[60, 0])
    # the same box 4 m below the camera, which looks down on it by 0.6 rad: its lid and its front are seen
    below = grid_prisms(box_cloud() + np.array([0.0, 0.0, 6.0]), 8.0, 0.2)
    down = np.array([[0.0, -np.sin(0.6), np.cos(0.6)], [1.0, 0.0, 0.0], [0.0, np.cos(0.6), np.sin(0.6)]])
    depth = prism_stops(below, k, down)
    u, v = np.meshgrid(np.arange(160), np.arange(120))
    toward = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ down.T
    met = np.isfinite(depth)
    hit = toward[met] * depth[met][:, None]
    lid, front = np.abs(hit[:, 2] - 4.0) < 1e-6, np.abs(hit[:, 0] - 4.0) < 1e-6
    assert lid.sum() > 200
    assert front.sum() > 200
    assert (lid | front).all()
    assert (np.abs(hit[:, 1]) <= 1.0 + 1e-6).all()
    x, y = (toward[..., i] * 4.0 / toward[..., 2] for i in (0, 1))
    over_lid = (toward[..., 2] > 0.0) & (np.abs(x - 5.0) < 0.99) & (np.abs(y) < 0.99)
    assert met[over_lid].all()


def test_a_camera_inside_a_prism_sees_nothing() -> None:
    model = grid_prisms(box_cloud() - [5.0, 0.0, 0.0], 2.0, 0.2, focal_px=0.0)
    assert (prism_stops(model, camera_info(160, 120).intrinsics, LOOK_NORTH) == 0.0).all()

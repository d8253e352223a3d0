"""Boxes and rectangles of any orientation: known answers, and agreement with the metrics of upright rectangles."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fidelity.metrics import distances, stops
from benchmarks.peers.solids import box_distances, box_stops, cube_faces, patch_distances, patch_stops
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from drivers.simulation.source import camera_info

K = camera_info(160, 120).intrinsics
NORTH = R_CAMFRD_OPTICAL
TILTED = rotation_level_cam_optical(rotation_from_euler(0.4, -0.3, 0.0) @ R_CAMFRD_OPTICAL)


def upright(count: int, seed: int) -> np.ndarray:
    """Rectangles (N, 6) in front of the camera."""
    rng = np.random.Generator(np.random.PCG64(seed))
    planes = np.empty((count, 6))
    planes[:, 0:2] = rng.uniform([2.0, -6.0], [15.0, 6.0], (count, 2))
    planes[:, 2:4] = planes[:, 0:2] + rng.uniform(-3.0, 3.0, (count, 2))
    planes[:, 4] = rng.uniform(-4.0, 1.0, count)
    planes[:, 5] = planes[:, 4] + rng.uniform(0.1, 3.0, count)
    return planes


def as_patches(planes: np.ndarray) -> np.ndarray:
    """The same rectangles as patches (N, 9)."""
    zero = np.zeros(len(planes))
    edge = np.column_stack([planes[:, 2:4] - planes[:, 0:2], zero])
    down = np.column_stack([zero, zero, planes[:, 5] - planes[:, 4]])
    return np.hstack([planes[:, 0:2], planes[:, 4:5], edge, down])


def points(count: int, seed: int) -> np.ndarray:
    return np.random.Generator(np.random.PCG64(seed)).uniform([-2.0, -8.0, -6.0], [18.0, 8.0, 4.0], (count, 3))


@pytest.mark.parametrize("R", [NORTH, TILTED])
def test_upright_patches_are_what_planes_are(R: np.ndarray) -> None:
    planes = upright(40, 1)
    np.testing.assert_allclose(patch_stops(as_patches(planes), K, R), stops(planes, K, R)[0])
    np.testing.assert_allclose(patch_distances(points(500, 2), as_patches(planes)), distances(points(500, 2), planes))


def test_a_leaning_patch_over_its_face_its_edge_and_its_corner() -> None:
    # a square of 2 m that leans back by 45 degrees, its foot across the view 4 m ahead at the camera's height
    lean = np.sqrt(0.5) * 2.0
    patch = np.array([[4.0, -1.0, 0.0, 0.0, 2.0, 0.0, lean, 0.0, -lean]])
    normal = np.sqrt(0.5) * np.array([1.0, 0.0, 1.0])
    middle = patch[0, :3] + 0.5 * (patch[0, 3:6] + patch[0, 6:9])
    off = [
        middle + 0.7 * normal,
        middle - 0.7 * normal,
        middle + np.array([0.0, 3.0, 0.0]),
        [4.0 - 3.0, 1.0 + 4.0, 0.0],
    ]
    np.testing.assert_allclose(patch_distances(np.array(off), patch), [0.7, 0.7, 2.0, 5.0])
    depth = patch_stops(patch, K, NORTH)
    v, u = np.nonzero(np.isfinite(depth))
    x, z = depth[v, u], (v - K.cy) / K.fy * depth[v, u]
    assert len(x) > 500
    np.testing.assert_allclose(x + z, 4.0)
    assert x.max() == pytest.approx(4.0 + lean, rel=0.03)


def test_flat_boxes_are_what_planes_along_the_axes_are() -> None:
    planes = upright(40, 3)
    planes[:20, 2], planes[20:, 3] = planes[:20, 0], planes[20:, 1]
    low, high = np.minimum(planes[:, 0:2], planes[:, 2:4]), np.maximum(planes[:, 0:2], planes[:, 2:4])
    boxes = np.column_stack([low, planes[:, 4], high, planes[:, 5]])
    np.testing.assert_allclose(box_distances(points(500, 4), boxes), distances(points(500, 4), planes), atol=1e-12)
    for R in (NORTH, TILTED):
        np.testing.assert_allclose(box_stops(boxes, K, R), stops(planes, K, R)[0])


def test_a_box_is_met_where_its_sides_are_and_its_inside_is_no_distance() -> None:
    box = np.array([[4.0, -1.0, -9.0, 6.0, 1.0, 9.0]])
    sides = [(4, -1, 4, 1), (4, 1, 6, 1), (6, 1, 6, -1), (6, -1, 4, -1)]
    planes = np.array([[*side, -9.0, 9.0] for side in sides], np.float64)
    for R in (NORTH, TILTED):
        np.testing.assert_allclose(box_stops(box, K, R), stops(planes, K, R)[0])
    at = points(500, 5)
    inside = np.all((at > box[0, :3]) & (at < box[0, 3:]), axis=1)
    assert inside.sum() > 5
    np.testing.assert_allclose(box_distances(at, box), np.where(inside, 0.0, distances(at, planes)), atol=1e-12)
    assert (box_stops(box - [5.0, 0.0, 0.0, 5.0, 0.0, 0.0], K, NORTH) == 0.0).all()  # the camera is inside


@pytest.mark.parametrize("spread", [0.0, 1.5])
def test_nearest_of_many_boxes_near_and_far_of_one_size_and_of_many(spread: float) -> None:
    rng = np.random.Generator(np.random.PCG64(6))
    low = rng.uniform([4.0, -3.0, -2.0], [9.0, 3.0, 1.0], (300, 3))
    boxes = np.hstack([low, low + 0.2 + spread * rng.random((300, 3))])
    at = np.vstack([points(300, 7), [[60.0, -50.0, 20.0], [-40.0, 0.0, 0.0]]])
    off = np.maximum(0.0, np.maximum(boxes[None, :, :3] - at[:, None], at[:, None] - boxes[None, :, 3:]))
    np.testing.assert_allclose(box_distances(at, boxes), np.linalg.norm(off, axis=2).min(axis=1), rtol=1e-12)


def test_faces_of_cubes_are_those_that_no_other_cube_covers() -> None:
    one = cube_faces(np.array([[2, 0, 0]]), 0.5, np.array([10.0, 0.0, 0.0]))
    assert len(one) == 6
    np.testing.assert_allclose(box_distances(np.array([[11.25, 0.25, 0.25], [11.9, 0.25, 0.25]]), one), [0.25, 0.4])
    assert len(cube_faces(np.array([[0, 0, 0], [1, 0, 0]]), 1.0, np.zeros(3))) == 10
    block = np.stack(np.meshgrid(*[np.arange(3)] * 3), axis=-1).reshape(-1, 3)
    faces = cube_faces(block, 1.0, np.zeros(3))
    assert len(faces) == 54
    np.testing.assert_allclose(box_distances(np.array([[1.5, 1.5, 1.5], [1.5, 1.5, -1.0]]), faces), [1.5, 1.0])


def test_nothing_is_infinitely_far_and_stops_nothing() -> None:
    none6, none9 = np.zeros((0, 6)), np.zeros((0, 9))
    at = points(3, 8)
    assert np.isinf(box_distances(at, none6)).all()
    assert np.isinf(patch_distances(at, none9)).all()
    assert np.isinf(box_stops(none6, K, NORTH)).all()
    assert np.isinf(patch_stops(none9, K, NORTH)).all()
    assert len(cube_faces(np.zeros((0, 3), np.int64), 1.0, np.zeros(3))) == 0
    assert box_distances(np.zeros((0, 3)), np.ones((1, 6))).shape == (0,)

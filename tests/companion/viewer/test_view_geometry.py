"""The viewer's arithmetic against slow, obvious forms of it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.viewer.colors import (
    FAR_INDEX,
    FIRST,
    LAST,
    UNKNOWN_INDEX,
    depth_index,
    index_range_m,
    palette,
    range_index,
)
from companion.viewer.frame import FrameStatus, select_frames
from companion.viewer.geometry import (
    clip_near,
    elevation_ahead_rad,
    field_of_view_rad,
    free_normals,
    layer_at,
    nearest_m,
    outline_px,
    plane_corners_m,
)
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from tests.nightly import examples

from ..view_scenes import INFO, INTRINSICS, blind, frame, model

angles = st.floats(-0.5, 0.5)
coordinates = st.floats(-8, 8).map(lambda v: round(v, 3))


@examples(2)
@given(angles, angles, st.floats(2, 15), st.floats(-3, 3), st.floats(-3, 3))
def test_projection_agrees_with_opencv(roll: float, pitch: float, x: float, ya: float, yb: float) -> None:
    R = rotation_level_cam_optical(rotation_from_euler(roll, pitch, 0.3) @ R_CAMFRD_OPTICAL)
    k = INTRINSICS
    corners = plane_corners_m(np.array([[x, ya, x + 1, yb, -1, 1]], np.float32))[0]
    assume((corners @ R)[:, 2].min() > 0.1)
    matrix = np.array([[k.fx, 0, k.cx], [0, k.fy, k.cy], [0, 0, 1]])
    expected, _ = cv2.projectPoints(corners, cv2.Rodrigues(R.T)[0], np.zeros(3), matrix, None)
    np.testing.assert_allclose(outline_px(corners, R, k), expected[:, 0], atol=1e-4)


def test_corners_are_a_top_b_top_b_bottom_a_bottom() -> None:
    corners = plane_corners_m(np.array([[1, 2, 3, 4, -5, 6]], np.float32))
    assert corners.tolist() == [[[1, 2, -5], [3, 4, -5], [3, 4, 6], [1, 2, 6]]]


def test_what_lies_behind_the_camera_is_cut_off_before_the_division() -> None:
    square = np.array([[0, 0, -1], [0, 0, 3], [1, 0, 3], [1, 0, -1]], float)
    clipped = clip_near(square)
    assert len(clipped) == 4
    assert clipped[:, 2].min() == pytest.approx(0.05)
    assert clipped[:, 2].max() == 3
    assert len(clip_near(square - np.array([0, 0, 5]))) == 0
    ahead = square - np.array([0, 0, -5])
    np.testing.assert_array_equal(clip_near(ahead), ahead)


@given(coordinates, coordinates, coordinates, coordinates)
def test_nearest_distance_agrees_with_many_points_on_the_plane(ax: float, ay: float, bx: float, by: float) -> None:
    t = np.linspace(0, 1, 4001)
    naive = np.hypot(ax + t * (bx - ax), ay + t * (by - ay)).min()
    found = nearest_m(np.array([[ax, ay, bx, by, 0, 1]], np.float32))[0]
    assert found == pytest.approx(naive, abs=4e-3)


def test_free_side_lies_on_the_right_of_a_to_b_seen_from_above() -> None:
    # x forward, y right: walking to the right, the right-hand side looks back at the camera
    np.testing.assert_allclose(free_normals(np.array([[5, -1, 5, 1, 0, 1]], np.float32)), [[-1, 0]], atol=1e-9)
    # walking forward, the right-hand side is the right
    np.testing.assert_allclose(free_normals(np.array([[1, 2, 5, 2, 0, 1]], np.float32)), [[0, 1]], atol=1e-9)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.4)])
def test_field_of_view_holds_every_pixel_and_no_more(roll: float, pitch: float) -> None:
    k = INTRINSICS
    R = rotation_level_cam_optical(rotation_from_euler(roll, pitch, 0.0) @ R_CAMFRD_OPTICAL)
    u, v = np.meshgrid(np.arange(-0.5, k.width), np.arange(-0.5, k.height))
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ R.T
    azimuth = np.arctan2(rays[..., 1], rays[..., 0])
    left, right = field_of_view_rad(k, R)
    assert left == pytest.approx(azimuth.min(), abs=2e-3)
    assert right == pytest.approx(azimuth.max(), abs=2e-3)


def test_field_of_view_goes_all_round_when_the_camera_looks_straight_down() -> None:
    R = rotation_level_cam_optical(rotation_from_euler(0.0, -math.pi / 2, 0.0) @ R_CAMFRD_OPTICAL)
    assert field_of_view_rad(INTRINSICS, R) == (-math.pi, math.pi)


def test_elevation_of_a_level_camera_is_half_the_image_up_and_down() -> None:
    R = rotation_level_cam_optical(R_CAMFRD_OPTICAL)
    low, high = elevation_ahead_rad(INTRINSICS, R)
    assert high == pytest.approx(math.atan(120 / 200))
    assert low == pytest.approx(-high)
    nose_up = rotation_level_cam_optical(rotation_from_euler(0.0, 0.2, 0.0) @ R_CAMFRD_OPTICAL)
    assert elevation_ahead_rad(INTRINSICS, nose_up)[1] == pytest.approx(high + 0.2)


def test_layer_of_a_height() -> None:
    free = model([]).free
    assert [layer_at(free, z) for z in (-3.5, -3.0, -1.5, -1.0, 0.9, 1.0)] == [None, 0, 0, 1, 1, None]


def test_unknown_and_far_and_measured_have_bytes_and_colours_of_their_own() -> None:
    depth = np.array([[0, 65535, 65534, 200, 300, 1000, 15_000, 15_500, 40_000]], np.uint16)
    index = depth_index(depth, INFO)[0]  # ke 0.005 at 20 m: a surface is measured up to 20 / 1.3 = 15.38 m
    assert index[:4].tolist() == [UNKNOWN_INDEX, UNKNOWN_INDEX, FAR_INDEX, UNKNOWN_INDEX]
    assert index[4] == FIRST
    assert FIRST < index[5] < index[6] < LAST
    assert index[7:].tolist() == [FAR_INDEX, FAR_INDEX]
    assert depth_index(depth, INFO, 0.0015)[0, 7] not in (FAR_INDEX, UNKNOWN_INDEX)
    colors = palette().astype(int)
    measured = colors[FIRST : LAST + 1]
    assert np.abs(measured - colors[UNKNOWN_INDEX]).max(axis=1).min() > 60
    assert np.abs(measured - colors[FAR_INDEX]).max(axis=1).min() > 60
    assert colors[FIRST, 0] > colors[FIRST, 2] + 100, "near is red"
    assert colors[LAST, 2] > colors[LAST, 0] + 80, "far is blue"


@given(st.floats(0.3, 20.0))
def test_byte_of_a_distance_stands_for_it_within_one_step(distance: float) -> None:
    index = int(range_index(np.array([distance]), INFO)[0])
    assert index_range_m(index, INFO) == pytest.approx(distance, rel=0.009)


def test_status_of_frames() -> None:
    assert frame().status is FrameStatus.VALID
    assert frame(model=None).status is FrameStatus.NO_PRISMS
    assert frame(model=None, dropped="no attitude").status is FrameStatus.BLIND
    assert frame(model=None, dropped="no attitude").cause == "frame not used: no attitude"
    assert blind().status is FrameStatus.BLIND
    assert blind().cause == "too few pixels hold a measurement"
    with pytest.raises(ValueError, match="without its attitude"):
        frame(R_ned_frd=None)
    with pytest.raises(ValueError, match="depth_mm: shape"):
        frame(depth_mm=np.zeros((10, 10), np.uint16))


def test_pictures_spread_over_the_log_with_the_fullest_and_the_first_blind_frame() -> None:
    counts = [0] * 100
    counts[33] = 9
    blind_frames = [k in (61, 62) for k in range(100)]
    assert select_frames(counts, blind_frames) == [0, 25, 33, 50, 61, 74, 99]
    assert select_frames([1, 1], [False, False]) == [0, 1]
    assert select_frames([5], [True]) == [0]
    assert select_frames([], []) == []

"""Signs against MAVLink's, mounts, round trips: what a wrong sign here would turn into a crash."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from core import frames
from core.types import CameraMount

ANGLE = st.floats(-3.1, 3.1)
PITCH = st.floats(-1.5, 1.5)
FORWARD, RIGHT, DOWN = np.eye(3)


def test_nose_up_is_positive_pitch() -> None:
    nose = frames.rotation_from_euler(0.0, 0.3, 0.0) @ FORWARD
    np.testing.assert_allclose(nose, [math.cos(0.3), 0.0, -math.sin(0.3)], atol=1e-12)  # ned: up is negative


def test_right_wing_down_is_positive_roll() -> None:
    wing = frames.rotation_from_euler(0.3, 0.0, 0.0) @ RIGHT
    np.testing.assert_allclose(wing, [0.0, math.cos(0.3), math.sin(0.3)], atol=1e-12)


def test_clockwise_seen_from_above_is_positive_yaw() -> None:
    np.testing.assert_allclose(frames.rotation_from_euler(0.0, 0.0, math.pi / 2) @ FORWARD, [0.0, 1.0, 0.0], atol=1e-12)


def test_rotations_are_applied_roll_first_then_pitch_then_yaw() -> None:
    def about(axis: int, angle: float) -> np.ndarray:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R = np.eye(3)
        R[i, i] = R[j, j] = math.cos(angle)
        R[i, j], R[j, i] = -math.sin(angle), math.sin(angle)
        return R

    want = about(2, 0.7) @ about(1, -0.4) @ about(0, 1.1)
    np.testing.assert_allclose(frames.rotation_from_euler(1.1, -0.4, 0.7), want, atol=1e-12)


def test_optical_axes_of_a_level_forward_camera() -> None:
    R = frames.rotation_frd_optical(CameraMount())
    np.testing.assert_array_equal(R @ [0, 0, 1], FORWARD)  # the axis looks forward
    np.testing.assert_array_equal(R @ [1, 0, 0], RIGHT)  # image right is right
    np.testing.assert_array_equal(R @ [0, 1, 0], DOWN)  # image down is down


@given(ANGLE, PITCH, ANGLE)
def test_angles_survive_the_round_trip(roll: float, pitch: float, yaw: float) -> None:
    R = frames.rotation_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert frames.euler_from_rotation(R) == pytest.approx((roll, pitch, yaw), abs=1e-9)


@given(ANGLE, PITCH, ANGLE)
def test_quaternion_and_angles_agree(roll: float, pitch: float, yaw: float) -> None:
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    assert math.fsum(c * c for c in q) == pytest.approx(1.0)
    R = frames.rotation_from_euler(roll, pitch, yaw)
    np.testing.assert_allclose(frames.rotation_from_quaternion(q), R, atol=1e-12)
    minus = tuple(-3.0 * c for c in q)  # the other sign, not normalised: the same rotation
    np.testing.assert_allclose(frames.rotation_from_quaternion(minus), R, atol=1e-12)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_angles_of_a_camera_that_looks_straight_up_or_down_give_back_the_rotation(pitch: float) -> None:
    R = frames.rotation_from_euler(0.4, pitch, 1.0)
    np.testing.assert_allclose(frames.rotation_from_euler(*frames.euler_from_rotation(R)), R, atol=1e-6)


@given(ANGLE, st.floats(-1.4, 1.4), ANGLE)
def test_level_cam_is_gravity_aligned_along_the_axis_own_heading(roll: float, pitch: float, yaw: float) -> None:
    R_ned_optical = frames.rotation_from_euler(roll, pitch, yaw) @ frames.R_CAMFRD_OPTICAL
    R = frames.rotation_level_cam_optical(R_ned_optical)
    axis = R @ [0, 0, 1]
    np.testing.assert_allclose(axis, [math.cos(pitch), 0.0, -math.sin(pitch)], atol=1e-9)
    np.testing.assert_allclose(R.T @ DOWN, R_ned_optical.T @ DOWN, atol=1e-9)
    turn = frames.horizontal_heading_rad(R_ned_optical)
    assert math.remainder(turn - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_heading_of_a_camera_that_looks_straight_up_or_down_is_that_of_its_upper_edge(pitch: float) -> None:
    """Nose down, the picture's upper edge points where the nose came from; nose up, its lower edge does."""
    R_ned_optical = frames.rotation_from_euler(0.0, pitch, 0.8) @ frames.R_CAMFRD_OPTICAL
    near = frames.rotation_from_euler(0.0, pitch * 0.999, 0.8) @ frames.R_CAMFRD_OPTICAL
    assert frames.horizontal_heading_rad(R_ned_optical) == pytest.approx(0.8, abs=1e-6)
    assert frames.horizontal_heading_rad(near) == pytest.approx(0.8, abs=1e-6)


def test_a_camera_on_the_right_wing_looks_right() -> None:
    mount = CameraMount(yaw_rad=math.pi / 2, y_m=0.4)
    np.testing.assert_allclose(frames.rotation_frd_optical(mount) @ [0, 0, 1], RIGHT, atol=1e-12)
    yaw, t = frames.level_from_level_cam(frames.rotation_from_euler(0.0, 0.0, 2.0), mount)
    assert yaw == pytest.approx(math.pi / 2)
    np.testing.assert_allclose(t, [0.0, 0.4, 0.0], atol=1e-12)


def test_a_camera_pitched_down_in_its_mount_and_a_nose_pitched_up_cancel() -> None:
    mount = CameraMount(pitch_rad=-0.5)
    R_ned_optical = frames.rotation_from_euler(0.0, 0.5, 0.0) @ frames.rotation_frd_optical(mount)
    np.testing.assert_allclose(frames.rotation_level_cam_optical(R_ned_optical), frames.R_CAMFRD_OPTICAL, atol=1e-12)


def test_the_lever_arm_turns_with_the_vehicle() -> None:
    """A camera 1 m ahead of a vehicle with its nose 30 degrees up stands half a metre higher."""
    R = frames.rotation_from_euler(0.0, math.radians(30), 1.3)
    _, t = frames.level_from_level_cam(R, CameraMount(x_m=1.0))
    np.testing.assert_allclose(t, [math.cos(math.radians(30)), 0.0, -0.5], atol=1e-12)


@given(ANGLE, st.floats(-1.0, 1.0), ANGLE, st.floats(-1.5, 1.5), st.floats(-0.3, 0.3), st.floats(-3.0, 3.0))
def test_a_point_goes_the_same_way_through_level_cam_and_directly(
    roll: float, pitch: float, yaw: float, mount_roll: float, mount_pitch: float, mount_yaw: float
) -> None:
    """optical -> level_cam -> level equals optical -> frd -> ned -> level, for any mount."""
    mount = CameraMount(mount_roll, mount_pitch, mount_yaw, 0.1, -0.2, 0.05)
    R_ned_frd = frames.rotation_from_euler(0.4 * roll, pitch, yaw)
    R_frd_optical = frames.rotation_frd_optical(mount)
    p_optical = np.array([0.3, -0.8, 5.0])
    heading, t = frames.level_from_level_cam(R_ned_frd, mount)
    p_level_cam = frames.rotation_level_cam_optical(R_ned_frd @ R_frd_optical) @ p_optical
    through = frames.rotation_from_euler(0.0, 0.0, heading) @ p_level_cam + t
    p_ned = R_ned_frd @ (R_frd_optical @ p_optical + [mount.x_m, mount.y_m, mount.z_m])
    vehicle = math.atan2(R_ned_frd[1, 0], R_ned_frd[0, 0])
    np.testing.assert_allclose(through, frames.rotation_level_ned(vehicle) @ p_ned, atol=1e-9)


@given(ANGLE, PITCH, ANGLE, st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), ANGLE)
def test_a_frame_s_level_view_in_plain_numbers_is_that_of_the_matrices(
    roll: float, pitch: float, yaw: float, mount_roll: float, mount_pitch: float, mount_yaw: float
) -> None:
    mount = CameraMount(mount_roll, mount_pitch, mount_yaw, 0.1, -0.2, 0.05)
    q = frames.quaternion_from_euler(roll, pitch, yaw)
    R_ned_frd = frames.rotation_from_quaternion(q)
    R_ned_optical = R_ned_frd @ frames.rotation_frd_optical(mount)
    R, camera, vehicle, lever_ned_m = frames.level_cam_at(q, mount)
    assume(math.hypot(R_ned_optical[0, 2], R_ned_optical[1, 2]) > 1e-5)  # else rounding decides on the heading
    np.testing.assert_allclose(R, frames.rotation_level_cam_optical(R_ned_optical), atol=1e-9)
    assert math.remainder(camera - frames.horizontal_heading_rad(R_ned_optical), math.tau) == pytest.approx(0, abs=1e-9)
    turn, t_m = frames.level_from_level_cam(R_ned_frd, mount)
    assert math.remainder(camera - vehicle - turn, math.tau) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(frames.rotation_level_ned(vehicle) @ lever_ned_m, t_m, atol=1e-12)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_a_frame_s_level_view_of_a_camera_that_looks_straight_up_or_down(pitch: float) -> None:
    R, heading, _, _ = frames.level_cam_at(frames.quaternion_from_euler(0.0, pitch, 0.8), CameraMount())
    assert heading == pytest.approx(0.8, abs=1e-6)
    assert np.isfinite(R).all()

"""The frames of ROS against the rotations of core/frames.py."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.ros2.frames import (
    BASE_LINK,
    BASE_STABILIZED,
    MAP,
    FrameTransform,
    camera_transform,
    ros_points,
    vehicle_transforms,
)
from core.frames import (
    quaternion_from_euler,
    rotation_frd_optical,
    rotation_from_euler,
    rotation_from_quaternion,
    rotation_level_ned,
)
from core.types import CameraMount

ANGLE = st.floats(-math.pi, math.pi)
PITCH = st.floats(-1.5, 1.5)
METRES = st.floats(-100.0, 100.0)


def at(transform: FrameTransform, point: np.ndarray) -> np.ndarray:
    return rotation_from_quaternion(transform.q_wxyz) @ point + np.array(transform.translation_m)


@pytest.mark.parametrize(
    ("ned", "enu"),
    [((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (1, 0, 0)), ((0, 0, 1), (0, 0, -1))],
    ids=["north", "east", "down"],
)
def test_map_has_the_axes_east_north_up(ned: tuple[float, ...], enu: tuple[float, ...]) -> None:
    assert np.array_equal(ros_points(np.array([ned], np.float32), "ned"), [enu])


def test_base_stabilized_has_the_axes_forward_left_up() -> None:
    assert np.array_equal(ros_points(np.array([[1, 2, 3]], np.float32), "level"), [[1, -2, -3]])


def test_an_unknown_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="'up', expected ned or level"):
        ros_points(np.zeros((1, 3)), "up")


def test_a_vehicle_that_flies_east_level_has_no_rotation_in_map() -> None:
    """REP 103: yaw 0 in map is east."""
    stabilized, base = vehicle_transforms(quaternion_from_euler(0.0, 0.0, math.pi / 2), (1.0, 2.0, -3.0))
    assert (stabilized.parent, stabilized.child, base.parent, base.child) == (
        MAP,
        BASE_STABILIZED,
        BASE_STABILIZED,
        BASE_LINK,
    )
    assert stabilized.translation_m == (2.0, 1.0, 3.0)
    assert np.allclose(rotation_from_quaternion(stabilized.q_wxyz), np.eye(3), atol=1e-12)
    assert np.allclose(rotation_from_quaternion(base.q_wxyz), np.eye(3), atol=1e-12)


def test_nose_up_is_a_negative_rotation_about_left() -> None:
    (base,) = vehicle_transforms(quaternion_from_euler(0.0, 0.3, 1.0), None)
    assert np.allclose(at(base, np.array([1.0, 0.0, 0.0])), [math.cos(0.3), 0.0, math.sin(0.3)])


def test_right_side_down_is_a_positive_rotation_about_forward() -> None:
    (base,) = vehicle_transforms(quaternion_from_euler(0.2, 0.0, 1.0), None)
    assert np.allclose(at(base, np.array([0.0, -1.0, 0.0])), [0.0, -math.cos(0.2), -math.sin(0.2)])


def test_an_unrotated_camera_looks_forward() -> None:
    camera = camera_transform(CameraMount(x_m=0.1, y_m=0.2, z_m=0.3), "front_optical_frame")
    assert (camera.parent, camera.child) == (BASE_LINK, "front_optical_frame")
    assert np.allclose(at(camera, np.array([0.0, 0.0, 5.0])), [5.1, -0.2, -0.3])
    assert np.allclose(at(camera, np.array([1.0, 0.0, 0.0])), [0.1, -1.2, -0.3])  # right in the image


@given(ANGLE, PITCH, ANGLE, ANGLE, PITCH, ANGLE, METRES, METRES, METRES)
def test_the_chain_of_transforms_is_that_of_the_service(
    roll: float, pitch: float, yaw: float, m_roll: float, m_pitch: float, m_yaw: float, x: float, y: float, z: float
) -> None:
    """A point of the camera, by /tf to map and base_stabilized, and by the rotations of the service."""
    mount = CameraMount(roll_rad=m_roll, pitch_rad=m_pitch, yaw_rad=m_yaw, x_m=0.2, y_m=-0.1, z_m=0.05)
    position_ned_m = (z, x, y)
    R_ned_frd = rotation_from_euler(roll, pitch, yaw)
    p_optical = np.array([x, y, z])
    p_frd = rotation_frd_optical(mount) @ p_optical + np.array([0.2, -0.1, 0.05])
    p_ned = R_ned_frd @ p_frd + np.array(position_ned_m)
    heading = math.atan2(R_ned_frd[1, 0], R_ned_frd[0, 0])
    p_level = rotation_level_ned(heading) @ R_ned_frd @ p_frd

    stabilized, base = vehicle_transforms(quaternion_from_euler(roll, pitch, yaw), position_ned_m)
    in_base = at(camera_transform(mount, "optical"), p_optical)
    in_level = at(base, in_base)
    assert np.allclose(in_level, ros_points(p_level[None], "level")[0], atol=1e-6)
    assert np.allclose(at(stabilized, in_level), ros_points(p_ned[None], "ned")[0], atol=1e-6)

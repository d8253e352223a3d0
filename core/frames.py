"""Frames and their rotations.

Signs are those of MAVLink: roll is positive with the right wing down, pitch with the nose up, yaw clockwise from
north."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .types import CameraMount

Rotation = NDArray[np.float64]
Vector = tuple[float, float, float]
Rows = tuple[Vector, Vector, Vector]
"""A rotation as plain numbers, for computations of each frame: numpy calls take longer at this size."""

R_CAMFRD_OPTICAL: Rotation = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from the optical axes (right, down, forward) to the camera's own forward-right-down axes."""


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Rotation:
    """Returns R = Rz(yaw) Ry(pitch) Rx(roll), (3, 3): intrinsic ZYX, as in MAVLink ATTITUDE (R_ned_frd)."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def euler_from_rotation(R: Rotation) -> tuple[float, float, float]:
    """Returns (roll, pitch, yaw) in rad of R = Rz Ry Rx. At |pitch| = 90 degrees, roll is 0."""
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    if abs(R[2, 0]) > 1.0 - 1e-9:
        return 0.0, pitch, math.atan2(-float(R[0, 1]), float(R[1, 1]))
    return math.atan2(float(R[2, 1]), float(R[2, 2])), pitch, math.atan2(float(R[1, 0]), float(R[0, 0]))


def rotation_from_quaternion(q_wxyz: tuple[float, float, float, float]) -> Rotation:
    """Returns the (3, 3) rotation of a quaternion (w, x, y, z), which need not be normalised."""
    return np.array(_rows_of_quaternion(q_wxyz))


def _rows_of_quaternion(q_wxyz: tuple[float, float, float, float]) -> Rows:
    w, x, y, z = q_wxyz
    n = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / n, x / n, y / n, z / n
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Returns the unit quaternion (w, x, y, z) of Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@lru_cache(maxsize=16)
def rotation_frd_optical(mount: CameraMount) -> Rotation:
    """Returns R_frd_optical of a mounted camera, (3, 3), read-only. The result is cached, because each frame needs
    it."""
    R = rotation_from_euler(mount.roll_rad, mount.pitch_rad, mount.yaw_rad) @ R_CAMFRD_OPTICAL
    R.setflags(write=False)
    return R


@lru_cache(maxsize=16)
def _rows_frd_optical(mount: CameraMount) -> Rows:
    a, b, c = (tuple(row) for row in rotation_frd_optical(mount).tolist())
    return a, b, c


def horizontal_heading_rad(R_ned_optical: Rotation) -> float:
    """Returns the heading of the optical axis projected onto the horizontal plane, rad clockwise from north.

    For a camera that looks straight up or down it is the heading of the lower or upper edge of the image, so that the
    result is always defined. The extractor refuses such a tilt (InvalidCause.TOO_STEEP)."""
    _, down, forward = R_ned_optical.T.tolist()
    return _heading_rad(down, forward)


def _heading_rad(down: Sequence[float], forward: Sequence[float]) -> float:
    """Returns `horizontal_heading_rad`. down, forward: the camera's optical y and z axes in ned."""
    x, y, z = forward
    if math.hypot(x, y) < 1e-6:
        turn = -1.0 if z > 0 else 1.0
        x, y = turn * down[0], turn * down[1]
    return math.atan2(y, x)


def rotation_level_cam_optical(R_ned_optical: Rotation) -> Rotation:
    """Returns R_level_cam_optical, (3, 3): level_cam is gravity-aligned with x along the camera's horizontal heading."""
    return rotation_from_euler(0.0, 0.0, -horizontal_heading_rad(R_ned_optical)) @ R_ned_optical


def rotation_level_ned(yaw_rad: float) -> Rotation:
    """Returns R_level_ned of a vehicle with heading yaw_rad, (3, 3)."""
    return rotation_from_euler(0.0, 0.0, -yaw_rad)


def level_from_level_cam(R_ned_frd: Rotation, mount: CameraMount) -> tuple[float, NDArray[np.float64]]:
    """Returns (yaw_rad, t_m) of p_level = Rz(yaw) p_level_cam + t, from the camera's heading and lever arm."""
    R_ned_optical = R_ned_frd @ rotation_frd_optical(mount)
    vehicle_yaw = math.atan2(float(R_ned_frd[1, 0]), float(R_ned_frd[0, 0]))
    yaw = horizontal_heading_rad(R_ned_optical) - vehicle_yaw
    lever_ned = R_ned_frd @ np.array([mount.x_m, mount.y_m, mount.z_m])
    return math.remainder(yaw, 2 * math.pi), rotation_level_ned(vehicle_yaw) @ lever_ned


def level_cam_at(
    q_ned_frd_wxyz: tuple[float, float, float, float], mount: CameraMount
) -> tuple[Rotation, float, float, Vector]:
    """Returns what a frame needs of the attitude, in one computation.

    Equal to `rotation_level_cam_optical` and the parts of `level_from_level_cam`.

    Returns:
        R_level_cam_optical (3, 3), heading of the camera in rad, heading of the vehicle in rad, lever arm in ned in
            m."""
    frd = _rows_of_quaternion(q_ned_frd_wxyz)
    optical = _rows_frd_optical(mount)
    n0, n1, n2 = _times(frd[0], optical)
    e0, e1, e2 = _times(frd[1], optical)
    d0, d1, d2 = _times(frd[2], optical)
    heading_rad = _heading_rad((n1, e1), (n2, e2, d2))
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    R_level_cam_optical = np.array(
        [
            [c * n0 + s * e0, c * n1 + s * e1, c * n2 + s * e2],
            [c * e0 - s * n0, c * e1 - s * n1, c * e2 - s * n2],
            [d0, d1, d2],
        ]
    )
    (n, e, d), (x, y, z) = frd, (mount.x_m, mount.y_m, mount.z_m)
    lever_ned_m = n[0] * x + n[1] * y + n[2] * z, e[0] * x + e[1] * y + e[2] * z, d[0] * x + d[1] * y + d[2] * z
    return R_level_cam_optical, heading_rad, math.atan2(e[0], n[0]), lever_ned_m


def _times(row: Vector, b: Rows) -> Vector:
    """Returns one row of the product of two rotations."""
    x, y, z = row
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    return x * b00 + y * b10 + z * b20, x * b01 + y * b11 + z * b21, x * b02 + y * b12 + z * b22

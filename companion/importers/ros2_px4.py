"""px4_msgs in ROS 2 recordings: VehicleAttitude, VehicleLocalPosition and VehicleOdometry, already in ned and frd.

Stamps are microseconds; the uXRCE-DDS client maps them to the companion's clock unless its UXRCE_DDS_SYNCT is 0."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .ros2_frames import rotation_of_unit

VEHICLE_ATTITUDE: Final = "px4_msgs/VehicleAttitude"
VEHICLE_ODOMETRY: Final = "px4_msgs/VehicleOdometry"
VEHICLE_LOCAL_POSITION: Final = "px4_msgs/VehicleLocalPosition"
PX4_TYPES: Final = (VEHICLE_ATTITUDE, VEHICLE_ODOMETRY, VEHICLE_LOCAL_POSITION)
POSE_NED: Final = 1
"""VehicleOdometry.pose_frame: 0 unknown, 1 ned, 2 frd that is fixed in the world, whose axes do not point north."""
VELOCITY_NED: Final = 1
VELOCITY_BODY: Final = 3
"""VehicleOdometry.velocity_frame: 0 unknown, 1 ned, 2 frd that is fixed in the world, 3 frd of the body."""

DEFINITIONS: Final = {
    "px4_msgs/msg/VehicleAttitude": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\nfloat32[4] delta_q_reset\nuint8 quat_reset_counter\n"
    ),
    "px4_msgs/msg/VehicleOdometry": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint8 pose_frame\nfloat32[3] position\nfloat32[4] q\n"
        "uint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity\nfloat32[3] position_variance\n"
        "float32[3] orientation_variance\nfloat32[3] velocity_variance\nuint8 reset_counter\nint8 quality\n"
    ),
}
"""For bags without definitions; PX4 1.14 and later."""

Floats = NDArray[np.float64]


def px4_stamp_ns(message: Any) -> int:
    """Time of the measurement, ns."""
    return int(message.timestamp_sample or message.timestamp) * 1000


def px4_rotation(message: Any) -> Floats | None:
    """(3, 3) R_ned_frd; None when the quaternion is not one (PX4 writes NaN for "not known")."""
    w, x, y, z = (float(v) for v in message.q)
    return rotation_of_unit((w, x, y, z))


@dataclass(frozen=True, slots=True)
class Px4Place:
    """A valid VehicleLocalPosition: position and velocity in ned; None: no valid velocity."""

    t_ns: int
    log_ns: int
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float] | None
    reset_counter: int


def px4_place(message: Any, t_ns: int, log_ns: int) -> Px4Place | None:
    """The position of a VehicleLocalPosition; None where its estimator does not call it valid. PX4 sends the message
    always, and its MAVLink stream LOCAL_POSITION_NED by the same flags."""
    position = float(message.x), float(message.y), float(message.z)
    velocity = float(message.vx), float(message.vy), float(message.vz)
    valid = message.xy_valid and message.z_valid and message.v_xy_valid
    if not valid or not all(map(math.isfinite, position)):
        return None
    known = message.v_z_valid and all(map(math.isfinite, velocity))
    counter = int(message.xy_reset_counter) << 8 | int(message.z_reset_counter)
    return Px4Place(t_ns, log_ns, position, velocity if known else None, counter)


def px4_vector(values: Any) -> Floats | None:
    """(3,) of a message's array; None when it is not finite."""
    vector = np.array([float(v) for v in values])
    return vector if np.isfinite(vector).all() else None

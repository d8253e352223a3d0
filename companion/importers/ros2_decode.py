"""Decodes ROS 2 messages by the definitions in the recording and checks the fields that are read."""

from __future__ import annotations

import struct
from operator import attrgetter
from typing import Any, Final

from mcap.exceptions import McapError
from mcap_ros2._vendor.rosidl_adapter.parser import InvalidSpecification, InvalidValue
from mcap_ros2.decoder import DecoderFactory

from drivers.logs.record_scanner import Logged

from .ros2_px4 import PX4_TYPES, VEHICLE_ATTITUDE, VEHICLE_LOCAL_POSITION, VEHICLE_ODOMETRY

IMAGE, CAMERA_INFO, TF = "sensor_msgs/Image", "sensor_msgs/CameraInfo", "tf2_msgs/TFMessage"
ODOMETRY, POSE, IMU = "nav_msgs/Odometry", "geometry_msgs/PoseStamped", "sensor_msgs/Imu"
MOTION_TYPES: Final = (ODOMETRY, POSE, IMU, *PX4_TYPES)
COMPRESSED: Final = "sensor_msgs/CompressedImage"

_HEADER = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")


def _paths(prefix: str, names: str) -> tuple[str, ...]:
    return tuple(f"{prefix}.{name}" for name in names)


_READ: Final[dict[str, tuple[str, ...]]] = {
    IMAGE: (*_HEADER, "width", "height", "encoding", "is_bigendian", "step", "data"),
    COMPRESSED: (*_HEADER, "format", "data"),
    CAMERA_INFO: ("width", "height", "d", "k", "r", "p"),
    TF: ("transforms",),
    ODOMETRY: (
        *_HEADER,
        "child_frame_id",
        *_paths("pose.pose.position", "xyz"),
        *_paths("pose.pose.orientation", "wxyz"),
        *_paths("twist.twist.linear", "xyz"),
        *_paths("twist.twist.angular", "xyz"),
    ),
    POSE: (*_HEADER, *_paths("pose.position", "xyz"), *_paths("pose.orientation", "wxyz")),
    VEHICLE_ATTITUDE: ("timestamp", "timestamp_sample", "q"),
    VEHICLE_ODOMETRY: (
        "timestamp",
        "timestamp_sample",
        "q",
        *("pose_frame", "position", "velocity_frame", "velocity", "angular_velocity", "reset_counter", "quality"),
    ),
    VEHICLE_LOCAL_POSITION: (
        "timestamp",
        "timestamp_sample",
        *("xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "xy_reset_counter", "z_reset_counter"),
        *("x", "y", "z", "vx", "vy", "vz"),
    ),
    IMU: (*_HEADER, "orientation_covariance", *_paths("orientation", "wxyz"), *_paths("angular_velocity", "xyz")),
}
_READ_OF_TRANSFORM: Final = (
    *_HEADER,
    "child_frame_id",
    *_paths("transform.translation", "xyz"),
    *_paths("transform.rotation", "wxyz"),
)
_LENGTHS: Final = {
    CAMERA_INFO: {"k": 9, "r": 9, "p": 12},
    IMU: {"orientation_covariance": 9},
    VEHICLE_ATTITUDE: {"q": 4},
    VEHICLE_ODOMETRY: {"q": 4, "position": 3, "velocity": 3, "angular_velocity": 3},
}
"""Arrays that are read by index, and their length."""
DECODE_ERRORS: Final = (
    struct.error,
    McapError,
    InvalidSpecification,
    InvalidValue,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    NameError,
    NotImplementedError,
)
"""Exceptions of the decoder for a damaged message or definition."""


def type_of(schema_name: str) -> str:
    """sensor_msgs/Image for sensor_msgs/msg/Image."""
    return schema_name.replace("/msg/", "/")


def complete(kind: str, message: Any) -> bool:
    """Whether a decoded message has the fields and array lengths that are read. Raises one of DECODE_ERRORS where a field is
    missing."""
    attrgetter(*_READ[kind])(message)
    for transform in message.transforms if kind == TF else ():
        attrgetter(*_READ_OF_TRANSFORM)(transform)
    return all(len(getattr(message, name)) == length for name, length in _LENGTHS.get(kind, {}).items())


class Ros2Decoder:
    """Decodes messages of the supported types of one file, whose numbers of types another file may use for others; None where
    a message does not fit its definition, or the definition not its type."""

    def __init__(self) -> None:
        self._factory = DecoderFactory()

    def __call__(self, item: Logged) -> Any:
        """The decoded message."""
        kind = type_of(item.schema.name if item.schema else "")
        try:
            decode = self._factory.decoder_for(item.channel.message_encoding, item.schema)
            message = decode(item.message.data) if decode is not None else None
            return message if message is not None and complete(kind, message) else None
        except DECODE_ERRORS:
            return None

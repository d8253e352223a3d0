"""The ROS messages that are published, with the type definitions of the library rosbags (extra `ros2`)."""

from __future__ import annotations

from typing import Any

from drivers.optional_library import optional_module

from .wire import TopicType

NS = 1_000_000_000
NEED = "the ROS 2 bridge needs rosbags and eclipse-zenoh", "rosbags>=0.11", "eclipse-zenoh>=1.5"
"""Both libraries of the extra, for the message where one of them is missing."""


class RosMessages:
    """Creates and serialises messages. Raises DeviceNotFound where rosbags is not installed."""

    def __init__(self) -> None:
        typesys = optional_module("rosbags.typesys", *NEED)
        self._store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def make(self, name: str, /, **fields: Any) -> Any:
        """A message of a type such as std_msgs/msg/Header; all fields are given."""
        return self._store.types[name](**fields)

    def constant(self, name: str, constant: str) -> int:
        """A constant of a type."""
        return int(getattr(self._store.types[name], constant))

    def topic_type(self, name: str) -> TopicType:
        """A type with its hash."""
        return TopicType(name, str(self._store.hash_rihs01(name)))

    def serialise(self, message: Any, name: str) -> bytes:
        """A message in CDR, with the header of its encapsulation."""
        return bytes(self._store.serialize_cdr(message, name))

    def header(self, stamp_ns: int, frame: str) -> Any:
        """std_msgs/Header. stamp_ns: wall time; 0: the newest transform is used."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // NS, nanosec=stamp_ns % NS)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Vector3."""
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def point(self, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Point."""
        return self.make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def quaternion(self, w: float, x: float, y: float, z: float) -> Any:
        """geometry_msgs/Quaternion."""
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

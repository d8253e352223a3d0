"""Names and attachments of rmw_zenoh, the ROS 2 middleware on Zenoh (Jazzy and later).

Source: ros2/rmw_zenoh: its design page (design.md), liveliness_utils.cpp, attachment_helpers.cpp. They are no public interface of ROS;
they have been the same from rmw_zenoh 0.2 (Jazzy) on. Humble has no type hashes: its nodes do not match these names."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from typing import Final

ADMIN_SPACE: Final = "@ros2_lv"
QOS: Final = "::,10:,:,:,,"
"""Reliable, volatile, keep last 10, all other policies at their defaults; an empty field is rmw_zenoh's default."""
GID_BYTES: Final = 16

_NAME: Final = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True, slots=True)
class TopicType:
    """A message type of ROS 2."""

    name: str  # as in `sensor_msgs/msg/PointCloud2`
    type_hash: str  # its hash, RIHS01_ and 64 hexadecimal digits

    @property
    def dds_name(self) -> str:
        """The name on the wire: sensor_msgs::msg::dds_::PointCloud2_."""
        package, kind, message = self.name.split("/")
        return f"{package}::{kind}::dds_::{message}_"


@dataclass(frozen=True, slots=True)
class NodeName:
    """A node of the ROS graph."""

    domain: int
    zid: str  # identifier of the Zenoh session
    namespace: str  # with a leading slash
    name: str

    def token(self) -> str:
        """The liveliness token that declares the node."""
        return f"{ADMIN_SPACE}/{self.domain}/{self.zid}/0/0/NN/%/{mangled(self.namespace)}/{self.name}"

    def publisher_token(self, number: int, topic: str, kind: TopicType) -> str:
        """The liveliness token that declares a publisher. number: unique in the session; topic: with a leading slash."""
        return (
            f"{ADMIN_SPACE}/{self.domain}/{self.zid}/0/{number}/MP/%/{mangled(self.namespace)}/{self.name}/"
            f"{mangled(topic)}/{kind.dds_name}/{kind.type_hash}/{QOS}"
        )


def topic_key(domain: int, topic: str, kind: TopicType) -> str:
    """The key expression on which the messages of a topic are published."""
    return f"{domain}/{topic.strip('/')}/{kind.dds_name}/{kind.type_hash}"


def mangled(name: str) -> str:
    """A ROS name within one part of a key expression."""
    return name.replace("/", "%")


def gid(token: str) -> bytes:
    """The identifier of a publisher, 16 bytes. ROS requires that it is unique and constant; rmw_zenoh takes another hash of
    the same token."""
    return hashlib.sha256(token.encode()).digest()[:GID_BYTES]


def absolute_name(text: str) -> str:
    """A ROS namespace with its leading slash. Raises ValueError for one that ROS does not allow."""
    if not _NAME.fullmatch(text):
        raise ValueError(
            f"namespace {text!r}: expected letters, digits and _, not beginning with a digit, separated by /"
        )
    return "/" + text.strip("/")


def name_part(text: str) -> str:
    """A camera's name as a part of ROS names: other characters than letters, digits and _ become _."""
    part = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return part if part and not part[0].isdigit() else f"camera_{part}"

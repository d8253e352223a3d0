"""The table of topics: it defines writing, reading and the tables in docs/reference/messages.md."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from osape_client.proto import osape_v1_pb2 as pb

ENCODING: Final = "protobuf"

_CAMERA_PLACE = "{camera}"


@dataclass(frozen=True, slots=True)
class Topic:
    """One kind of message. `name` may contain the placeholder `{camera}`."""

    name: str
    message: type[Message]
    rate: str
    what: str

    @property
    def schema(self) -> str:
        """The full name of the message type."""
        return str(self.message.DESCRIPTOR.full_name)

    def of(self, camera: str = "") -> str:
        """The topic's name, with the camera where it has one."""
        return self.name.replace(_CAMERA_PLACE, camera)

    def camera_of(self, name: str) -> str | None:
        """The camera (empty where the topic has none) if `name` is this topic, otherwise None."""
        pattern = re.escape(self.name).replace(re.escape(_CAMERA_PLACE), "([^/]+)")
        match = re.fullmatch(pattern, name)
        if match is None:
            return None
        return match.group(1) if match.groups() else ""


TOPICS: Final[dict[str, Topic]] = {
    "run": Topic("/run", pb.RunInfo, "first, again last", "software, effective configuration"),
    "camera_info": Topic(
        "/camera/{camera}/info", pb.CameraInfo, "first, again last", "intrinsics, mount, range, noise prior"
    ),
    "calibration": Topic("/camera/{camera}/calibration", CameraCalibration, "once", "intrinsics for viewers"),
    "state": Topic("/state", pb.StateSnapshot, "once", "the state that the frames after it depend on"),
    "depth": Topic("/camera/{camera}/depth", RawImage, "each frame", "16UC1, mm along the optical axis"),
    "attitude": Topic("/vehicle/attitude", pb.AttitudeSample, "as received", "attitude and body rates"),
    "pose": Topic("/vehicle/pose", pb.PoseSample, "as received", "position and velocity"),
    "mavlink": Topic("/vehicle/mavlink", pb.MavlinkFrame, "as received", "MAVLink as received"),
    "clock": Topic("/vehicle/clock", pb.ClockEstimate, "at each change", "estimate of the autopilot's clock"),
    "health": Topic("/health", pb.Health, "1 Hz", "state of the service"),
    "decision": Topic("/camera/{camera}/decision", pb.FrameDecision, "each frame", "used or dropped, with the cause"),
    "prisms": Topic("/camera/{camera}/prisms", pb.PrismsFrame, "each frame", "planes, prisms, free space, counts"),
    "tracks": Topic(
        "/camera/{camera}/tracks", pb.Tracks, "each frame", "tracked obstacles, where [tracking] is enabled"
    ),
    "team": Topic(
        "/team/packets", pb.TeamPacket, "as exchanged", "packets of other vehicles and own ones, with [share]"
    ),
    "neighbours": Topic(
        "/team/obstacles", pb.NeighbourObstacles, "1 Hz", "obstacles that other vehicles have reported, with [share]"
    ),
    "scene": Topic("/camera/{camera}/scene", SceneUpdate, "each frame", "drawing of the prisms, for viewers"),
    "transform": Topic("/tf", FrameTransform, "each frame", "up -> ned -> level -> frd -> camera, for viewers"),
}
"""Key -> topic, in the order of the table in the docs."""


def find_topic(name: str, schema: str) -> tuple[str, str] | None:
    """(key, camera) of a channel of this software, otherwise None."""
    for key, topic in TOPICS.items():
        if schema == topic.schema:
            camera = topic.camera_of(name)
            if camera is not None:
                return key, camera
    return None


def camera_name_fits(camera: str) -> bool:
    """Whether a camera's name can be part of a topic: letters, digits, dot, dash and underscore."""
    return re.fullmatch(r"[A-Za-z0-9._-]+", camera) is not None

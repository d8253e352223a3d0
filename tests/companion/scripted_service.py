"""A service that publishes given messages, for those who subscribe."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import zmq

from companion.live.depth_preview import DepthPreviews
from companion.pipeline.encode import blind_message, prisms_message
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import AttitudeAt, DropCause, Source
from companion.pipeline.transform import LevelTransform, transform_model
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher, Stream
from companion.viewer.subscriber import Streams
from core.frames import level_from_level_cam, quaternion_from_euler, rotation_from_quaternion
from core.types import DepthFrame
from drivers.logs.codec import camera_message
from osape_client.boot import boot_id
from osape_client.proto import osape_v1_pb2 as pb

from .view_scenes import INFO, model

WALL = [4.0, -1.0, 4.0, 1.0, -0.6, 0.8]
YAW_RAD = 0.7


class ScriptedService:
    """A service that publishes given messages."""

    def __init__(self, folder: Path) -> None:
        self.streams = Streams(
            prisms=f"ipc://{folder}/prisms", health=f"ipc://{folder}/health", depth=f"ipc://{folder}/depth"
        )
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._prisms, self._health = (
            Publisher(Stream(name, getattr(self.streams, name)), self._context) for name in ("prisms", "health")
        )
        self.previews = DepthPreviews(PublicationStamps(boot_id()), 15.0)
        self.previews.open(self.streams.depth, self._context)
        self.sequence = 0

    def health(self) -> None:
        report = pb.Health(schema_version=1, state=pb.Health.STATE_ACTIVE, number=self.sequence)
        report.cameras.add(camera="front", condition="running", required=True, hz=30.0, info=camera_message(INFO))
        self.publish_health(report)

    def publish_health(self, report: pb.Health) -> None:
        self._health.publish(report)

    def message(self, age_ns: int = 60_000_000) -> pb.PrismsFrame:
        """A wall 4 m ahead, seen with the nose to 0.7 rad."""
        self.sequence += 1
        t_ns = time.monotonic_ns() - age_ns
        q = quaternion_from_euler(0.0, 0.0, YAW_RAD)
        yaw, at = level_from_level_cam(rotation_from_quaternion(q), INFO.mount)
        step = LevelTransform(yaw, (float(at[0]), float(at[1]), float(at[2])))
        result = PrismsResult(
            camera="front",
            sequence=self.sequence,
            t_exposure_ns=t_ns,
            t_arrival_ns=t_ns,
            frame="level",
            model=transform_model(model([WALL]), step),
            attitude=AttitudeAt(q, Source.EXACT, 0),
            transform=step,
            drop=DropCause.NONE,
        )
        message = prisms_message(result)
        message.publication.CopyFrom(PublicationStamps(boot_id()).stamp(0, age_ns))
        return message

    def publish(self, message: pb.PrismsFrame) -> None:
        self._prisms.publish(message)

    def frame(self, depth: bool = False, age_ns: int = 60_000_000) -> None:
        """Publishes a frame. depth: its depth image too, where there is a subscriber."""
        message = self.message(age_ns)
        self.publish(message)
        t_ns = message.t_exposure_ns
        if depth:
            depth_mm = np.full((240, 320), 4000, np.uint16)
            self.previews.show(
                DepthFrame(
                    camera="front", sequence=self.sequence, t_exposure_ns=t_ns, t_arrival_ns=t_ns, depth_mm=depth_mm
                )
            )

    def blind(self, cause: str, camera: str = "front") -> None:
        message = blind_message(camera, self.sequence, time.monotonic_ns(), cause)
        message.publication.CopyFrom(PublicationStamps(boot_id()).stamp(0, 0))
        self._prisms.publish(message)

    def nonsense(self) -> None:
        self._prisms.publish(b"\xff\xff\xff\xff")

    def close(self) -> None:
        self.previews.close()
        self._prisms.close()
        self._health.close()
        self._context.destroy(linger=0)

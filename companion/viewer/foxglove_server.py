"""A WebSocket server for Foxglove's viewer, with the topics and schemas of a log (extra `foxglove`).

The server of foxglove-sdk accepts every Host and Origin header and has no option to refuse one (0.30). A web page that
is open in a browser of this computer can therefore read the streams, also where the server listens on 127.0.0.1 only.
The page of `live_server.py` refuses such requests.

Drawings expire in the viewer after one second. Blind cameras and their causes are published on `/status` once per
second, since a viewer does not show that messages have stopped."""

from __future__ import annotations

import time
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from core.types import CameraInfo, DepthFrame
from drivers.base import DeviceNotFound
from drivers.logs.codec import depth_message, stamp
from drivers.logs.topics import ENCODING, TOPICS
from drivers.optional_library import optional_module
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb

from ..log.foxglove_scene import scene_message, transform_messages
from ..log.log_writer import schema_bytes
from ..pipeline.results import PrismsResult
from ..pipeline.sync import DropCause
from .live_camera import NS
from .live_page import decoded, preview_depth_mm
from .live_status import camera_status
from .subscriber import WATCHED_S, LiveSubscriber

STATUS_TOPIC = "/status"
REPEAT_NS = NS
BACKLOG = 64
"""Largest number of messages that wait for a slow viewer, the oldest are dropped: with the 1024 of foxglove-sdk it would
receive images of a minute ago as new ones, and 600 MB of them would wait in this process."""


class FoxgloveServer:
    """Call `open`, then `tick` repeatedly. `open` raises DeviceNotFound where the extra is not installed or the port
    cannot be bound."""

    def __init__(self, subscriber: LiveSubscriber, host: str, port: int) -> None:
        self._subscriber, self._host, self.port = subscriber, host, port
        self._sdk: Any = None
        self._context: Any = None
        self._server: Any = None
        self._channels: dict[str, Any] = {}
        self._sent: dict[str, tuple[str | None, int]] = {}

    def open(self) -> None:
        """Starts the server; messages of the subscriber are forwarded from then on."""
        self._sdk = optional_module("foxglove", "the Foxglove server needs foxglove-sdk", "foxglove-sdk>=0.30")
        self._context = self._sdk.Context()
        try:
            self._server = self._sdk.start_server(
                name="osape-companion",
                host=self._host,
                port=self.port,
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            raise DeviceNotFound(
                f"the Foxglove server: port {self.port} on {self._host} cannot be bound ({error}); choose another port"
            ) from error
        self.port = self._server.port
        self._channel(TOPICS["health"].of(), pb.Health)
        self._channel(STATUS_TOPIC, Log)
        self._subscriber.on_message = self.on_message

    def close(self) -> None:
        """Stops the server. May be called twice."""
        self._subscriber.on_message = None
        if self._server is not None:
            self._server.stop()
            self._server = None

    def on_message(self, message: Message, info: CameraInfo | None) -> None:
        """Forwards a received message, in the subscriber's thread, if a viewer has subscribed. info: of the message's
        camera."""
        if isinstance(message, pb.Health):
            self._send(TOPICS["health"].of(), message, message.t_ns)
        elif isinstance(message, pb.PrismsFrame):
            self._prisms(message, info)
        elif isinstance(message, pb.DepthPreview):
            self._depth(message)

    def _prisms(self, message: pb.PrismsFrame, info: CameraInfo | None) -> None:
        t_ns, camera = message.t_exposure_ns, message.camera
        self._send(TOPICS["prisms"].of(camera), message, t_ns)
        scene, tf = TOPICS["scene"].of(camera), TOPICS["transform"].of()
        wanted = [self._wants(scene, TOPICS["scene"].message), self._wants(tf, TOPICS["transform"].message)]
        self._channel(TOPICS["depth"].of(camera), TOPICS["depth"].message)
        if not any(wanted):
            return
        blind = PrismsResult(
            camera=camera,
            sequence=message.sequence,
            t_exposure_ns=t_ns,
            t_arrival_ns=t_ns,
            frame=message.frame,
            drop=DropCause.NONE,
            model=None,
        )
        result = decoded(message)[0] or blind
        self._send(scene, scene_message(result), t_ns)
        for transform in transform_messages(result, info) if info is not None else ():
            self._send(tf, transform, t_ns)

    def _depth(self, p: pb.DepthPreview) -> None:
        depth_mm = preview_depth_mm(p)
        if depth_mm is not None:
            frame = DepthFrame(
                camera=p.camera,
                sequence=p.sequence,
                t_exposure_ns=p.t_exposure_ns,
                t_arrival_ns=p.t_exposure_ns,
                depth_mm=depth_mm,
            )
            self._send(TOPICS["depth"].of(p.camera), depth_message(frame), p.t_exposure_ns)

    def tick(self) -> None:
        """Publishes the state of each camera: blind once per second, not blind once."""
        now_ns, t_ns = clock_ns(), time.monotonic_ns()
        wanted = self._wants(STATUS_TOPIC, Log)
        with self._subscriber.changed:
            newest = {name: camera.newest for name, camera in self._subscriber.cameras.items()}
        errors = {name: decoded(m)[1] if wanted and m is not None and m.valid else "" for name, m in newest.items()}
        with self._subscriber.changed:
            causes = {name: self._cause(name, errors[name], now_ns) for name in newest}
        for name, blind in causes.items() if wanted else ():
            before, at_ns = self._sent.get(name, (None, 0))
            if blind == before and (not blind or now_ns - at_ns < REPEAT_NS):
                continue
            self._sent[name] = blind, now_ns
            text = f"{name} is BLIND: {blind}; do not treat any direction as free" if blind else f"{name}: not blind"
            level = Log.FATAL if blind else Log.INFO
            self._send(STATUS_TOPIC, Log(timestamp=stamp(t_ns), level=level, message=text, name="companion"), t_ns)
        depth = [TOPICS["depth"].of(name) for name in causes]
        if any(topic in self._channels and self._channels[topic].has_sinks() for topic in depth):
            self._subscriber.watch(WATCHED_S)

    def _cause(self, name: str, decode_error: str, now_ns: int) -> str:
        blind = camera_status(self._subscriber, name, None, decode_error, now_ns)["blind"]
        return str(blind)

    def _wants(self, topic: str, kind: type[Message]) -> bool:
        return bool(self._channel(topic, kind).has_sinks())

    def _send(self, topic: str, message: Message, t_ns: int) -> None:
        channel = self._channel(topic, type(message))
        if channel.has_sinks():
            channel.log(message.SerializeToString(), log_time=t_ns)

    def _channel(self, topic: str, kind: type[Message]) -> Any:
        """The channel of a topic, created at its first use."""
        if topic not in self._channels:
            schema = self._sdk.Schema(name=kind.DESCRIPTOR.full_name, encoding=ENCODING, data=schema_bytes(kind))
            self._channels[topic] = self._sdk.Channel(
                topic, schema=schema, message_encoding=ENCODING, context=self._context
            )
        return self._channels[topic]

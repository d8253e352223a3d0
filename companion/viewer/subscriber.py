"""The subscriber of `companion view --live`: the newest message of each stream and its age.

A page's request is answered at once when there is a new frame, otherwise after a short wait with the ages only. A page
has one request at a time, so a slow page receives fewer frames but no old ones. Depth images are subscribed to only
while pages request frames."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zmq
from google.protobuf.message import DecodeError, Message

from core.types import CameraInfo
from drivers.logs.codec import camera_from_message
from osape_client.clock import clock_ns
from osape_client.connect import connect
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.receive_time import Delays, TimedSocket, age_ns
from osape_client.run_folder import run_folder
from osape_client.sources import Sources, Verdict

from ..config.service import PublishConfig
from .live_camera import NS, Camera
from .live_team import LiveTeam
from .live_world import LiveWorld

POLL_S = 0.05
WATCHED_S = 2.0
"""Time for which depth images stay subscribed after a page's last request."""
HEALTH_OLD_NS = 3 * NS
"""Health reports arrive once per second; after this time without one the service counts as silent."""
NICE = 10
"""Priority of a viewer's process: the service has precedence."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """Addresses of the streams; empty: not subscribed."""

    prisms: str
    health: str
    depth: str
    world: str = ""
    world_requests: str = ""
    neighbours: str = ""
    tracks: str = ""
    keys: Path | None = None  # directory of the client keys, for another computer


def streams_of(publish: PublishConfig, keys: Path | None) -> Streams:
    """The addresses of a service with this configuration."""
    names = ("prisms", "health", "depth", "world", "world_requests", "neighbours", "tracks")
    run = run_folder()
    return Streams(**{name: publish.address(name, run) for name in names}, keys=keys)


class LiveSubscriber:
    """Receives in a thread of its own; its methods may be called from any thread. on_message: called from it with each
    message and its camera."""

    def __init__(self, streams: Streams) -> None:
        self.streams = streams
        self.changed = threading.Condition()
        self.cameras: dict[str, Camera] = {}
        self.health: pb.Health | None = None
        self.health_ns = 0
        self.number = 0
        self.undecodable = ""
        self.conflict_ns = 0  # when a frame last arrived that was not used because there are two services; 0: never
        self.on_message: Callable[[Message, CameraInfo | None], None] | None = None
        self.begun_ns = clock_ns()
        self._watched_ns = self._depth_since_ns = 0
        self._stop = threading.Event()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._receivers: dict[zmq.Socket[bytes], tuple[TimedSocket, type[Message], Sources]] = {}
        self._frame_delays, self._preview_delays = Delays(), Delays()
        self._depth: zmq.Socket[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
        self.world = LiveWorld(streams.world, streams.world_requests, streams.keys, self.vehicle)
        self.team = LiveTeam(streams.neighbours, streams.keys)

    def open(self) -> None:
        """Starts to receive; the service may start later. Raises DriverError for unusable keys."""
        kinds: dict[str, type[Message]] = {
            "prisms": pb.PrismsFrame,
            "health": pb.Health,
            "depth": pb.DepthPreview,
            "tracks": pb.Tracks,
        }
        for name, kind in kinds.items():
            address = getattr(self.streams, name)
            if not address:
                continue
            socket = self._context.socket(zmq.SUB)
            self._receivers[socket] = TimedSocket(socket, address), kind, Sources()
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.RCVHWM, 20)
            if name == "depth":
                self._depth = socket
            else:
                socket.setsockopt(zmq.SUBSCRIBE, b"")
            connect(socket, address, self.streams.keys)
        self._thread.start()
        self.world.open()
        self.team.open()

    def close(self) -> None:
        """Ends the thread. May be called twice."""
        self.world.close()
        self.team.close()
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)
        self._context.destroy(linger=0)

    @property
    def running(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def wait(self, after: int, timeout_s: float) -> None:
        """Waits until there is a frame with a higher number than `after`, or until the time limit."""
        self.watch(WATCHED_S)
        with self.changed:
            self.changed.wait_for(lambda: self.number > after, timeout_s)

    def vehicle(self) -> tuple[float, float, float] | None:
        """The vehicle's position in ned from the newest frame with a position; None: none."""
        posed = [c for c in self.cameras.copy().values() if c.newest is not None and c.newest.HasField("pose")]
        if not posed:
            return None
        newest = max(posed, key=lambda c: c.exposed_ns).newest
        assert newest is not None
        p = newest.pose.position_ned_m
        return p.x, p.y, p.z

    def watch(self, seconds: float) -> None:
        """Subscribes to depth images for the given time."""
        self._watched_ns = clock_ns() + round(seconds * NS)

    def depth_missing(self, now_ns: int) -> bool:
        """Whether depth images are subscribed to and none arrives."""
        seen = any(c.preview is not None and now_ns - c.preview_exposed_ns < 3 * NS for c in self.cameras.values())
        return not seen and self._depth_since_ns > 0 and now_ns - self._depth_since_ns > 2 * NS

    # ---- listening ----------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        poller = zmq.Poller()
        for socket in self._receivers:
            poller.register(socket, zmq.POLLIN)
        while not self._stop.is_set():
            poller.poll(round(1000 * POLL_S))
            now_ns = clock_ns()
            self._subscribe_depth(now_ns)
            with self.changed:
                for receiver, kind, sources in self._receivers.values():
                    self._take(receiver, kind, sources, now_ns)
                for camera in self.cameras.values():
                    if camera.choose(now_ns, self.number + 1):
                        self.number += 1
                        self.changed.notify_all()

    def _subscribe_depth(self, now_ns: int) -> None:
        if self._depth is None or (now_ns < self._watched_ns) == (self._depth_since_ns > 0):
            return
        if self._depth_since_ns == 0:
            self._depth.setsockopt(zmq.SUBSCRIBE, b"")
            self._depth_since_ns = now_ns
        else:
            self._depth.setsockopt(zmq.UNSUBSCRIBE, b"")
            self._depth_since_ns = 0

    def _take(self, receiver: TimedSocket, kind: type[Message], sources: Sources, now_ns: int) -> None:
        """Takes all waiting messages of a socket. A message that waited while this process was blocked gets its largest
        possible age."""
        while (taken := receiver.take()) is not None:
            (data, arrival_ns), message = taken, kind()
            try:
                message.ParseFromString(data)
                if getattr(message, "schema_version", 0) != 1:
                    raise DecodeError(
                        f"schema version {getattr(message, 'schema_version', 0)}; this page reads version 1"
                    )
                if not isinstance(message, pb.Health) and not message.HasField("publication"):
                    raise DecodeError("cut short: the part that is written last is missing")
            except DecodeError as error:
                self.undecodable = f"{len(data)} bytes that cannot be decoded as {kind.DESCRIPTOR.name} ({error})"
                continue
            if not isinstance(message, pb.Health) and not self._is_of_one_service(message, sources, arrival_ns):
                continue
            self._add(message, now_ns, arrival_ns)
            on_message = self.on_message
            if on_message is not None:
                known = self.cameras.get(getattr(message, "camera", ""))
                on_message(message, None if known is None else known.info)

    def _is_of_one_service(self, message: Any, sources: Sources, arrival_ns: int) -> bool:
        """False: the message is of a service that has ended, or of one of two."""
        verdict = sources.take(message.publication, message.t_exposure_ns, arrival_ns)
        if isinstance(message, pb.PrismsFrame) and verdict is Verdict.CONFLICT:
            self.conflict_ns = clock_ns()
        return verdict is Verdict.USED

    def _add(self, message: Message, now_ns: int, arrival_ns: int) -> None:
        if isinstance(message, pb.Health):
            self._health(message, arrival_ns)
        elif isinstance(message, pb.PrismsFrame):
            exposed_ns = now_ns - _age_ns(message, arrival_ns, self._frame_delays)
            self._camera(message.camera).add_frame(message, exposed_ns, now_ns)
        elif isinstance(message, pb.DepthPreview):
            exposed_ns = now_ns - _age_ns(message, arrival_ns, self._preview_delays)
            self._camera(message.camera).add_preview(message, exposed_ns)
        elif isinstance(message, pb.Tracks):
            self._camera(message.camera).add_tracks(message)

    def _health(self, message: pb.Health, arrival_ns: int) -> None:
        self.health, self.health_ns = message, arrival_ns
        for camera_health in message.cameras:
            camera = self._camera(camera_health.camera)
            if camera_health.HasField("info"):
                try:
                    camera.info = camera_from_message(camera_health.info)
                except ValueError as error:
                    self.undecodable = f"an invalid description of camera {camera_health.camera} ({error})"

    def _camera(self, name: str) -> Camera:
        return self.cameras.setdefault(name, Camera())


def _age_ns(message: pb.PrismsFrame | pb.DepthPreview, received_ns: int, delays: Delays) -> int:
    """Age of an exposure, and what its message took longer than the fastest one of the stream."""
    arrival_ns = delays.arrival_ns(message.publication, message.t_exposure_ns, received_ns)
    return age_ns(message.publication, message.t_exposure_ns, arrival_ns)

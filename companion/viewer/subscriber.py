"""The subscriber of `companion view --live`: the newest message of each stream, its age, and the frames to draw.

A page's request is answered at once when there is a new frame, otherwise after a short wait with the ages only. A page
has one request at a time, so a slow page receives fewer frames but no old ones. Depth images are subscribed to only
while pages request frames."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from google.protobuf.message import DecodeError, Message

from core.types import CameraInfo
from drivers.logs.codec import camera_from_message
from osape_client.clock import clock_ns
from osape_client.curve_keys import use_client_keys
from osape_client.ipv6 import allow_ipv6
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.receive_time import TimedSocket, age_ns
from osape_client.run_folder import run_folder
from osape_client.subscriber import TIMEOUT_S

from ..config.service import PublishConfig
from .live_team import LiveTeam
from .live_world import LiveWorld

NS = 1_000_000_000
POLL_S = 0.05
PICTURE_NS = NS
"""Largest age of a displayed depth image."""
PAIR_NS = round(TIMEOUT_S * NS)
"""A frame is shown with its depth image unless the newest frame is newer by this."""
PLAIN_NS = NS // 5
"""Interval of frames without depth images."""
WATCHED_S = 2.0
"""Time for which depth images stay subscribed after a page's last request."""
HEALTH_OLD_NS = 3 * NS
"""Health reports arrive once per second; after this time without one the service counts as silent."""
RECENT = 64
NICE = 10
"""Priority of a viewer's process: the service has precedence."""
TRACKS_NS = round(TIMEOUT_S * NS)
"""The newest tracks are drawn with a frame that has none if both exposures differ by at most this."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The frame of a camera that a page draws."""

    number: int  # consecutive
    info: CameraInfo
    message: pb.PrismsFrame
    preview: pb.DepthPreview | None
    exposed_ns: int  # exposure by `clock_ns`
    # after this frame, or the newest ones where these have not arrived; None: they are too old
    tracks: pb.Tracks | None = None


@dataclass(slots=True)
class Camera:
    """The messages of one camera; times by `clock_ns`."""

    info: CameraInfo | None = None
    newest: pb.PrismsFrame | None = None
    exposed_ns: int = 0
    received_ns: int = 0
    recent: OrderedDict[int, tuple[pb.PrismsFrame, int]] = field(default_factory=OrderedDict)
    preview: pb.DepthPreview | None = None
    preview_exposed_ns: int = 0
    tracks: OrderedDict[int, pb.Tracks] = field(default_factory=OrderedDict)
    shown: Shown | None = None
    key: tuple[Any, ...] = ()
    shown_ns: int = 0

    def tracks_of(self, message: pb.PrismsFrame) -> pb.Tracks | None:
        """Returns the tracks after a frame, or the newest ones where these have not arrived; None: their exposure differs
        from that of the frame by more than TRACKS_NS."""
        newest = next(reversed(self.tracks.values()), None)
        tracks = self.tracks.get(message.sequence, newest)
        if tracks is None or abs(tracks.t_exposure_ns - message.t_exposure_ns) > TRACKS_NS:
            return None
        return tracks


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
        self.on_message: Callable[[Message, CameraInfo | None], None] | None = None
        self.begun_ns = clock_ns()
        self._watched_ns = self._depth_since_ns = 0
        self._stop = threading.Event()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._receivers: dict[zmq.Socket[bytes], tuple[TimedSocket, type[Message]]] = {}
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
            self._receivers[socket] = TimedSocket(socket, address), kind
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.RCVHWM, 20)
            if self.streams.keys is not None:
                use_client_keys(socket, self.streams.keys)
            if name == "depth":
                self._depth = socket
            else:
                socket.setsockopt(zmq.SUBSCRIBE, b"")
            allow_ipv6(socket, address)
            socket.connect(address)
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
                for receiver, kind in self._receivers.values():
                    self._take(receiver, kind, now_ns)
                for camera in self.cameras.values():
                    self._choose(camera, now_ns)

    def _subscribe_depth(self, now_ns: int) -> None:
        if self._depth is None or (now_ns < self._watched_ns) == (self._depth_since_ns > 0):
            return
        if self._depth_since_ns == 0:
            self._depth.setsockopt(zmq.SUBSCRIBE, b"")
            self._depth_since_ns = now_ns
        else:
            self._depth.setsockopt(zmq.UNSUBSCRIBE, b"")
            self._depth_since_ns = 0

    def _take(self, receiver: TimedSocket, kind: type[Message], now_ns: int) -> None:
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
            except DecodeError as error:
                self.undecodable = f"{len(data)} bytes that cannot be decoded as {kind.DESCRIPTOR.name} ({error})"
                continue
            if isinstance(message, pb.Health):
                self._health(message, arrival_ns)
            elif isinstance(message, pb.PrismsFrame):
                self._prisms(message, now_ns, arrival_ns)
            elif isinstance(message, pb.DepthPreview):
                camera = self.cameras.setdefault(message.camera, Camera())
                camera.preview = message
                camera.preview_exposed_ns = now_ns - age_ns(message.publication, message.t_exposure_ns, arrival_ns)
            elif isinstance(message, pb.Tracks):
                camera = self.cameras.setdefault(message.camera, Camera())
                camera.tracks[message.sequence] = message
                if len(camera.tracks) > RECENT:
                    camera.tracks.popitem(last=False)
            on_message = self.on_message
            if on_message is not None:
                known = self.cameras.get(getattr(message, "camera", ""))
                on_message(message, None if known is None else known.info)

    def _health(self, message: pb.Health, arrival_ns: int) -> None:
        self.health, self.health_ns = message, arrival_ns
        for camera_health in message.cameras:
            camera = self.cameras.setdefault(camera_health.camera, Camera())
            if camera_health.HasField("info"):
                try:
                    camera.info = camera_from_message(camera_health.info)
                except ValueError as error:
                    self.undecodable = f"an invalid description of camera {camera_health.camera} ({error})"

    def _prisms(self, message: pb.PrismsFrame, now_ns: int, arrival_ns: int) -> None:
        camera = self.cameras.setdefault(message.camera, Camera())
        camera.newest, camera.received_ns = message, now_ns
        camera.exposed_ns = now_ns - age_ns(message.publication, message.t_exposure_ns, arrival_ns)
        camera.recent[message.sequence] = message, camera.exposed_ns
        if len(camera.recent) > RECENT:
            camera.recent.popitem(last=False)

    def _choose(self, camera: Camera, now_ns: int) -> None:
        """Selects the frame to show: that of the newest depth image if it is recent, otherwise the newest. A change
        between blind and valid is shown at once."""
        m, p = camera.newest, camera.preview
        if m is None or camera.info is None:
            return
        if p is not None and now_ns - camera.preview_exposed_ns <= PICTURE_NS:
            paired, exposed_ns = camera.recent.get(p.sequence, (None, 0))
            same = paired is not None and (not paired.valid or paired.t_exposure_ns == p.t_exposure_ns)
            if paired is not None and same and paired.valid == m.valid and camera.exposed_ns - exposed_ns < PAIR_NS:
                self._show(camera, paired, p, exposed_ns, now_ns)
                return
        turned = camera.shown is None or camera.shown.message.valid != m.valid
        if turned or not m.valid or now_ns - camera.shown_ns >= PLAIN_NS:
            self._show(camera, m, None, camera.exposed_ns, now_ns)

    def _show(
        self, camera: Camera, message: pb.PrismsFrame, preview: pb.DepthPreview | None, exposed_ns: int, now_ns: int
    ) -> None:
        """Shows a frame unless it equals the shown one: a blind frame is repeated ten times per second."""
        picture = None if preview is None else (preview.sequence, preview.t_exposure_ns)
        key = (message.sequence, message.t_exposure_ns if message.valid else message.cause_text, picture, camera.info)
        if key == camera.key:
            return
        assert camera.info is not None
        self.number += 1
        camera.key, camera.shown_ns = key, now_ns
        tracks = camera.tracks_of(message)
        camera.shown = Shown(self.number, camera.info, message, preview, exposed_ns, tracks)
        self.changed.notify_all()

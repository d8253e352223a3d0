"""Publishes the prisms, the model of all cameras and the health report on their ZeroMQ streams."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path

import zmq

from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.status import CameraStatus
from ..config.endpoints import opened_streams
from ..config.loader import Config
from ..config.service import STREAMS
from ..pipeline.encode import blind_message, wire_bytes
from ..pipeline.multi_camera import AllCamerasModelBuilder, all_cameras_message
from ..pipeline.results import PrismsResult
from ..pipeline.tracking import TracksResult
from ..streams.curve_auth import ServerKeys
from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher, Stream
from .health import CameraView
from .staleness import StalenessMonitor

NS = 1_000_000_000


class StreamOutput:
    """The streams `prisms`, `surround` (with several cameras), `tracks` (where enabled) and `health`.

    The pipeline thread and the main thread publish. `state_lock` guards `staleness` and the newest results; a lock of this
    class guards the sockets."""

    def __init__(
        self, config: Config, stamps: PublicationStamps, staleness: StalenessMonitor, state_lock: threading.Lock
    ) -> None:
        self._config, self._stamps = config, stamps
        self._staleness, self._state_lock = staleness, state_lock
        self._all_cameras = AllCamerasModelBuilder(tuple(c.name for c in config.cameras))
        self._required = frozenset(c.name for c in config.cameras if c.required)
        self._sending = threading.RLock()
        self.publishers: dict[str, Publisher] = {}

    def open(self, run: Path, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys | None) -> None:
        """Binds the sockets of the configured addresses. run: folder that replaces `{run}`. Raises as Publisher does."""
        for name in opened_streams(self._config):
            if name in STREAMS:
                stream = Stream(name, self._config.publish.address(name, run))
                self.publishers[name] = Publisher(stream, context, keys)

    def close(self) -> None:
        """Closes the sockets. May be called twice."""
        for publisher in self.publishers.values():
            publisher.close()

    def add_result(self, result: PrismsResult) -> None:
        """Keeps the result for the model of all cameras. The caller holds `state_lock`."""
        self._all_cameras.result(result)

    def publish_prisms(self, result: PrismsResult, prisms: bytes) -> None:
        """Publishes one frame. prisms: the result as an encoded PrismsFrame."""
        self._send("prisms", pb.PrismsFrame, prisms, result.t_exposure_ns)

    def publish_tracks(self, result: TracksResult, data: bytes) -> None:
        """Publishes the tracked obstacles after a frame. data: the encoded Tracks."""
        self._send("tracks", pb.Tracks, data, result.t_exposure_ns)

    def publish_blind(self, view: CameraView, now_ns: int) -> None:
        """Publishes an invalid frame for a blind camera, with the number and exposure of its newest frame, valid or not.
        Before the first frame the exposure is now_ns."""
        camera = view.status.camera
        with self._state_lock:
            sequence, newest_ns = self._staleness.sequence(camera), self._staleness.newest_ns(camera)
        t_ns = now_ns if newest_ns is None else newest_ns
        message = blind_message(camera, sequence, t_ns, view.blind)
        self._send("prisms", pb.PrismsFrame, wire_bytes(message), t_ns)

    def publish_all_cameras(self, now_ns: int, statuses: Mapping[str, CameraStatus]) -> None:
        """Publishes the model of all cameras, where there are several. statuses: by camera."""
        if "surround" not in self.publishers:
            return
        with self._sending:  # models are sent in the order in which they were made
            with self._state_lock:
                oldest_ns = now_ns - round(self._config.service.timeout_s * NS)
                model = self._all_cameras.model(
                    lambda name: self._staleness.cause(name, now_ns, statuses[name]), oldest_ns
                )
            message = all_cameras_message(model, self._required)
            self._send("surround", pb.SurroundFrame, wire_bytes(message), model.t_ns or now_ns)

    def publish_health(self, report: pb.Health) -> None:
        """Publishes a health report."""
        if "health" in self.publishers:
            self.publishers["health"].publish(report)

    @property
    def health_number(self) -> int:
        """Number of the next health report; 0 where the stream is not configured."""
        return self.publishers["health"].published if "health" in self.publishers else 0

    def _send(
        self, stream: str, kind: type[pb.PrismsFrame | pb.SurroundFrame | pb.Tracks], data: bytes, t_exposure_ns: int
    ) -> None:
        """Sends an encoded message with its `publication` field appended; two encoded parts decode as one message."""
        publisher = self.publishers.get(stream)
        if publisher is None:
            return
        with self._sending:  # a socket must not be used by two threads at once
            rest = kind()
            age_ns = time.monotonic_ns() - t_exposure_ns
            rest.publication.CopyFrom(self._stamps.stamp(publisher.published, age_ns))
            publisher.publish(data + wire_bytes(rest))

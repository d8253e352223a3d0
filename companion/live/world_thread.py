"""The thread that merges the frames into one world and publishes it: changes, periodic snapshots, and snapshots on
request.

A subscriber of the changes that keeps up misses none; a request on the second socket is answered with a snapshot. The
pipeline never waits for this thread: when its queue is full, the oldest frames are dropped and counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import zmq

from core.world.params import WorldParams
from core.world.world import Observation, World
from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.world.decode import SCHEMA_VERSION

from ..config.loader import Config
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.results import PrismsResult
from ..streams.curve_auth import ServerKeys
from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher, Stream
from ..streams.world_messages import snapshot_message, update_bytes, world_message
from .published_blocks import PublishedBlocks

NS = 1_000_000_000
CHANGES_NS = NS // 5
"""Interval of the changes."""
SNAPSHOT_NS = 10 * NS
"""Longest interval of the snapshots in the stream."""
_WAITING = 8
"""Largest number of waiting frames."""
_POLL_MS = 20
_SEQUENCE_STEP_NS = NS // 1000
"""Shorter than the time between two messages, and between two sections."""
_SECTIONS = 1 << 31
"""Numbers of sections, of 32 bits, of which half are left to count on."""
NO_POSITION_NS = NS // 2
"""Longest time without a valid frame in ned after which the world is invalid: nothing newer is known."""


class WorldThread:
    """`put` takes results from any thread. changes, requests: open PUB and REP sockets, owned by this object."""

    def __init__(
        self,
        params: WorldParams,
        changes: Publisher,
        requests: Publisher,
        stamps: PublicationStamps,
        observer: Callable[[World, int], None] | None = None,
    ) -> None:
        """observer: called in each cycle of the thread with the world and the time; it must not change the world."""
        # not the numbers of an earlier service, in whose coordinates a planner may still hold its path
        self.world = World(params, first_section=1 + time.monotonic_ns() // _SEQUENCE_STEP_NS % _SECTIONS)
        self._observer = observer
        self._changes, self._requests, self._stamps = changes, requests, stamps
        self._waiting: deque[PrismsResult] = deque()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = WatchedThread(self._run, "world")
        self.dropped = self.refused = 0
        self.alive_ns = time.monotonic_ns()
        # greater than those of an earlier service since the start of the computer: a copy would ignore lower ones
        self._sequence = time.monotonic_ns() // _SEQUENCE_STEP_NS
        self._since, self._section = 0, -1
        self._blocks = PublishedBlocks()
        self._epoch = -1
        self._next_ns = self._snapshot_ns = 0
        self._newest_ns: int | None = None

    def open(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def put(self, result: PrismsResult) -> None:
        """Queues the result of a frame. Never blocks."""
        with self._lock:
            if len(self._waiting) == _WAITING:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append(result)

    def diagnostics(self, now_ns: int, liveness_timeout_s: float) -> list[Diagnostic]:
        """The diagnostics of this thread."""
        if self._thread.failure:
            text = f"the merged world has ended ({self._thread.failure}): planners must not use it; restart the service"
            return [Diagnostic(DiagnosticCode.WORLD_FAULT, "", text)]
        if now_ns - self.alive_ns > liveness_timeout_s * NS:
            text = "the merged world is not updated: planners must not use it"
            return [Diagnostic(DiagnosticCode.WORLD_STALLED, "", text)]
        return []

    def close(self) -> None:
        """Ends the thread and closes its sockets. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)
        else:
            self._close_sockets()

    def _close_sockets(self) -> None:
        self._changes.close()
        self._requests.close()

    def _run(self) -> None:
        try:
            self._loop()
        finally:
            self._close_sockets()  # closed by the thread that uses them

    def _loop(self) -> None:
        while not self._stop.is_set():
            asked = bool(self._requests.socket.poll(_POLL_MS))
            self._take()
            now_ns = time.monotonic_ns()
            if asked and self._receive_request():
                picture = self.world.picture(now_ns)
                self._blocks.add(picture)
                self._requests.publish(update_bytes(self._completed(snapshot_message(picture, now_ns), now_ns)))
            if now_ns >= self._next_ns:
                self._next_ns = now_ns + CHANGES_NS
                self._publish_changes(now_ns)
            if self._observer is not None:
                self._observer(self.world, now_ns)
            self.alive_ns = now_ns

    def _receive_request(self) -> bool:
        """Receives a request, whose content is not used. False: there is none, since the socket has discarded a message of
        another form."""
        try:
            self._requests.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return False
        return True

    def _take(self) -> None:
        """Merges the waiting frames."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
        for result in waiting:
            try:
                observation = observation_of(result)
            except ValueError:
                self.refused += 1
                continue
            if observation is not None:
                self.world.add(observation)
                # the newest frame that is in the world: one that is invalid or left out does not make it recent
                if result.valid and self.world.section is not None:
                    self._newest_ns = self.world.section.newest_ns

    def _publish_changes(self, now_ns: int) -> None:
        """Publishes the next message of the stream."""
        section = 0 if self.world.section is None else self.world.section.number
        epoch = self.world.epoch(now_ns)
        self._sequence += 1
        if section != self._section or epoch != self._epoch or now_ns >= self._snapshot_ns:
            picture = self.world.picture(now_ns)
            self._blocks.snapshot(picture, self.world)
            message = snapshot_message(picture, now_ns)
            self._snapshot_ns = now_ns + SNAPSHOT_NS
        else:
            picture, removed = self.world.changes(now_ns, self._since)
            message = world_message(self._blocks.changes(picture, self.world), removed, now_ns)
        self._section, self._epoch, self._since = section, epoch, self.world.frame
        self._changes.publish(update_bytes(self._completed(message, now_ns)))

    def _completed(self, message: pb.WorldUpdate, now_ns: int) -> pb.WorldUpdate:
        """Fills the fields that every message has."""
        message.schema_version, message.sequence = SCHEMA_VERSION, self._sequence
        age_ns = None if self._newest_ns is None else now_ns - self._newest_ns
        message.valid = age_ns is not None and age_ns <= NO_POSITION_NS
        if age_ns is None:
            message.cause, message.cause_text = pb.WorldUpdate.CAUSE_NO_POSITION, "no valid frame with a position yet"
        elif not message.valid:
            message.cause = pb.WorldUpdate.CAUSE_POSITION_STALE
            message.cause_text = f"no valid frame with a position for {age_ns / NS:.1f} s"
        message.t_ns = self._newest_ns or 0
        for name, count in (
            self.world.numbers() | {"frames_dropped": self.dropped, "frames_refused": self.refused}
        ).items():
            message.counts[name] = count
        message.publication.CopyFrom(self._stamps.stamp(self._changes.published, age_ns or 0))
        return message


def open_world(
    config: Config,
    run: Path,
    context: zmq.Context[zmq.Socket[bytes]],
    keys: ServerKeys | None,
    stamps: PublicationStamps,
    observer: Callable[[World, int], None] | None = None,
) -> WorldThread:
    """The merged world with its thread started. Raises as Publisher does."""
    publish = config.publish
    streams = [Stream(name, publish.address(name, run)) for name in ("world", "world_requests")]
    with ExitStack() as opened:
        changes = opened.enter_context(closing(Publisher(streams[0], context, keys, newest_only=False)))
        requests = opened.enter_context(closing(Publisher(streams[1], context, keys, zmq.REP, newest_only=False)))
        service = WorldThread(config.world, changes, requests, stamps, observer)
        service.open()
        opened.pop_all()  # they belong to the thread now
    return service


def observation_of(result: PrismsResult) -> Observation | None:
    """The observation of a frame for the world, which counts invalid ones; None for a dropped frame or one without a
    position. Raises ValueError for an unusable position."""
    if result.frame != "ned" or result.model is None or result.pose is None or result.transform is None:
        return None
    return Observation(
        model=result.model,
        place_m=result.transform.translation_m,
        t_ns=result.t_exposure_ns,
        reset_counter=result.pose.reset_counter,
        estimate=(result.pose.section.number, 0 if result.attitude is None else result.attitude.jump_ns),
    )

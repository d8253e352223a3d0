"""The pipeline thread: takes items from the event queue, runs the pipeline, publishes the results, and records both."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import cast

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import prisms_bytes, wire_bytes
from ..pipeline.events import Item, LogMessage, RawMavlink, SupersededFrame
from ..pipeline.latency import Latencies, LatencyStage
from ..pipeline.pipeline import Pipeline
from ..pipeline.results import FrameDecision, Output, PrismsResult
from ..pipeline.track_messages import tracks_message
from ..pipeline.tracking import TracksResult
from ..self_check.exposure_offset import ExposureOffset
from ..self_check.mount_yaw import MountYaw
from .event_queue import EventQueue
from .health import latency_message
from .log_feed import LogFeed
from .motion_checks import MotionChecks
from .staleness import StalenessMonitor

TAKE_S = 0.1
"""Longest wait for an item, and with it the longest interval between two updates of `alive_ns`."""
COLLECT_AT, COLLECT_OLDER_AT = 350, 10
"""Number of new objects, and of young collections, at which the garbage collector runs between two frames. By default
it runs at 700 and 10, mostly during a frame, which then takes 0.4 ms longer."""
Motion = AttitudeSample | PoseSample


@dataclass(frozen=True, slots=True, kw_only=True)
class Receivers:
    """Receivers of what the thread makes, called by it."""

    result: Callable[[PrismsResult, bytes], None]  # gets each result and its encoded message
    # gets the tracked obstacles, after the frame's results
    tracks: Callable[[TracksResult, bytes], None] = lambda result, data: None
    frame: Callable[[DepthFrame], None] = lambda frame: None  # gets each depth frame after its results


class PipelineThread:
    """Runs until closed. `lock` guards the attributes that other threads read.

    Attributes:
        started: set when the kernels are loaded and the loop runs."""

    def __init__(
        self,
        pipeline: Pipeline,
        event_queue: EventQueue,
        staleness: StalenessMonitor,
        receivers: Receivers,
        log: LogFeed,
        checks: MotionChecks,
        warm_up: Callable[[], None],
    ) -> None:
        """warm_up: loads the kernels; called at the beginning."""
        self._pipeline, self._event_queue, self._staleness = pipeline, event_queue, staleness
        self._receivers, self._log, self._checks, self._warm_up = receivers, log, checks, warm_up
        self._stop = threading.Event()
        self._thread = WatchedThread(self._run, "pipeline")
        self.lock = threading.Lock()
        self.latencies = Latencies()
        self.used: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.newest_attitude_ns: int | None = None
        self.exposure_offsets: tuple[ExposureOffset, ...] = ()
        self.mount_yaws: tuple[MountYaw, ...] = ()
        self.alive_ns = time.monotonic_ns()
        self.started = threading.Event()
        self._idle = threading.Event()
        self._idle.set()

    def open(self) -> None:
        """Starts the thread."""
        self._thread.start()

    @property
    def failure(self) -> str:
        """The exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    def wait_idle(self, longest_s: float) -> bool:
        """Waits up to `longest_s` until no frame is being processed; returns whether that is the case."""
        return self._idle.wait(longest_s)

    def fill(self, report: pb.Health) -> None:
        """Fills latencies and frame counts of a health report."""
        with self.lock:
            report.latencies.extend(latency_message(*percentiles) for percentiles in self.latencies.percentiles())
            report.frames_used = sum(self.used.values())
            for cause, count in self.dropped.items():
                report.frames_dropped[cause] = count

    def stop(self) -> None:
        """Makes the loop end, without waiting."""
        self._stop.set()

    def close(self) -> None:
        """Ends the loop. May be called twice. A frame whose processing hangs is recorded."""
        self.stop()
        if self._thread.ident is not None:
            # loading of kernels cannot be interrupted, and no frame is being processed
            self._thread.join(5.0 if self.started.is_set() else 0.5)
            self._log.flush()

    def _run(self) -> None:
        self._warm_up()
        if self._stop.is_set():
            return
        self.alive_ns = time.monotonic_ns()  # loading the kernels may have taken minutes
        self.started.set()
        while not self._stop.is_set():
            taken = self._event_queue.take(TAKE_S)
            self._idle.clear()
            with self._log.deferred():
                try:
                    self._handle_all(taken)
                finally:  # also records a frame that the pipeline could not process
                    self._log.flush()
            collect_garbage()
            self._idle.set()
            self.alive_ns = time.monotonic_ns()

    def _handle_all(self, taken: list[Item]) -> None:
        # cameras first: a log that begins during this batch describes all of them
        for item in taken:
            if isinstance(item, CameraInfo):
                self._pipeline.announce(item)
                self._checks.announce(item)
        for kind, alike in groupby(taken, _kind):
            if kind is RawMavlink:
                self._record_mavlink(cast(list[RawMavlink], list(alike)))
            elif kind is AttitudeSample:
                self._handle_motion(cast(list[Motion], list(alike)))
            else:
                for item in alike:
                    self._handle(item)

    def _handle(self, item: Item) -> None:
        if isinstance(item, DepthFrame):
            self._handle_frame(item)
        elif isinstance(item, SupersededFrame):
            self._log.open_file(item)
            self._publish_output(self._pipeline.superseded(item))
        elif isinstance(item, LogMessage):
            self._log.open_file(item)
            self._log.message(item)

    def _record_mavlink(self, messages: list[RawMavlink]) -> None:
        self._log.open_file(messages[0])
        self._log.mavlink(messages)

    def _handle_motion(self, samples: list[Motion]) -> None:
        """Handles attitudes and positions."""
        self._log.open_file(samples[0])
        self._log.clock(samples[0].t_arrival_ns)
        self._log.motion(samples)
        for sample in samples:
            self._pipeline.handle(sample)
            self._checks.event(sample)
        with self.lock:
            self.newest_attitude_ns = self._pipeline.newest_attitude_ns

    def _handle_frame(self, frame: DepthFrame) -> None:
        """Handles a frame. Its results are published before anything else is done with it."""
        self._log.open_file(frame)
        self._log.clock(frame.t_arrival_ns)
        self._log.event(frame)
        begun_ns, begun_cpu_ns = time.monotonic_ns(), time.thread_time_ns()
        outputs = self._pipeline.handle(frame)
        done_ns, cpu_ns = time.monotonic_ns(), time.thread_time_ns() - begun_cpu_ns
        for output in outputs:
            self._publish_output(output)
        self._add_latencies(frame, begun_ns, done_ns, cpu_ns)
        self._receivers.frame(frame)
        for output in outputs:
            self._track(output)
        self._checks.event(frame)
        with self.lock:
            self.exposure_offsets, self.mount_yaws = self._checks.offsets(), self._checks.yaws()

    def _publish_output(self, output: Output) -> None:
        prisms: bytes | None = None
        if isinstance(output, PrismsResult):
            with self.lock:
                self._staleness.result(output)
            prisms = prisms_bytes(output)
            self._receivers.result(output, prisms)
        else:
            self._count(output)
        self._log.output(output, prisms)

    def _track(self, output: Output) -> None:
        """Updates, publishes and records the tracked obstacles, where they are enabled."""
        tracks = self._pipeline.track(output)
        if tracks is None:
            return
        data = wire_bytes(tracks_message(tracks))
        self._receivers.tracks(tracks, data)
        self._log.tracks(tracks, data)

    def _count(self, decision: FrameDecision) -> None:
        with self.lock:
            if decision.used:
                self.used[decision.camera] += 1
            else:
                self.dropped[decision.cause.value] += 1

    def _add_latencies(self, frame: DepthFrame, begun_ns: int, done_ns: int, cpu_ns: int) -> None:
        published_ns = time.monotonic_ns()
        with self.lock:
            add = self.latencies.add
            add(LatencyStage.CAMERA, frame.t_arrival_ns - frame.t_exposure_ns)
            add(LatencyStage.WAIT, begun_ns - frame.t_arrival_ns)
            add(LatencyStage.EXTRACT, done_ns - begun_ns)
            add(LatencyStage.EXTRACT_CPU, cpu_ns)
            add(LatencyStage.PUBLISH, published_ns - done_ns)
            add(LatencyStage.EXPOSURE_TO_PUBLISH, published_ns - frame.t_exposure_ns)


def collect_garbage() -> None:
    """Runs the garbage collector shortly before the interpreter would; older generations in their turn."""
    new, rounds, older_rounds = gc.get_count()
    if new > COLLECT_AT:
        gc.collect(0 if rounds <= COLLECT_OLDER_AT else 1 if older_rounds <= COLLECT_OLDER_AT else 2)


def _kind(item: Item) -> type:
    """Successive items of one kind are handled together; attitudes and positions count as one kind."""
    kind = type(item)
    return AttitudeSample if kind is PoseSample else kind

"""The pipeline thread: takes items from the event queue, runs the pipeline, publishes and records the results.

Calls of the recorder are collected while a frame is processed and made after its prisms are published, in the original
order, so that recording does not delay publication."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import groupby
from typing import cast

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import Event
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb

from ..log.recorder import Recorder
from ..pipeline.encode import prisms_bytes, state_message, wire_bytes
from ..pipeline.events import Item, LogMessage, RawFrame, Sample, SupersededFrame
from ..pipeline.latency import Latencies, LatencyStage
from ..pipeline.pipeline import Pipeline
from ..pipeline.results import FrameDecision, Output, PrismsResult
from ..pipeline.track_messages import tracks_message
from ..pipeline.tracking import TracksResult
from ..self_check.exposure_monitor import ExposureOffsetMonitor
from ..self_check.exposure_offset import ExposureOffset
from ..self_check.mount_yaw import MountYaw, MountYawMonitor
from .event_queue import EventQueue
from .health import clock_message, latency_message
from .staleness import StalenessMonitor

TAKE_S = 0.1
"""Longest wait for an item, and with it the longest interval between two updates of `alive_ns`."""
COLLECT_AT, COLLECT_OLDER_AT = 350, 10
"""Number of new objects, and of young collections, at which the garbage collector runs between two frames. By default
it runs at 700 and 10, mostly during a frame, which then takes 0.4 ms longer."""
Motion = AttitudeSample | PoseSample


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockCallbacks:
    """Callbacks of the recording: the estimate of the autopilot's clock with its restarts, whether the vehicle is
    armed; None: not known."""

    clock: Callable[[], tuple[ClockEstimate, int]]
    armed: Callable[[], bool | None]


class PipelineThread:
    """Runs until closed. publish: called with each result and its encoded message; show: with each depth frame after
    its results; both from this thread. `lock` guards the attributes that other threads read."""

    def __init__(
        self,
        pipeline: Pipeline,
        event_queue: EventQueue,
        staleness: StalenessMonitor,
        publish: Callable[[PrismsResult, bytes], None],
        recorder: Recorder | None,
        record: str,
        clock_callbacks: ClockCallbacks,
        warm_up: Callable[[], None],
        show: Callable[[DepthFrame], None] = lambda frame: None,
        offset_monitor: ExposureOffsetMonitor | None = None,
        yaw_monitor: MountYawMonitor | None = None,
        publish_tracks: Callable[[TracksResult, bytes], None] = lambda result, data: None,
    ) -> None:
        """offset_monitor, yaw_monitor: measure the cameras' exposure time offsets and mount yaws; they do not change
        results. publish_tracks: called with the tracked obstacles, after the frame's results are published."""
        self._publish_tracks = publish_tracks
        self._yaw_monitor = yaw_monitor
        self._offset_monitor = offset_monitor
        self._pipeline, self._event_queue, self._staleness, self._publish = pipeline, event_queue, staleness, publish
        self._show = show
        self._recorder, self._record, self._clock_callbacks, self._warm_up = recorder, record, clock_callbacks, warm_up
        self._stop = threading.Event()
        self._thread = WatchedThread(self._run, "pipeline")
        self._recording = self._idle_file = False
        self._unrecorded: list[Callable[[Recorder], None]] = []
        self._described: tuple[CameraInfo, ...] = ()
        self._clock = ClockEstimate(ClockSource.NONE)
        self.lock = threading.Lock()
        self.latencies = Latencies()
        self.used: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.newest_attitude_ns: int | None = None
        self.exposure_offsets: tuple[ExposureOffset, ...] = ()
        self.mount_yaws: tuple[MountYaw, ...] = ()
        self.alive_ns = time.monotonic_ns()
        self.begun = threading.Event()
        self._idle = threading.Event()
        self._idle.set()

    def open(self) -> None:
        """Starts the thread. `started` is true when the kernels are loaded and the loop runs."""
        self._thread.start()

    @property
    def started(self) -> bool:
        """Whether the kernels are loaded and the loop runs. `begun` is the event to wait for."""
        return self.begun.is_set()

    @property
    def running(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    @property
    def failure(self) -> str:
        """The exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    def wait_idle(self, longest_s: float) -> bool:
        """Waits up to `longest_s` until no frame is being processed; returns whether that is the case."""
        return self._idle.wait(longest_s)

    def fill(
        self, report: pb.Health, latency_to_autopilot: Callable[[], tuple[LatencyStage, float, float, float] | None]
    ) -> None:
        """Fills latencies and frame counts of a health report. latency_to_autopilot: called with `lock` held."""
        with self.lock:
            latencies = self.latencies.percentiles()
            if (last := latency_to_autopilot()) is not None:
                latencies.append(last)
            report.latencies.extend(latency_message(*percentiles) for percentiles in latencies)
            report.frames_used = sum(self.used.values())
            for cause, count in self.dropped.items():
                report.frames_dropped[cause] = count

    def close(self) -> None:
        """Ends the loop. May be called twice. A frame whose processing hangs is recorded."""
        self._stop.set()
        if self._thread.ident is not None:
            # loading of kernels cannot be interrupted, and no frame is being processed
            self._thread.join(5.0 if self.started else 0.5)
            self._flush_records()

    def _run(self) -> None:
        self._warm_up()
        if self._stop.is_set():
            return
        self.alive_ns = time.monotonic_ns()  # loading the kernels may have taken minutes
        self.begun.set()
        while not self._stop.is_set():
            taken = self._event_queue.take(TAKE_S)
            self._idle.clear()
            with self._recorder.deferred() if self._recorder is not None else nullcontext():
                try:
                    self._handle_all(taken)
                finally:  # also records a frame that the pipeline could not process
                    self._flush_records()
            collect_garbage()
            self._idle.set()
            self.alive_ns = time.monotonic_ns()

    def _handle_all(self, taken: list[Item]) -> None:
        # cameras first: a log that begins during this batch describes all of them
        for item in taken:
            if isinstance(item, CameraInfo):
                self._pipeline.announce(item)
                if self._offset_monitor is not None:
                    self._offset_monitor.announce(item)
                if self._yaw_monitor is not None:
                    self._yaw_monitor.announce(item)
        for kind, alike in groupby(taken, _kind):
            if kind is RawFrame:
                self._record_raw_frames(cast(list[RawFrame], list(alike)))
            elif kind is AttitudeSample:
                self._handle_motion(cast(list[Motion], list(alike)))
            else:
                for item in alike:
                    if not isinstance(item, CameraInfo):
                        self._handle(item)

    def _record_raw_frames(self, frames: list[RawFrame]) -> None:
        """Records MAVLink messages."""
        self._open_log(frames[0])
        self._record_later(lambda log: log.frames(frames))

    def _handle_motion(self, samples: list[Motion]) -> None:
        """Handles attitudes and positions."""
        self._open_log(samples[0])
        self._log_clock(samples[0].t_arrival_ns)
        self._record_later(lambda log: log.events(samples))
        for sample in samples:
            self._pipeline.handle(sample)
            if self._offset_monitor is not None:
                self._offset_monitor.event(sample)
            if self._yaw_monitor is not None:
                self._yaw_monitor.event(sample)
        with self.lock:
            self.newest_attitude_ns = self._pipeline.newest_attitude_ns

    def _handle(self, item: Sample) -> None:
        self._open_log(item)
        if isinstance(item, LogMessage):
            self._record_later(lambda log: log.message(item.key, item.message, item.t_arrival_ns))
            return
        if isinstance(item, SupersededFrame):
            decision = self._pipeline.superseded(item.camera, item.sequence, item.t_exposure_ns, item.t_arrival_ns)
            self._publish_output(decision)
            return
        if isinstance(item, RawFrame):
            self._record_raw_frames([item])
            return
        self._log_clock(item.t_arrival_ns)
        self._record_event(item)
        begun_ns, begun_cpu_ns = time.monotonic_ns(), time.thread_time_ns()
        outputs = self._pipeline.handle(item)
        done_ns, cpu_ns = time.monotonic_ns(), time.thread_time_ns() - begun_cpu_ns
        with self.lock:
            self.newest_attitude_ns = self._pipeline.newest_attitude_ns
        for output in outputs:
            self._publish_output(output)
        if isinstance(item, DepthFrame):
            self._add_latencies(item, begun_ns, done_ns, cpu_ns)
            self._show(item)
        for output in outputs:
            self._track(output)
        if isinstance(item, DepthFrame):
            self._measure_offset(item)

    def _measure_offset(self, frame: DepthFrame) -> None:
        """Runs the self-checks, after the frame's results are published."""
        if self._offset_monitor is not None:
            self._offset_monitor.event(frame)
            with self.lock:
                self.exposure_offsets = self._offset_monitor.offsets()
        if self._yaw_monitor is not None:
            self._yaw_monitor.event(frame)
            with self.lock:
                self.mount_yaws = self._yaw_monitor.yaws()

    def _publish_output(self, output: Output) -> None:
        prisms: bytes | None = None
        if isinstance(output, PrismsResult):
            with self.lock:
                self._staleness.result(output)
            prisms = prisms_bytes(output)
            self._publish(output, prisms)
        else:
            self._count(output)
        self._record_later(lambda log: log.output(output, prisms))

    def _track(self, output: Output) -> None:
        """Updates, publishes and records the tracked obstacles, where they are enabled."""
        tracks = self._pipeline.track(output)
        if tracks is None:
            return
        data = wire_bytes(tracks_message(tracks))
        self._publish_tracks(tracks, data)
        self._record_later(lambda log: log.tracks(tracks, data))

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

    # ---- recording ----------------------------------------------------------------------------------------------------

    def _record_event(self, event: Event) -> None:
        """Records a sample or a frame. Where depth images are left out, each recorded one has the state before it, so
        that a replay gives the same result."""
        recorder = self._recorder
        if isinstance(event, DepthFrame) and recorder is not None:
            if not recorder.keeps_depth(event.camera, event.t_exposure_ns):
                return
            if recorder.skips_depth:
                state = self._pipeline.camera_state(event.camera)
                self._record_later(lambda log: log.message("state", state_message(state), event.t_arrival_ns))
        self._record_later(lambda log: log.event(event))

    def _record_later(self, call: Callable[[Recorder], None]) -> None:
        """Adds a call of the recorder that is made after the prisms are published."""
        if self._recorder is not None:
            self._unrecorded.append(call)

    def _flush_records(self) -> None:
        """Makes these calls in their original order."""
        calls, self._unrecorded = self._unrecorded, []
        for call in calls:
            assert self._recorder is not None
            call(self._recorder)

    def _open_log(self, item: Sample) -> None:
        """Begins a log file where one is due: with the first frame, when the vehicle is armed, when the previous file
        is full or failed, when the vehicle is no longer disarmed as at the beginning of the file, and with the first frame
        after a camera was added or changed, since a log describes its cameras at its beginning."""
        if self._recorder is None:
            return
        armed = self._clock_callbacks.armed()
        wanted = self._record == "always" or (self._record == "armed" and armed is True)
        if not wanted:
            if self._recording:
                self._flush_records()
                self._recorder.end()
            self._recording = False
            return
        frame = isinstance(item, DepthFrame | SupersededFrame)
        due = self._recorder.wants_begin if self._recording else frame
        if frame and self._described != self._pipeline.cameras:
            due = True
        if self._recording and self._idle_file and armed is not False:
            due = True
        if due and self._recorder.may_begin:
            self._flush_records()  # earlier items belong to the previous file
            self._recorder.begin(item.t_arrival_ns, self._pipeline.cameras, self._pipeline.state(), armed is False)
            self._idle_file = armed is False
            self._clock = ClockEstimate(ClockSource.NONE)
            self._recording, self._described = True, self._pipeline.cameras

    def _log_clock(self, t_ns: int) -> None:
        """Records the estimate of the autopilot's clock after a change."""
        if self._recorder is None:
            return
        clock, restarts = self._clock_callbacks.clock()
        if clock is not self._clock and clock != self._clock:
            self._clock = clock
            self._record_later(lambda log: log.message("clock", clock_message(clock, restarts), t_ns))


def collect_garbage() -> None:
    """Runs the garbage collector shortly before the interpreter would; older generations in their turn."""
    new, rounds, older_rounds = gc.get_count()
    if new > COLLECT_AT:
        gc.collect(0 if rounds <= COLLECT_OLDER_AT else 1 if older_rounds <= COLLECT_OLDER_AT else 2)


def _kind(item: Item) -> type:
    """Successive items of one kind are handled together; attitudes and positions count as one kind."""
    kind = type(item)
    return AttitudeSample if kind is PoseSample else kind

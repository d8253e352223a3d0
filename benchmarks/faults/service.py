"""One run of the service in simulated time: link session, queue, pipeline, and the decisions for the autopilot.

Every part is that of the service; only threads, sockets and clocks are left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.autopilot.guard_loop import link_status_of
from companion.autopilot.autopilot_values import AutopilotValues
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.last_values import LastValuesFile
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import READS
from companion.autopilot.obstacle_report import CameraUse, ObstacleReport
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.sender import messages_of
from companion.autopilot.session_factory import params_of
from companion.autopilot.surroundings import Surroundings
from companion.cameras.frozen_frames import FrozenFrameDetector
from companion.cameras.masks import Mask, unmeasured_mask
from companion.config.avoidance import AvoidParams
from companion.config.loader import Config, config_of
from companion.guard.guard import READS as GUARD_READS
from companion.guard.guard import STEP_S, Guard
from companion.live.event_queue import EventQueue
from companion.pipeline.configured import make_pipeline
from companion.pipeline.events import SupersededFrame
from companion.pipeline.results import PrismsResult
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import Vehicle

from .path import PathClaim

NS = 1_000_000_000
MS = 1_000_000
PAUSE_NS, READ_NS = 42 * MS, 10 * MS
"""Time between two reads of the link while messages may wait, and while they may not (drivers.mavlink.link)."""
TICK_NS = NS // 10
GUARD_NS = round(STEP_S * NS)
WITH_GUARD = config_of(
    {"autopilot": {"address": "udpin:127.0.0.1:14540"}, "avoid": {"send": True}, "guard": {"enabled": True}}, "faults"
)


class Service:
    """One run, from its start to its end. `frame` gets the frames of the camera; `step` does what is due, and returns the bytes for
    the autopilot. guard: that of the service, None where the configuration has none; published: results of frames, from which the
    caller takes them."""

    reads = READS | GUARD_READS

    def __init__(
        self,
        cameras: Sequence[CameraInfo],
        avoid: AvoidParams,
        timeout_s: float | None = None,
        config: Config | None = None,
    ) -> None:
        """timeout_s: another one than that of the configuration; config: None: the defaults with the guard."""
        config = config or WITH_GUARD
        self.avoid, self.config = avoid, config
        self.session = MavlinkSession(params_of(config), on_message=self.message, reads=self.reads)
        self.values = AutopilotValues(LastValuesFile(None))
        self.report: ObstacleReport | None = None
        self.guard = self._guard() if config.guard.enabled else None
        self._now_ns, self._next_guard_ns = 0, 0
        self._heading_rad: float | None = None
        self.published: list[PrismsResult] = []
        params = config.extractor
        repeated = config.supervision.frozen_frames
        self._detectors = {c.camera: FrozenFrameDetector(repeated, params.min_measured_share) for c in cameras}
        self._frozen = {c.camera: "" for c in cameras}
        self._queue = EventQueue()
        self._pipeline = make_pipeline(config)
        seen = CameraUse(
            cameras=tuple(c.camera for c in cameras),
            timeout_s=config.service.timeout_s if timeout_s is None else timeout_s,
            params=params,
            frame_fault=lambda name: self._frozen[name],
            observer=self._observe,
            open_counts=config.open_sky.presumes,
            reach_m=config.guard.horizon_m,
        )
        self._builder = ObstacleReportBuilder(avoid, seen)
        for camera in cameras:
            self._pipeline.announce(camera)
            self._builder.announce(camera, self._hidden(camera))
        self.pipeline_ns = 0
        self._results: list[PrismsResult] = []
        self._busy_until_ns = 0
        self._unread: list[tuple[bytes, int]] = []
        self._next_read_ns = self._next_decision_ns = self._next_tick_ns = 0

    def opened(self, camera: CameraInfo) -> None:
        """A camera was opened again."""
        self._queue.put([camera])
        self._builder.announce(camera, self._hidden(camera))

    def _hidden(self, camera: CameraInfo) -> Mask | None:
        return unmeasured_mask(self.config.camera(camera.camera), camera, self.config.extractor.min_measured_share)

    def receive(self, data: bytes, now_ns: int) -> None:
        """Adds bytes of the line, which are read with the next `step` or frame."""
        self._unread.append((data, now_ns))

    def frame(self, frame: DepthFrame, now_ns: int) -> list[bytes]:
        """Handles a frame as the camera's supervisor does: attitudes that arrived are read before it. Returns bytes to send."""
        detector = self._detectors[frame.camera]
        self._frozen[frame.camera] = detector.check(frame)
        out: list[bytes] = []
        if not self._frozen[frame.camera] and not detector.repeats:
            out = self._read(now_ns)
            self._queue.put_frame(frame)
        return out

    def step(self, now_ns: int, *, pipeline: bool = True, sender: bool = True) -> list[bytes]:
        """Does what is due. pipeline, sender: these threads run."""
        out: list[bytes] = []
        self._now_ns = now_ns
        if now_ns >= self._next_read_ns:
            self._next_read_ns = now_ns + (PAUSE_NS if self.session.can_defer_read(now_ns) else READ_NS)
            out += self._read(now_ns)
        if pipeline:
            self._run_pipeline(now_ns)
        if now_ns >= self._next_tick_ns:
            self._next_tick_ns = now_ns + TICK_NS
            vehicle = self._vehicle(now_ns)
            if vehicle is not None:
                for request in self.values.due(vehicle, now_ns):
                    self.session.post(request, now_ns)
        if sender and now_ns >= self._next_decision_ns:
            self._next_decision_ns = now_ns + round(NS / self.avoid.rate_hz)
            self._decide(now_ns)
        if sender and self.guard is not None and now_ns >= self._next_guard_ns:
            self._next_guard_ns = now_ns + GUARD_NS
            self.guard.step(now_ns)
        if self.session.has_posted:
            out += self.session.due(now_ns)
        return out

    def _vehicle(self, now_ns: int) -> Vehicle | None:
        return self.session.vehicle if self.session.connected(now_ns) else None

    def _read(self, now_ns: int) -> list[bytes]:
        chunks, self._unread = [(data, now_ns) for data, _ in self._unread], []
        samples = self.session.receive(chunks)
        if chunks:
            self._deliver(samples)
        return self.session.due(now_ns)

    def _deliver(self, samples: Sequence[AttitudeSample | PoseSample]) -> None:
        self._queue.put(list(samples))
        self._builder.samples(list(samples))

    def message(self, message: Any, arrival_ns: int) -> None:
        """Takes a message of the autopilot, of those in `reads`."""
        self.values.take(message, arrival_ns)
        if self.guard is not None and message.get_msgId() in GUARD_READS:
            self.guard.message(message, arrival_ns)

    def result(self, result: PrismsResult) -> None:
        """Takes the result of a frame."""
        self._builder.result(result)
        self.published.append(result)

    def _run_pipeline(self, now_ns: int) -> None:
        """Handles what waits, up to a frame that takes time. Its result is given out at the end of this time."""
        while now_ns >= self._busy_until_ns:
            for result in self._results:
                self.result(result)
            self._results.clear()
            taken = self._queue.take(0.0)
            if not taken:
                return
            for item in taken:
                if isinstance(item, CameraInfo):
                    self._pipeline.announce(item)
            for item in taken:
                if isinstance(item, SupersededFrame):
                    self._pipeline.superseded(item)
                elif isinstance(item, DepthFrame | AttitudeSample | PoseSample):
                    outputs = self._pipeline.handle(item)
                    self._results += [output for output in outputs if isinstance(output, PrismsResult)]
            if self._results:
                self._busy_until_ns = now_ns + self.pipeline_ns

    # ---- guard ---------------------------------------------------------------------------------------------------------

    @property
    def claim(self) -> PathClaim | None:
        """What the guard takes for free along the path; None: it claims nothing."""
        verdict = None if self.guard is None else self.guard.verdict
        if verdict is None or verdict.course_rad is None or self._heading_rad is None:
            return None
        return PathClaim(verdict.course_rad - self._heading_rad, verdict.room_m)

    def _guard(self) -> Guard:
        def vehicle() -> Vehicle | None:
            return self._vehicle(self._now_ns)

        def post(message: Any) -> None:
            self.session.post(message, self._now_ns)

        line = AutopilotLine(vehicle, post, command=lambda message, _: post(message))
        return Guard(self.config.guard, self.avoid, line, lambda: link_status_of(vehicle()), None)

    def _observe(self, surroundings: Surroundings) -> None:
        """Gets the surroundings of each decision; the guard decides at once."""
        if self.guard is not None:
            self.guard.observe(surroundings)
            self._heading_rad = None if surroundings.here is None else surroundings.here.heading_rad
            self._next_guard_ns = self._now_ns

    # ---- obstacle output -----------------------------------------------------------------------------------------------

    def _decide(self, now_ns: int) -> None:
        vehicle = self._vehicle(now_ns)
        if vehicle is None and self.session.own.fell_silent(now_ns):
            vehicle = self.session.vehicle
        uncertain = self.session.status(now_ns).vehicle_uncertain
        autopilot = AutopilotNow() if vehicle is None else self.values.state(vehicle, now_ns, is_uncertain=uncertain)
        if not autopilot.kind:
            self._builder.catch_up()
            return
        self.report = self._builder.decide(autopilot, now_ns)
        for message in messages_of(self.report, autopilot.kind, self.avoid, now_ns):
            self.session.post(message, now_ns)

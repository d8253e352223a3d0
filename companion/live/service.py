"""The live service: starts and stops all parts, and publishes health and blind cameras.

Threads: one per camera (supervises its process), one for the autopilot's link, one for the pipeline, one for the log.
The main thread calls `tick`: blind cameras, health report and watchdog."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zmq
from google.protobuf.message import Message

from core.extractor import Extractor
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.session import MAV_STATE_CRITICAL
from osape_client.boot import boot_id
from osape_client.proto import osape_v1_pb2 as pb

from ..autopilot.session_factory import signing_of
from ..cameras.masks import configured_mask, unmeasured_mask
from ..cameras.supervisor import CameraStatus, CameraSupervisor
from ..config.differences import safety_lines
from ..config.loader import Config
from ..diagnostic import Diagnostic, DiagnosticCode
from ..log.recorder import RecordStatus
from ..paths import Folders
from ..pipeline.events import LogMessage, RawFrame
from ..pipeline.pipeline import Pipeline
from ..pipeline.results import PrismsResult
from ..pipeline.tracking import TracksResult
from ..self_check.exposure_monitor import ExposureOffsetMonitor
from ..self_check.mount_watch import MountWatch
from ..self_check.mount_yaw import MountYawMonitor
from ..streams.curve_auth import AllowList, load_keys
from .autopilot_parts import AutopilotParts, LinkCallbacks, make_autopilot
from .camera_views import camera_views
from .counts import FrameRates, RecentLosses
from .depth_preview import DepthPreviews
from .diagnostics import AttitudeRateCheck, GroundCheck, offset_warnings, template_intrinsics, yaw_warnings
from .event_queue import EventQueue
from .health import (
    HEARTBEAT_STATES,
    AutopilotView,
    CameraView,
    ProcessUsage,
    autopilot_message,
    camera_message,
    diagnostics_of,
    new_report,
    recording_message,
    state_of,
)
from .onboard_computer_status import ComputerStatus
from .part_checks import ended_optional_parts, failures, stalled_part
from .part_factory import make_metrics, make_recorder
from .pipeline_thread import ClockCallbacks, PipelineThread
from .staleness import StalenessMonitor
from .stream_output import StreamOutput

if TYPE_CHECKING:
    from ..share.setup import ShareService
    from .world_thread import WorldThread

NS = 1_000_000_000
HEALTH_NS = NS


class Service:
    """Call `open`, then `tick` repeatedly, then `close`. `open` raises DriverError, ValueError or OSError where a
    stream's address, a key or the log directory cannot be used."""

    def __init__(
        self,
        config: Config,
        folders: Folders,
        warm_up: Callable[[], None],
        start_text: Callable[[], str] = lambda: "loading kernels",
    ) -> None:
        """warm_up: loads the kernels, in the pipeline's thread; start_text: what it is doing."""
        self.config, self._folders, self._start_text = config, folders, start_text
        self._changed_safety_keys = safety_lines(config)
        self._template = template_intrinsics(config.cameras)
        self._attitude_rate, self._ground = AttitudeRateCheck(config.autopilot.attitude_hz), GroundCheck()
        self.diagnostics: list[Diagnostic] = []
        self._boot = boot_id()
        self.machine = ProcessUsage()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._allow: AllowList | None = None
        self.event_queue = EventQueue()
        names = tuple(c.name for c in config.cameras)
        self._staleness = StalenessMonitor(names, config.service.timeout_s)
        self.cameras = {c.name: self._supervisor(c.name) for c in config.cameras}
        self.world: WorldThread | None = None
        self._previews = DepthPreviews(config.publish.depth_hz, self._boot)
        self._raw_frames: list[RawFrame] = []
        self.share = self._make_share()
        self.signing = signing_of(config.autopilot, folders.state)
        parts = self._make_autopilot()
        self.session, self.link, self.avoidance, self.guard = parts.session, parts.link, parts.avoidance, parts.guard
        self._computer = ComputerStatus(folders.state) if config.autopilot.computer_status else None
        self.recorder = make_recorder(config, folders)
        self.metrics = make_metrics(config)
        self._pipeline = Pipeline(
            (),
            lambda info: Extractor(config.extractor, config.open_sky),
            config.sync,
            mask=lambda info: configured_mask(config.camera(info.camera), info),
            mount_check=config.mount_check,
            tracking=config.tracking,
        )
        clock_callbacks = ClockCallbacks(clock=self._clock, armed=self._armed)
        self.loop = PipelineThread(
            self._pipeline,
            self.event_queue,
            self._staleness,
            self._publish,
            self.recorder,
            config.record.record,
            clock_callbacks,
            warm_up,
            self._previews.show,
            ExposureOffsetMonitor(lambda info: configured_mask(config.camera(info.camera), info)),
            MountYawMonitor(lambda info: configured_mask(config.camera(info.camera), info)),
            self._publish_tracks,
        )
        self._output = StreamOutput(config, self._boot, self._staleness, self.loop.lock)
        self._mounts = MountWatch(config.extractor.ground_max_slope)
        self._rates, self._losses = FrameRates(), RecentLosses()
        self._next_health_ns = self._next_computer_ns = 0
        self.state: pb.Health.State = pb.Health.STATE_UNKNOWN

    def _supervisor(self, name: str) -> CameraSupervisor:
        def opened(info: CameraInfo) -> None:
            self.event_queue.put([info])
            with self.loop.lock:
                self._ground.started(name)
            if self.avoidance is not None:
                self.avoidance.announce(info, unmeasured_mask(self.config.camera(name), info))

        return CameraSupervisor(
            self.config.camera(name),
            opened,
            self._handle_frame,
            self.config.supervision,
            least_share=self.config.extractor.min_measured_share,
        )

    def _handle_frame(self, frame: DepthFrame) -> None:
        """Attitudes that arrived before the frame are queued before it."""
        if self.link is not None:
            self.link.catch_up()
        self.event_queue.put_frame(frame)

    def _make_autopilot(self) -> AutopilotParts:
        log_raw = self.config.record.mavlink and self.config.record.record != "off"
        frame = (lambda data, t_ns: self._raw_frames.append(RawFrame(data, t_ns))) if log_raw else None
        callbacks = LinkCallbacks(samples=self._deliver, message=self._handle_mavlink, frame=frame)
        return make_autopilot(self.config, self._folders, self.cameras, self.signing, self.share, callbacks)

    def _make_share(self) -> ShareService | None:
        """The exchange of obstacles with other vehicles, where it is enabled."""
        if not self.config.share.enabled:
            return None
        from ..share.setup import ShareService  # imported only where it is enabled

        def log(key: str, message: Message, t_ns: int) -> None:
            if self.recorder is not None:
                self.recorder.message(key, message, t_ns)  # not by the event queue, where it could displace frames

        return ShareService(self.config, self._folders, self._boot, log)

    def _deliver(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Queues the samples of one read, their raw frames first. Called from one thread at a time."""
        self.event_queue.put([*self._raw_frames, *samples])
        self._raw_frames.clear()
        if self.avoidance is not None:
            self.avoidance.samples(samples)
        if self.share is not None:
            self.share.samples(samples)

    def _handle_mavlink(self, message: Any, arrival_ns: int) -> None:
        if self.avoidance is not None:
            self.avoidance.message(message, arrival_ns)
        if self.guard is not None:
            self.guard.message(message, arrival_ns)
        if self.share is not None:
            self.share.message(message)

    def _clock(self) -> tuple[ClockEstimate, int]:
        if self.session is None:
            return ClockEstimate(ClockSource.NONE), 0
        return self.session.clock.estimate, self.session.clock.restarts

    def _armed(self) -> bool | None:
        return None if self.session is None else self.session.armed(time.monotonic_ns())

    def open(self) -> None:
        """Opens the streams and starts all threads. Cameras and autopilot may be missing; they are retried."""
        publish = self.config.publish
        keys = load_keys(Path(publish.keys)) if publish.keys else None
        if keys is not None:
            self._allow = AllowList(self._context, keys)
        if publish.world:
            from .world_thread import open_world  # imported only where the merged world is enabled

            observer = [] if self.share is None else [self.share.world]
            self.world = open_world(self.config, self._folders.run, self._context, keys, self._boot, *observer)
        if self.share is not None:
            self.share.connect(self.session, self.link)
            self.share.open(self._context, keys)
        self._output.open(self._folders.run, self._context, keys)
        self._previews.open(publish.depth.replace("{run}", str(self._folders.run)), self._context, keys)
        if self.recorder is not None:
            self.recorder.open()
        if self.metrics is not None:
            self.metrics.open()
        self.loop.open()
        if self.link is not None:
            self.link.open()
        if self.avoidance is not None:
            self.avoidance.open()
        if self.guard is not None:
            self.guard.open()
        for camera in self.cameras.values():
            camera.open()

    def close(self) -> None:
        """Stops everything and finishes the log. May be called twice. All parts are closed even if one raises; the
        exception is raised at the end.

        In flight the autopilot may depend on the obstacles: blindness is sent to it first, and its link is closed last.
        """
        with ExitStack() as last_first:  # the calls run in reverse order
            last_first.callback(self._context.destroy, linger=0)
            last_first.callback(self._close_allow_list)
            last_first.callback(self._output.close)
            last_first.callback(self._previews.close)
            for part in (self.world, self.metrics, self.signing, self.link, self.avoidance, self.share, self.recorder):
                if part is not None:
                    last_first.callback(part.close)
            last_first.callback(self.loop.close)
            for camera in reversed(self.cameras.values()):
                last_first.callback(camera.close)
            for camera in self.cameras.values():
                last_first.callback(camera.stop)
            if self.link is not None:
                last_first.callback(self.link.set_system_status, MAV_STATE_CRITICAL)
            if self.avoidance is not None:
                last_first.callback(self.avoidance.end)
            if self.guard is not None:  # before the blindness of a stop on purpose could stop the vehicle
                last_first.callback(self.guard.close)

    def _close_allow_list(self) -> None:
        if self._allow is not None:
            allow, self._allow = self._allow, None
            allow.close()

    @property
    def started(self) -> bool:
        """Whether the kernels are loaded and the pipeline runs."""
        return self.loop.started

    def failures(self) -> str:
        """The required threads that an exception has ended, as text; empty: none. The service then ends and systemd restarts
        it (docs/reference/service.md)."""
        return failures(self.loop, self.link, self.avoidance, self.guard, self.cameras)

    @property
    def diagnostic_texts(self) -> list[str]:
        """The texts of the diagnostics."""
        return [d.text for d in self.diagnostics]

    def stalled_part(self) -> str:
        """The first required thread that does not respond within `[service] hang_s`, as text; empty: none."""
        timeout_ns = round(self.config.service.hang_s * NS)
        now_ns = time.monotonic_ns()
        return stalled_part(self.loop, self.link, self.avoidance, self.guard, self.cameras, now_ns, timeout_ns)

    def tick(self) -> None:
        """Publishes blind frames for blind cameras, and the health report once per second and at each change of state."""
        now_ns = time.monotonic_ns()
        views = camera_views(self.cameras, self.loop, self._staleness, self._mounts, self._rates, now_ns)
        for view in views:
            if view.blind:
                self._output.publish_blind(view, now_ns)
        if any(view.blind for view in views):
            self._output.publish_all_cameras(now_ns, self._camera_statuses())
        autopilot = self._autopilot_view(now_ns)
        recording = self.recorder.status if self.recorder is not None else None
        if self.avoidance is not None:
            self.avoidance.tick(now_ns, autopilot.link if autopilot is not None else None)
        if self.share is not None:
            self.share.tick(now_ns)
        self.diagnostics = self._collect_diagnostics(views, autopilot, recording, now_ns)
        state = state_of(views, self.diagnostics, self.started)
        if state != self.state or now_ns >= self._next_health_ns:
            self.state, self._next_health_ns = state, now_ns + HEALTH_NS
            if self.link is not None:
                self.link.set_system_status(HEARTBEAT_STATES[state])
            self._publish_health(views, autopilot)

    def _collect_diagnostics(
        self, views: list[CameraView], autopilot: AutopilotView | None, recording: RecordStatus | None, now_ns: int
    ) -> list[Diagnostic]:
        """All diagnostics, the most severe first."""
        found = diagnostics_of(views, autopilot, recording, self.stalled_part())
        found += ended_optional_parts(self.metrics, self._previews, self.signing, self._allow)
        with self.loop.lock:
            found += self._mounts.diagnostics((view.status.camera, view.status.info) for view in views)
            ground = self._ground.check()
        if self.avoidance is not None:
            found += self.avoidance.diagnostics(now_ns)
        if self.guard is not None:
            found += self.guard.diagnostics()
        # samples lost while the kernels are compiled are not a fault: nothing is detected yet
        if self._losses.active(self.event_queue.lost, now_ns, is_fault=self.started):
            text = (
                f"{self._losses.count} attitude and position samples were lost: the pipeline is too slow; reduce "
                "the load of the computer or the frame rate"
            )
            found.append(Diagnostic(DiagnosticCode.AUTOPILOT_SAMPLES_LOST, "", text))
        if self.world is not None:
            found += self.world.diagnostics(now_ns, self.config.service.hang_s)
        if self.share is not None:
            found += self.share.diagnostics(now_ns)
        rate_hz = 0.0 if autopilot is None else autopilot.link.attitude_hz
        rate = self._attitude_rate.check(rate_hz, now_ns)
        with self.loop.lock:
            yaws = self.loop.mount_yaws
        found += [*self._template, *rate, *ground, *offset_warnings(self.config, views), *yaw_warnings(yaws)]
        if not self.started:
            return [Diagnostic(DiagnosticCode.STARTING, "", self._start_text())]
        return found

    def _autopilot_view(self, now_ns: int) -> AutopilotView | None:
        if self.link is None:
            return None
        newest_ns = self.loop.newest_attitude_ns
        age_ns = None if newest_ns is None else now_ns - newest_ns
        status = self.link.status()
        heartbeat_ns = status.vehicle.heartbeat_ns if status.vehicle is not None else 0
        return AutopilotView(
            address=self.config.autopilot.address,
            line=self.link.state,
            link=status,
            attitude_age_ns=age_ns,
            heartbeat_age_ns=now_ns - heartbeat_ns if heartbeat_ns else None,
        )

    def _publish(self, result: PrismsResult, prisms: bytes) -> None:
        self._output.publish_prisms(result, prisms)
        if self.avoidance is not None:
            self.avoidance.result(result)
        if self.world is not None:
            self.world.put(result)
        with self.loop.lock:
            self._mounts.result(result)
            self._output.add_result(result)
            self._ground.result(result)
        self._output.publish_all_cameras(time.monotonic_ns(), self._camera_statuses())

    def _publish_tracks(self, result: TracksResult, data: bytes) -> None:
        self._output.publish_tracks(result, data)
        if self.share is not None:
            self.share.tracks(result)

    def _camera_statuses(self) -> dict[str, CameraStatus]:
        return {name: camera.status for name, camera in self.cameras.items()}

    def _send_computer_status(self, report: pb.Health) -> None:
        if self._computer is not None and self.link is not None and report.t_ns >= self._next_computer_ns:
            self._next_computer_ns = report.t_ns + HEALTH_NS * 9 // 10  # a report is also made at each change of state
            self.link.post(self._computer.message(report))

    def _publish_health(self, views: list[CameraView], autopilot: AutopilotView | None) -> None:
        report = new_report(self._boot, self._output.health_number)
        report.state = self.state
        report.troubles.extend(self.diagnostic_texts)
        report.diagnostics.extend(d.message() for d in self.diagnostics)
        report.changed_safety_keys.extend(self._changed_safety_keys)
        report.cameras.extend(camera_message(v) for v in views)
        if autopilot is not None:
            report.autopilot.CopyFrom(autopilot_message(autopilot))
            if self.avoidance is not None:
                self.avoidance.fill(report.autopilot, report.t_ns)
        if self.recorder is not None:
            report.recording.CopyFrom(recording_message(self.recorder.status))
        self.loop.fill(report, self.avoidance.latency if self.avoidance is not None else lambda: None)
        if self.share is not None:
            self.share.fill(report)
        report.samples_lost = self.event_queue.lost
        self.machine.fill(report)
        self._send_computer_status(report)
        if self.metrics is not None:
            self.metrics.update(report)
        if self.recorder is not None:
            self.event_queue.put([LogMessage("health", report, report.t_ns)])
        self._output.publish_health(report)

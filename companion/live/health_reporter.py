"""Collects the diagnostics of all parts of the service, and publishes the health report."""

from __future__ import annotations

from pathlib import Path

from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.supervisor import CameraSupervisor
from ..config.differences import safety_lines
from ..config.loader import Config
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.events import LogMessage
from ..pipeline.results import PrismsResult
from ..self_check.exposure_offset import ExposureOffset
from ..self_check.mount_watch import MountWatch
from ..self_check.mount_yaw import MountYaw, add_yaw
from .counts import FrameRates, RecentLosses
from .diagnostics import (
    AttitudeRateCheck,
    CameraRateCheck,
    GroundCheck,
    diagnostics_of,
    misaligned,
    offset_warnings,
    template_intrinsics,
    yaw_warnings,
)
from .health import (
    HEARTBEAT_STATES,
    AutopilotView,
    CameraView,
    autopilot_message,
    camera_message,
    latency_message,
    new_report,
    recording_message,
    state_of,
)
from .onboard_computer_status import ComputerStatus
from .parts import Parts
from .process_usage import ProcessUsage
from .staleness import StalenessMonitor
from .stream_output import StreamOutput

NS = 1_000_000_000
HEALTH_NS = NS


class HealthReporter:
    """Reports once per second and at each change of state, to the stream, the log, the metrics and the autopilot.

    Used by the main thread. `camera_opened` and `result` are called by other threads, with the lock of the pipeline thread held.

    Attributes:
        diagnostics: those of the newest `update`.
        state: of the service."""

    def __init__(
        self, config: Config, parts: Parts, output: StreamOutput, staleness: StalenessMonitor, boot: str, state: Path
    ) -> None:
        """staleness: guarded by the lock of the pipeline thread. state: folder of the service's state, whose disk is reported."""
        self._config, self._parts, self._output, self._staleness, self._boot = config, parts, output, staleness, boot
        self._changed_safety_keys = safety_lines(config)
        self._template = template_intrinsics(config.cameras)
        self._attitude_rate, self._ground = AttitudeRateCheck(config.autopilot.attitude_hz), GroundCheck()
        self._camera_rates = CameraRateCheck(config.cameras)
        self._mounts = MountWatch(config.extractor.ground_max_slope)
        self._rates, self._losses, self._usage = FrameRates(), RecentLosses(), ProcessUsage()
        self._computer = ComputerStatus(state) if config.autopilot.computer_status else None
        self._next_ns = self._next_computer_ns = 0
        self.diagnostics: list[Diagnostic] = []
        self.state: pb.Health.State = pb.Health.STATE_UNKNOWN

    def camera_opened(self, name: str) -> None:
        """A camera was opened: its checks begin again."""
        self._ground.started(name)

    def result(self, result: PrismsResult) -> None:
        """Takes the result of a frame."""
        self._mounts.result(result)
        self._ground.result(result)

    def camera_views(self, now_ns: int) -> list[CameraView]:
        """The state of each camera."""
        thread = self._parts.pipeline_thread
        with thread.lock:
            offsets = {offset.camera: offset for offset in thread.exposure_offsets}
            yaws = {yaw.camera: yaw for yaw in thread.mount_yaws}
        return [
            self._camera_view(camera, offsets.get(name), yaws.get(name), now_ns)
            for name, camera in self._parts.cameras.items()
        ]

    def _camera_view(
        self, camera: CameraSupervisor, offset: ExposureOffset | None, yaw: MountYaw | None, now_ns: int
    ) -> CameraView:
        status = camera.status
        with self._parts.pipeline_thread.lock:
            blind = self._staleness.cause(status.camera, now_ns, status)
            age_ns = self._staleness.age_ns(status.camera, now_ns)
            mount = self._mounts.health(status.camera, status.info)
        if mount is not None and yaw is not None:
            add_yaw(mount, yaw)
        return CameraView(
            status=status,
            required=camera.section.required,
            blind=blind,
            age_ns=age_ns,
            hz=self._rates.hz(status.camera, status.frames, now_ns),
            last_loss_age_ns=None if status.last_loss_ns is None else max(0, now_ns - status.last_loss_ns),
            exposure_offset=offset,
            mount=mount,
        )

    def autopilot_view(self, now_ns: int) -> AutopilotView | None:
        """The state of the autopilot; None: not configured."""
        link = self._parts.link
        if link is None:
            return None
        newest_ns = self._parts.pipeline_thread.newest_attitude_ns
        status = link.status()
        heartbeat_ns = status.vehicle.heartbeat_ns if status.vehicle is not None else 0
        return AutopilotView(
            address=self._config.autopilot.address,
            link_state=link.state,
            status=status,
            attitude_age_ns=None if newest_ns is None else now_ns - newest_ns,
            heartbeat_age_ns=now_ns - heartbeat_ns if heartbeat_ns else None,
        )

    def update(
        self, views: list[CameraView], autopilot: AutopilotView | None, starting: str | None, now_ns: int
    ) -> None:
        """Collects the diagnostics, and publishes a report where one is due.

        starting: what the service is doing before it has started; None: it has started."""
        has_started = starting is None
        found = self._collect(views, autopilot, now_ns, has_started=has_started)
        self.diagnostics = found if starting is None else [Diagnostic(DiagnosticCode.STARTING, "", starting)]
        state = state_of(views, self.diagnostics, has_started)
        if state != self.state or now_ns >= self._next_ns:
            self.state, self._next_ns = state, now_ns + HEALTH_NS
            if self._parts.link is not None:
                self._parts.link.set_system_status(HEARTBEAT_STATES[state])
            self._publish(self._report(views, autopilot))

    def _collect(
        self, views: list[CameraView], autopilot: AutopilotView | None, now_ns: int, *, has_started: bool
    ) -> list[Diagnostic]:
        """All diagnostics, part by part; warnings are last."""
        parts, hang_s = self._parts, self._config.service.hang_s
        recording = parts.recorder.status if parts.recorder is not None else None
        thread_fault = parts.failures() or parts.stalled(now_ns, round(hang_s * NS))
        found = diagnostics_of(views, autopilot, recording, thread_fault)
        found += parts.ended_optional()
        with parts.pipeline_thread.lock:
            found += self._mounts.diagnostics((view.status.camera, view.status.info) for view in views)
            ground, yaws = self._ground.check(), parts.pipeline_thread.mount_yaws
        if parts.obstacle_output is not None:
            found += parts.obstacle_output.diagnostics(now_ns)
        if parts.guard is not None:
            found += parts.guard.diagnostics()
        # samples lost while the kernels are compiled are not a fault: nothing is detected yet
        if self._losses.active(parts.event_queue.lost, now_ns, is_fault=has_started):
            text = (
                f"{self._losses.count} attitude and position samples were lost: the pipeline is too slow; reduce "
                "the load of the computer or the frame rate"
            )
            found.append(Diagnostic(DiagnosticCode.AUTOPILOT_SAMPLES_LOST, "", text))
        if parts.world is not None:
            found += parts.world.diagnostics(now_ns, hang_s)
        if parts.share is not None:
            found += parts.share.diagnostics(now_ns)
        rate_hz = 0.0 if autopilot is None else autopilot.status.attitude_hz
        rates = self._camera_rates.check(views, now_ns) + self._attitude_rate.check(rate_hz, now_ns)
        found += [*self._template, *misaligned(views), *rates, *ground]
        return [*found, *offset_warnings(self._config, views), *yaw_warnings(yaws)]

    def _report(self, views: list[CameraView], autopilot: AutopilotView | None) -> pb.Health:
        """The health report, the answers of all parts in it."""
        parts = self._parts
        report = new_report(self._boot, self._output.health_number)
        report.state = self.state
        report.troubles.extend(d.text for d in self.diagnostics)
        report.diagnostics.extend(d.message() for d in self.diagnostics)
        report.changed_safety_keys.extend(self._changed_safety_keys)
        report.cameras.extend(camera_message(v) for v in views)
        if autopilot is not None:
            report.autopilot.CopyFrom(autopilot_message(autopilot))
            if parts.obstacle_output is not None:
                parts.obstacle_output.fill(report.autopilot, report.t_ns)
        if parts.recorder is not None:
            report.recording.CopyFrom(recording_message(parts.recorder.status))
        parts.pipeline_thread.fill(report)
        to_autopilot = parts.obstacle_output.latency() if parts.obstacle_output is not None else None
        if to_autopilot is not None:
            report.latencies.append(latency_message(*to_autopilot))
        if parts.share is not None:
            parts.share.fill(report)
        report.samples_lost = parts.event_queue.lost
        self._usage.fill(report)
        return report

    def _publish(self, report: pb.Health) -> None:
        parts = self._parts
        if self._computer is not None and parts.link is not None and report.t_ns >= self._next_computer_ns:
            self._next_computer_ns = report.t_ns + HEALTH_NS * 9 // 10  # a report is also made at each change of state
            parts.link.post(self._computer.message(report))
        if parts.metrics is not None:
            parts.metrics.update(report)
        if parts.recorder is not None:
            parts.event_queue.put([LogMessage("health", report, report.t_ns)])
        self._output.publish_health(report)

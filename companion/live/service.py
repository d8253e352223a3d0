"""The live service: cameras and autopilot in, prisms out, for hours, without anybody at a keyboard.

Threads: one a camera (watching its process), one for the autopilot's line, one for the pipeline, one for the log; the
main thread does the rest: what is said of blindness and health, and the sign of life for systemd."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import zmq

from core.extractor import Extractor
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MAV_STATE_ACTIVE, MAV_STATE_CRITICAL, MAV_STATE_STANDBY, MavlinkSession
from drivers.mavlink.transport import parse_address
from osape_client.boot import boot_id
from osape_client.proto import osape_v1_pb2 as pb

from ..autopilot.session_factory import params_of, signing_of
from ..cameras.masks import configured_mask, unmeasured_mask
from ..cameras.supervisor import CameraSupervisor
from ..config.differences import safety_lines
from ..config.loader import Config
from ..config.service import STREAMS
from ..diagnostic import Diagnostic, DiagnosticCode
from ..log.provenance import run_info
from ..log.recorder import Recorder, RecordStatus
from ..paths import Folders
from ..pipeline.encode import blind_message, wire_bytes
from ..pipeline.events import LogMessage, RawFrame
from ..pipeline.multi_camera import AllCamerasModelBuilder, all_cameras_message
from ..pipeline.pipeline import Pipeline, PrismsResult
from ..self_check.exposure_monitor import ExposureOffsetMonitor
from ..self_check.exposure_offset import ExposureOffset, warning_text
from ..self_check.mount_watch import MountWatch
from ..self_check.mount_yaw import MountYaw, MountYawMonitor, add_yaw
from ..streams.curve_auth import AllowList, load_keys
from ..streams.publisher import Publisher, Stream
from .counts import FrameRates, RecentLosses
from .depth_preview import DepthPreviews
from .diagnostics import AttitudeRateCheck, GroundCheck, template_intrinsics
from .event_queue import EventQueue
from .health import (
    AutopilotView,
    CameraView,
    ProcessUsage,
    autopilot_message,
    camera_message,
    diagnostics_of,
    latency_message,
    new_report,
    recording_message,
    state_of,
)
from .onboard_computer_status import ComputerStatus
from .pipeline_thread import ClockCallbacks, PipelineThread
from .staleness import StalenessMonitor

if TYPE_CHECKING:
    from ..autopilot.manager import Avoidance
    from .prometheus import MetricsServer
    from .world_thread import WorldThread

NS = 1_000_000_000
HEALTH_NS = NS
HEARTBEAT_STATES = {
    pb.Health.STATE_STARTING: MAV_STATE_STANDBY,
    pb.Health.STATE_ACTIVE: MAV_STATE_ACTIVE,
    pb.Health.STATE_DEGRADED: MAV_STATE_ACTIVE,
    pb.Health.STATE_BLIND: MAV_STATE_CRITICAL,
}


class Service:
    """`open`, then `tick` again and again, then `close`. Raises DriverError, ValueError and OSError from open where
    something it needs cannot be had: a stream's address, a key, the folder of the logs."""

    def __init__(self, config: Config, folders: Folders, warm_up: Callable[[], None]) -> None:
        self.config, self._folders = config, folders
        self._changed_safety_keys = safety_lines(config)
        self._template = template_intrinsics(config.cameras)
        self._attitude_rate, self._ground = AttitudeRateCheck(config.autopilot.attitude_hz), GroundCheck()
        self.diagnostics: list[Diagnostic] = []
        self._boot = boot_id()
        self.machine = ProcessUsage()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._allow: AllowList | None = None
        self._publishers: dict[str, Publisher] = {}
        self._sending = threading.RLock()
        self.event_queue = EventQueue()
        names = tuple(c.name for c in config.cameras)
        self._staleness = StalenessMonitor(names, config.service.stale_s)
        self._all_cameras = AllCamerasModelBuilder(names)
        self._required = frozenset(c.name for c in config.cameras if c.required)
        self.cameras = {c.name: self._supervisor(c.name) for c in config.cameras}
        self.avoidance: Avoidance | None = None
        self.world: WorldThread | None = None
        self._previews = DepthPreviews(config.publish.depth_hz, self._boot)
        self._raw_frames: list[RawFrame] = []
        self.signing = signing_of(config.autopilot, folders.state)
        self.session, self.link = self._autopilot()
        self._computer = ComputerStatus(folders.state) if config.autopilot.computer_status else None
        self.recorder = self._recorder()
        self.metrics = self._metrics()
        self._pipeline = Pipeline(
            (), lambda info: Extractor(config.extractor), config.sync,
            mask=lambda info: configured_mask(config.camera(info.camera), info), mount_check=config.mount_check,
        )  # fmt: skip
        clock_callbacks = ClockCallbacks(clock=self._clock, armed=self._armed)
        self.loop = PipelineThread(
            self._pipeline, self.event_queue, self._staleness, self._publish, self.recorder, config.record.record, clock_callbacks,
            warm_up, self._previews.show, ExposureOffsetMonitor(lambda info: configured_mask(config.camera(info.camera), info)),
            MountYawMonitor(lambda info: configured_mask(config.camera(info.camera), info)),
        )  # fmt: skip
        self._mounts = MountWatch(config.extractor.ground_max_slope)
        self._rates, self._losses = FrameRates(), RecentLosses()
        self._next_health_ns = self._next_computer_ns = 0
        self.state: pb.Health.State = pb.Health.STATE_UNKNOWN

    # ---- parts --------------------------------------------------------------------------------------------------------

    def _supervisor(self, name: str) -> CameraSupervisor:
        def opened(info: CameraInfo) -> None:
            self.event_queue.put([info])
            with self.loop.lock:
                self._ground.started(name)
            if self.avoidance is not None:
                self.avoidance.announce(info, unmeasured_mask(self.config.camera(name), info))

        return CameraSupervisor(self.config.camera(name), opened, self._handle_frame, self.config.supervision)

    def _handle_frame(self, frame: DepthFrame) -> None:
        """What the autopilot said before the frame came goes before it."""
        if self.link is not None:
            self.link.catch_up()
        self.event_queue.put_frame(frame)

    def _autopilot(self) -> tuple[MavlinkSession | None, MavlinkLink | None]:
        a = self.config.autopilot
        if not a.address:
            return None, None
        log_raw = self.config.record.mavlink and self.config.record.record != "off"
        keep = (lambda data, t_ns: self._raw_frames.append(RawFrame(data, t_ns))) if log_raw else None
        params, address = params_of(self.config), parse_address(a.address)
        if not self.config.avoid.send:
            session = MavlinkSession(params, on_frame=keep, signing=self.signing)
            return session, MavlinkLink(address, session, self._deliver)
        from ..autopilot.manager import READS, avoidance_of  # much to import: only where obstacles are told

        session = MavlinkSession(
            params, on_frame=keep, signing=self.signing, reads=READS, on_message=self._handle_mavlink
        )
        link = MavlinkLink(address, session, self._deliver)
        self.avoidance = avoidance_of(self.config, self.cameras, session, link, self._folders.state)
        return session, link

    def _deliver(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """What was read of the line together, its frames for the log first; from one thread at a time."""
        self.event_queue.put([*self._raw_frames, *samples])
        self._raw_frames.clear()
        if self.avoidance is not None:
            self.avoidance.samples(samples)

    def _handle_mavlink(self, message: Any, arrival_ns: int) -> None:
        if self.avoidance is not None:
            self.avoidance.message(message, arrival_ns)

    def _recorder(self) -> Recorder | None:
        if (record := self.config.record).record == "off":
            return None
        folder = Path(record.folder) if record.folder else self._folders.state / "logs"
        return Recorder(folder, run_info("live", self.config), record)

    def _metrics(self) -> MetricsServer | None:
        if (port := self.config.service.metrics_port) == 0:
            return None
        from .prometheus import MetricsServer  # a web server: only where it is asked for

        return MetricsServer(port)

    def _clock(self) -> tuple[ClockEstimate, int]:
        if self.session is None:
            return ClockEstimate(ClockSource.NONE), 0
        return self.session.clock.estimate, self.session.clock.restarts

    def _armed(self) -> bool:
        vehicle = self.session.vehicle if self.session is not None else None
        return vehicle is not None and vehicle.armed

    # ---- life ---------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Opens the streams and starts all threads; neither cameras nor autopilot have to be there."""
        publish = self.config.publish
        keys = load_keys(Path(publish.keys)) if publish.keys else None
        if keys is not None:
            self._allow = AllowList(self._context, keys)
        if publish.world:
            from .world_thread import open_world  # much to import: only where a world is asked for

            self.world = open_world(self.config, self._folders.run, self._context, keys, self._boot)
        for name in STREAMS:
            address = getattr(publish, name).replace("{run}", str(self._folders.run))
            if address and (name != "surround" or len(self.cameras) > 1):
                self._publishers[name] = Publisher(Stream(name, address), self._context, keys)
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
        for camera in self.cameras.values():
            camera.open()

    def close(self) -> None:
        """Stops everything and finishes the log. May be called twice. A part that raises keeps no other from being closed;
        the exception goes on when all are.

        In flight an autopilot may rely on us: it is told of blindness first, and its line is closed last."""
        with ExitStack() as last_first:  # the calls are made in the reverse of this order
            last_first.callback(self._context.destroy, linger=0)
            last_first.callback(self._close_allow_list)
            for publisher in reversed(self._publishers.values()):
                last_first.callback(publisher.close)
            last_first.callback(self._previews.close)
            for part in (self.world, self.metrics, self.signing, self.link, self.avoidance, self.recorder):
                if part is not None:
                    last_first.callback(part.close)
            last_first.callback(self.loop.close)
            for camera in reversed(self.cameras.values()):
                last_first.callback(camera.close)
            if self.link is not None:
                last_first.callback(self.link.set_system_status, MAV_STATE_CRITICAL)
            if self.avoidance is not None:
                last_first.callback(self.avoidance.end)

    def _close_allow_list(self) -> None:
        if self._allow is not None:
            allow, self._allow = self._allow, None
            allow.close()

    @property
    def started(self) -> bool:
        """Whether the loops run, kernels compiled."""
        return self.loop.started

    def failures(self) -> str:
        """Which thread that no flight can do without was ended by an exception, in words; empty: none. The service then
        ends, to be started again (docs/reference/service.md)."""
        parts = {"the pipeline": self.loop.failure}
        if self.link is not None:
            parts["the line to the autopilot"] = self.link.failure
        if self.avoidance is not None:
            parts["the sender of obstacles"] = self.avoidance.sender.failure
        parts |= {f"the supervision of camera {name}": camera.failure for name, camera in self.cameras.items()}
        return "; ".join(f"{part} has ended: {failure}" for part, failure in parts.items() if failure)

    @property
    def diagnostic_texts(self) -> list[str]:
        """The texts of the diagnostics."""
        return [d.text for d in self.diagnostics]

    def _ended_optional_parts(self) -> list[Diagnostic]:
        """What has ended that a flight can do without; recording and the merged world are reported elsewhere."""
        texts: dict[DiagnosticCode, str] = {}
        if self.metrics is not None:
            texts[DiagnosticCode.METRICS_FAULT] = self.metrics.fault
        texts[DiagnosticCode.DEPTH_PREVIEW_FAULT] = self._previews.fault
        if signing := self.signing.failure:
            texts[DiagnosticCode.SIGNATURE_CLOCK_FAULT] = f"timestamps of signatures are kept no more ({signing})"
        if self._allow and not self._allow.running:
            texts[DiagnosticCode.KEY_CHECK_FAULT] = "no new subscriber is let in: the check of keys has ended"
        return [Diagnostic(code, "", text) for code, text in texts.items() if text]

    def stalled_part(self) -> str:
        """Which loop has not gone round for hang_s, in words; empty: all live. A slow disk hangs only the log, which is
        told but is no reason to end the service in flight."""
        now_ns = time.monotonic_ns()
        limit_ns = self.config.service.hang_s * NS
        if not self.loop.running:
            return "the pipeline has ended and"
        if self.loop.started and now_ns - self.loop.alive_ns > limit_ns:
            return "the pipeline"
        if self.link is not None and now_ns - self.link.state.alive_ns > limit_ns + 2 * NS:  # opening may take 2 s
            return "the autopilot's line"
        if self.avoidance is not None and self.avoidance.hung(round(limit_ns)):
            return "the sender of obstacles"
        for name, camera in self.cameras.items():
            if camera.status.alive_ns and now_ns - camera.status.alive_ns > limit_ns + 2 * NS:
                return f"the supervision of camera {name}"
        return ""

    # ---- what is said ---------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Says of each blind camera that it is blind, and once a second, and at each change, how the service is."""
        now_ns = time.monotonic_ns()
        views = self._views(now_ns)
        for view in views:
            if view.blind:
                self._publish_blind(view, now_ns)
        if any(view.blind for view in views):
            self._publish_surround(now_ns)
        autopilot = self._autopilot_view(now_ns)
        recording = self.recorder.status if self.recorder is not None else None
        if self.avoidance is not None:
            self.avoidance.tick(now_ns, autopilot.link if autopilot is not None else None)
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
        """Everything that is wrong, the worst first."""
        found = diagnostics_of(views, autopilot, recording, self.stalled_part())
        found += self._ended_optional_parts()
        with self.loop.lock:
            found += self._mounts.diagnostics((view.status.camera, view.status.info) for view in views)
            ground = self._ground.check()
        if self.avoidance is not None:
            found += self.avoidance.diagnostics(now_ns)
        # what is lost while the kernels are compiled is no fault: nothing is detected yet
        if self._losses.active(self.event_queue.lost, now_ns, is_fault=self.started):
            text = f"{self.event_queue.lost} samples of the autopilot were lost: the pipeline does not keep up; is the machine overloaded?"
            found.append(Diagnostic(DiagnosticCode.AUTOPILOT_SAMPLES_LOST, "", text))
        if self.world is not None:
            found += self.world.diagnostics(now_ns, self.config.service.hang_s)
        rate_hz = 0.0 if autopilot is None else autopilot.link.attitude_hz
        rate = self._attitude_rate.check(rate_hz, now_ns)
        found += [*self._template, *rate, *ground, *self._offset_warnings(views), *self._yaw_warnings()]
        if not self.started:
            text = "starting: loading kernels, or compiling them on the first start"
            return [Diagnostic(DiagnosticCode.STARTING, "", text)]
        return found

    def _yaw_warnings(self) -> list[Diagnostic]:
        """Of cameras whose direction of motion does not fit the velocity."""
        with self.loop.lock:
            yaws = self.loop.mount_yaws
        return [Diagnostic(DiagnosticCode.MOUNT_YAW_ERROR, yaw.camera, yaw.warning) for yaw in yaws if yaw.warns]

    def _offset_warnings(self, views: list[CameraView]) -> list[Diagnostic]:
        """Of cameras whose exposure stamps do not fit the attitude."""
        offsets = [view.exposure_offset for view in views if view.exposure_offset is not None]
        texts = {o.camera: warning_text(o, self.config.camera(o.camera).exposure_offset_ms) for o in offsets}
        return [Diagnostic(DiagnosticCode.EXPOSURE_TIME_OFFSET, camera, text) for camera, text in texts.items() if text]

    def _views(self, now_ns: int) -> list[CameraView]:
        views = []
        with self.loop.lock:
            offsets: dict[str, ExposureOffset] = {offset.camera: offset for offset in self.loop.exposure_offsets}
            yaws: dict[str, MountYaw] = {yaw.camera: yaw for yaw in self.loop.mount_yaws}
        for name, camera in self.cameras.items():
            status = camera.status
            with self.loop.lock:
                blind = self._staleness.cause(name, now_ns, status)
                age_ns = self._staleness.age_ns(name, now_ns)
                mount = self._mounts.health(name, status.info)
            if mount is not None and name in yaws:
                add_yaw(mount, yaws[name])
            views.append(
                CameraView(
                    status=status, required=camera.section.required, blind=blind, age_ns=age_ns,
                    hz=self._rates.hz(name, status.frames, now_ns), exposure_offset=offsets.get(name), mount=mount,
                )
            )  # fmt: skip
        return views

    def _autopilot_view(self, now_ns: int) -> AutopilotView | None:
        if self.link is None:
            return None
        newest_ns = self.loop.newest_attitude_ns
        age_ns = None if newest_ns is None else now_ns - newest_ns
        return AutopilotView(
            address=self.config.autopilot.address, line=self.link.state, link=self.link.status(), attitude_age_ns=age_ns
        )

    def _publish(self, result: PrismsResult, prisms: bytes) -> None:
        self._send("prisms", pb.PrismsFrame, prisms, result.t_exposure_ns)
        if self.avoidance is not None:
            self.avoidance.result(result)
        if self.world is not None:
            self.world.put(result)
        with self.loop.lock:
            self._mounts.result(result)
            self._all_cameras.result(result)
            self._ground.result(result)
        self._publish_surround(time.monotonic_ns())

    def _publish_blind(self, view: CameraView, now_ns: int) -> None:
        """A camera that says nothing is said to be blind, in its place."""
        camera = view.status.camera
        t_ns = now_ns - (view.age_ns or 0)
        with self.loop.lock:
            sequence = self._staleness.sequence(camera)
        message = blind_message(camera, sequence, t_ns, view.blind)
        self._send("prisms", pb.PrismsFrame, wire_bytes(message), t_ns)

    def _publish_surround(self, now_ns: int) -> None:
        """All cameras as one model, where there are several."""
        if "surround" not in self._publishers:
            return
        statuses = {name: camera.status for name, camera in self.cameras.items()}
        with self._sending:  # an older model must not go out after a newer one
            with self.loop.lock:
                oldest_ns = now_ns - round(self.config.service.stale_s * NS)
                model = self._all_cameras.model(
                    lambda name: self._staleness.cause(name, now_ns, statuses[name]), oldest_ns
                )
            message = all_cameras_message(model, self._required)
            self._send("surround", pb.SurroundFrame, wire_bytes(message), model.t_ns or now_ns)

    def _send(
        self, stream: str, kind: type[pb.PrismsFrame] | type[pb.SurroundFrame], data: bytes, t_exposure_ns: int
    ) -> None:
        """A message's bytes with those of its publication behind them, which together are one message."""
        publisher = self._publishers.get(stream)
        if publisher is None:
            return
        with self._sending:  # two threads publish; a socket is for one at a time
            rest = kind()
            reported, age_ns = rest.publication, time.monotonic_ns() - t_exposure_ns
            reported.boot_id, reported.number, reported.age_ns = self._boot, publisher.published, age_ns
            publisher.publish(data + wire_bytes(rest))

    def _send_computer_status(self, report: pb.Health) -> None:
        if self._computer is not None and self.link is not None and report.t_ns >= self._next_computer_ns:
            self._next_computer_ns = report.t_ns + HEALTH_NS * 9 // 10  # reports come at each change, too
            self.link.post(self._computer.message(report))

    def _publish_health(self, views: list[CameraView], autopilot: AutopilotView | None) -> None:
        publisher = self._publishers.get("health")
        report = new_report(self._boot, publisher.published if publisher is not None else 0)
        report.state = self.state
        report.troubles.extend(self.diagnostic_texts)
        report.diagnostics.extend(d.message() for d in self.diagnostics)
        report.changed_safety_keys.extend(self._changed_safety_keys)
        report.cameras.extend(camera_message(v) for v in views)
        if autopilot is not None:
            report.autopilot.CopyFrom(autopilot_message(autopilot))
        if self.recorder is not None:
            report.recording.CopyFrom(recording_message(self.recorder.status))
        with self.loop.lock:
            reported = self.avoidance.latency() if self.avoidance is not None else None
            for stage, p50, p95, p99 in [
                *self.loop.latencies.percentiles(),
                *([reported] if reported is not None else []),
            ]:
                report.latencies.append(latency_message(stage, p50, p95, p99))
            report.frames_used = sum(self.loop.used.values())
            for cause, count in self.loop.dropped.items():
                report.frames_dropped[cause] = count
        report.samples_lost = self.event_queue.lost
        self.machine.fill(report)
        self._send_computer_status(report)
        if self.metrics is not None:
            self.metrics.update(report)
        if self.recorder is not None:
            self.event_queue.put([LogMessage("health", report, report.t_ns)])
        if publisher is not None:
            publisher.publish(report)

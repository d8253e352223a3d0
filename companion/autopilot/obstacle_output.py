"""The obstacle output as one part of the service: what is sent, whether the autopilot uses it, and diagnostics."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

from core.self_check.mount_check import MountVerdict
from core.types import AttitudeSample, CameraInfo, PoseSample
from drivers.mavlink.commands import set_message_interval
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import ARDUPILOT, PX4, LinkStatus, Vehicle
from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.masks import Mask
from ..cameras.status import CameraCondition
from ..cameras.supervisor import CameraSupervisor
from ..config.avoidance import AvoidParams
from ..config.loader import Config
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.latency import Latencies, LatencyStage
from ..pipeline.results import PrismsResult
from .autopilot_values import AutopilotValues
from .clear_sectors import ClearCheck
from .clock_note import ClockNote
from .conflict_codes import CONFLICT_CODES
from .failsafe import AutopilotNow
from .feedback_check import EchoCheck, likely_cause
from .flight_modes import mode_fault, sends_obstacles_back
from .last_values import LastValuesFile
from .line import AutopilotLine
from .obstacle_distance import clear_cm
from .obstacle_report import CameraUse, ObstacleReport
from .parameter_advice import advice
from .parameter_fault import AutopilotFacts
from .px4_advice import delay_advice, position_mode_fault
from .report_builder import ObstacleReportBuilder
from .sector_view import SectorView
from .sender import ObstacleSender
from .status_text import StatusTexts, mount_note, text_message
from .surroundings import Observer

NS = 1_000_000_000
ECHO_HZ, ASK_FOR_ECHO_NS = 2.0, 10 * NS
ECHOES = {PX4: dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, ARDUPILOT: dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR}
"""The message that each autopilot sends back."""
LANDED = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
"""Both autopilots are asked to send it, as often as their echo."""
READS = frozenset(
    {dialect.MAVLINK_MSG_ID_PARAM_VALUE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, LANDED, *ECHOES.values()}
)
"""Ids of the autopilot's messages that `message` handles."""


class ObstacleOutput:
    """Obstacle output of one link."""

    def __init__(
        self, avoid: AvoidParams, use: CameraUse, line: AutopilotLine, last: LastValuesFile | None = None
    ) -> None:
        """Creates the output without starting its thread.

        last: values of the autopilot that were read before this start, used until they are read again."""
        self._avoid, self._cameras, self._line = avoid, use.cameras, line
        self._next_ask_ns = self._end_ns = 0
        self._lock = threading.Lock()
        self._latencies = Latencies((LatencyStage.EXPOSURE_TO_AUTOPILOT,))
        self.values = AutopilotValues(last or LastValuesFile(None))
        self._echo, self._sectors = EchoCheck(), SectorView()
        self._texts, self._was_received = StatusTexts(), False
        self._clock_note = ClockNote()
        self._mount_degraded: dict[str, bool] = {}
        self._link: LinkStatus | None = None
        self._counted: ObstacleReport | None = None
        self._clear_check = ClearCheck(avoid, use.params)
        self._builder = ObstacleReportBuilder(avoid, use)
        self.sender = ObstacleSender(self._builder, avoid, self._autopilot, self._send)

    def open(self) -> None:
        """Starts to send as soon as an autopilot is received."""
        self.sender.open()

    def end(self) -> None:
        """Announces that the service stops: from now on all cameras count as blind. A vehicle that may be in flight gets
        a STATUSTEXT."""
        self._builder.end("the service stops")
        vehicle = self._may_fly()
        if vehicle is not None and not self._end_ns:
            self._end_ns = time.monotonic_ns()
            text = shutdown_text(self.values.facts(vehicle))
            self._line.post(text_message(dialect.MAV_SEVERITY_CRITICAL, text))

    def close(self) -> None:
        """Stops. A vehicle that may be in flight is sent the artificial wall for stop_hold_s first. May be called twice."""
        hold_ns = round(self._avoid.stop_hold_s * NS)
        while self._end_ns and time.monotonic_ns() - self._end_ns < hold_ns and self._flies_on():
            time.sleep(0.05)
        self._end_ns = 0
        self.values.close()
        self.sender.close()

    def _flies_on(self) -> bool:
        """True if a vehicle that may be in flight is being sent the artificial wall."""
        sends_wall = (
            self.report is not None and self.report.policy in ("stop", "brake") and self.report.values is not None
        )
        return self._may_fly() is not None and self.sender.running and sends_wall

    def _may_fly(self) -> Vehicle | None:
        """Returns the autopilot if its vehicle is armed, or may not be the own one, which may be armed; None: neither."""
        vehicle = self._line.vehicle() or self._line.silent()
        return vehicle if vehicle is not None and (vehicle.armed or self._is_uncertain) else None

    @property
    def _is_uncertain(self) -> bool:
        """Several vehicles are received, or several that use the ids of one."""
        return self._link is not None and self._link.vehicle_uncertain

    # ---- in ---------------------------------------------------------------------------------------------------------

    def samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Takes attitudes and positions of the autopilot."""
        self._builder.samples(samples)

    def announce(self, info: CameraInfo, hidden: Mask | None = None) -> None:
        """Takes a camera that was opened. hidden: pixels that are never measured."""
        self._clear_check.announce(info, hidden)
        self._builder.announce(info, hidden)

    def result(self, result: PrismsResult) -> None:
        """Takes the result of a frame."""
        if result.mount is not None:
            self._mount_degraded[result.camera] = result.mount.verdict is MountVerdict.DEGRADED
        self._builder.result(result)
        self._clear_check.examine()

    def message(self, message: Any, arrival_ns: int) -> None:
        """Takes a message of the autopilot, of those in READS."""
        self.values.take(message, arrival_ns)
        self._echo.take(message, arrival_ns)
        self._sectors.take(message, arrival_ns)

    # ---- out --------------------------------------------------------------------------------------------------------

    def tick(self, now_ns: int, link: LinkStatus | None = None) -> None:
        """Requests parameters and sends STATUSTEXT of changes; called about ten times per second.

        link: state of the link. An autopilot whose signatures are not accepted is sent only a notice of that."""
        self._link = link or self._link
        vehicle = self._line.vehicle()
        if vehicle is not None and not self._was_received:
            self._texts.repeat()  # it may have been switched off, and the ground station with it
        self._was_received = vehicle is not None
        text = self._texts.due(self._blind(), now_ns, self._notes(now_ns))
        if text is not None:
            self._line.post(text)
        if vehicle is None:
            return
        for request in self.values.due(vehicle, now_ns):
            self._line.post(request)
        if now_ns >= self._next_ask_ns and vehicle.autopilot in ECHOES:
            self._next_ask_ns = now_ns + ASK_FOR_ECHO_NS
            for message_id in (ECHOES[vehicle.autopilot], LANDED):
                self._line.post(set_message_interval(vehicle.system_id, message_id, ECHO_HZ))

    def _notes(self, now_ns: int) -> dict[str, str]:
        """Returns topic -> fault, as text, for the ground station. All topics are included, so that the end of a
        fault is reported; without a received autopilot only that of signatures, of which it is sent a notice, and that several
        vehicles are received: the own one may be another one."""
        signing = self._link.signing_fault if self._link is not None else ""
        conflicts = self._link.conflicts if self._link is not None else {}
        vehicle = self._line.vehicle()
        if vehicle is None:
            topic = "several vehicles"
            return {"signing": signing} | ({topic: conflicts.get(topic, "")} if self._line.silent() else {})
        notes = dict.fromkeys(CONFLICT_CODES, "") | conflicts
        for camera, degraded in tuple(self._mount_degraded.items()):
            notes[f"mount {camera}"] = mount_note(camera, degraded)
        return notes | {
            "signing": signing,
            "clock": self._clock_note.text(self._link, now_ns),
            "mode": self._mode_text(vehicle),
            "echo": self._echo_fault(vehicle, now_ns),
        }

    def _mode_text(self, vehicle: Vehicle) -> str:
        """Returns why the flight mode does not protect the vehicle; empty before the first heartbeat, which contains
        the mode."""
        return mode_fault(vehicle, self.values.facts(vehicle)) if vehicle.heartbeat_ns > 0 else ""

    def _echo_fault(self, vehicle: Vehicle, now_ns: int) -> str:
        facts = self.values.facts(vehicle)
        if not sends_obstacles_back(vehicle, facts):
            return ""
        signing = self._link.signing_fault if self._link is not None else ""
        cause = likely_cause(vehicle, facts, signing)
        return self._echo.fault(vehicle.autopilot, now_ns, cause)

    def _blind(self) -> dict[str, str]:
        """Returns why each camera is blind, as text; empty: it is not. No entry before the first decision or without
        an autopilot."""
        report = self.sender.report
        if report is None or self._line.vehicle() is None:
            return {}
        return {c: report.blind.get(c, "") for c in self._cameras}

    def diagnostics(self, now_ns: int) -> list[Diagnostic]:
        """Returns the faults that keep the vehicle from braking."""
        vehicle, never_clear = self._line.vehicle(), self._clear_check.diagnostics()
        if vehicle is None:
            return never_clear
        facts, report = self.values.facts(vehicle), self.report
        advised = advice(facts, self._avoid) + delay_advice(facts, self.latency())
        texts = [
            (DiagnosticCode.OBSTACLES_NOT_ACCEPTED, self._echo_fault(vehicle, now_ns)),
            (DiagnosticCode.AVOIDANCE_FAULT, report.fault if report is not None else ""),
            *((DiagnosticCode.PARAMETER_ADVICE, text) for text in advised),
            *((DiagnosticCode.PARAMETER_CONTRADICTION, text) for text in self.values.parameters.contradictions(now_ns)),
            (DiagnosticCode.FLIGHT_MODE_UNPROTECTED, self._mode_text(vehicle)),
        ]
        if report is not None and report.policy == "stop" and "AVOID_MARGIN" in facts.silent:
            margin_m = self.values.parameter(vehicle, "AVOID_MARGIN") or self._avoid.avoid_margin_m
            text = (
                f"AVOID_MARGIN was not read: the artificial wall is placed for {margin_m:g} m; set [avoid] avoid_margin_m to the "
                "autopilot's value"
            )
            texts.append((DiagnosticCode.AVOID_MARGIN_UNKNOWN, text))
        if report is not None and report.policy == "brake" and self.values.parameters.value("CP_DIST") is None:
            cp_dist_m = self.values.parameter(vehicle, "CP_DIST")
            if cp_dist_m is not None:
                text = f"CP_DIST was not read yet: the artificial wall is placed for {cp_dist_m:g} m of the last start"
                texts.append((DiagnosticCode.PARAMETER_ADVICE, text))
        return [Diagnostic(code, "", text) for code, text in texts if text] + never_clear

    def fill(self, health: pb.AutopilotHealth, now_ns: int) -> None:
        """Writes the newest obstacle distances, sent and echoed, into a report."""
        self._sectors.fill(health, now_ns)

    def latency(self) -> tuple[LatencyStage, float, float, float] | None:
        """Returns (stage, p50, p95, p99) in ms of the age of the oldest exposure in use at the moment of sending;
        None: none yet."""
        with self._lock:
            return next(iter(self._latencies.percentiles()), None)

    @property
    def report(self) -> ObstacleReport | None:
        """The newest decision."""
        return self.sender.report

    def _autopilot(self) -> AutopilotNow:
        vehicle = self._line.vehicle() or self._line.silent()
        if vehicle is None:
            return AutopilotNow()
        return self.values.state(vehicle, time.monotonic_ns(), is_uncertain=self._is_uncertain)

    def _send(self, message: Any) -> None:
        report = self.sender.report  # may go out as many messages
        if report is not None and report.values is not None and report is not self._counted:
            self._counted = report
            vehicle = self._line.vehicle()
            if vehicle is not None and sends_obstacles_back(vehicle, self.values.facts(vehicle)):
                self._echo.sent(report.values, clear_cm(self._avoid), report.t_ns)
            else:
                self._echo.pause()
            self._sectors.sent(report.values, clear_cm(self._avoid), report.t_ns)
            if report.exposed_ns is not None:
                with self._lock:
                    self._latencies.add(LatencyStage.EXPOSURE_TO_AUTOPILOT, time.monotonic_ns() - report.exposed_ns)
        self._line.post(message)


def camera_use(config: Config, cameras: Mapping[str, CameraSupervisor], observer: Observer | None = None) -> CameraUse:
    """Returns the cameras of a configuration. cameras: supervisors by name; observer: see CameraUse."""

    def frozen(camera: str) -> str:
        status = cameras[camera].status
        return f"{status.condition}: {status.cause}" if status.condition is CameraCondition.FROZEN else ""

    return CameraUse(
        cameras=tuple(cameras),
        timeout_s=config.service.timeout_s,
        params=config.extractor,
        frame_fault=frozen,
        observer=observer,
        open_counts=config.open_sky.presumes,
        reach_m=config.guard.horizon_m if config.guard.enabled else 0.0,
    )


def shutdown_text(facts: AutopilotFacts) -> str:
    """Returns a text on what the vehicle does when the service has ended.

    ArduPilot flies on. PX4 does not move in Position mode, if that mode brakes at all."""
    stands = facts.kind == PX4 and not position_mode_fault(facts)
    return "OA: stopped, Position mode stands" if stands else "OA: stopped, vehicle does not brake"

"""Health report: its messages, diagnostics and state."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from drivers.logs import codec as wire
from drivers.mavlink.clock_sync import UNKNOWN_DELAY_NS, ClockEstimate, ClockSource
from drivers.mavlink.link import LinkState
from drivers.mavlink.session import MAV_STATE_ACTIVE, MAV_STATE_CRITICAL, MAV_STATE_STANDBY
from drivers.mavlink.session_types import LinkStatus
from osape_client.proto import osape_v1_pb2 as pb

from ..autopilot.clock_note import LARGE_BOUND_NS
from ..autopilot.conflict_codes import conflict_diagnostics
from ..autopilot.flight_modes import mode_name
from ..cameras.supervisor import CameraStatus
from ..diagnostic import Diagnostic, DiagnosticCode
from ..log.recorder import RecordStatus
from ..pipeline.encode import SCHEMA_VERSION
from ..pipeline.latency import LatencyStage
from ..self_check.exposure_offset import ExposureOffset

NS = 1_000_000_000
THERMAL = Path("/sys/class/thermal")
ATTITUDE_OLD_NS = NS // 2

STATES = {
    pb.Health.STATE_STARTING: "starting",
    pb.Health.STATE_ACTIVE: "active",
    pb.Health.STATE_DEGRADED: "degraded",
    pb.Health.STATE_BLIND: "blind",
}
HEARTBEAT_STATES = {
    pb.Health.STATE_STARTING: MAV_STATE_STANDBY,
    pb.Health.STATE_ACTIVE: MAV_STATE_ACTIVE,
    pb.Health.STATE_DEGRADED: MAV_STATE_ACTIVE,
    pb.Health.STATE_BLIND: MAV_STATE_CRITICAL,
}
"""MAV_STATE of the heartbeat to the autopilot."""


CLOCK_SOURCES = {
    ClockSource.NONE: pb.ClockEstimate.SOURCE_NONE,
    ClockSource.ENVELOPE: pb.ClockEstimate.SOURCE_ENVELOPE,
    ClockSource.TIMESYNC: pb.ClockEstimate.SOURCE_TIMESYNC,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraView:
    """State of a camera in the health report."""

    status: CameraStatus
    required: bool
    blind: str  # why it is blind, as text; empty: it is not
    age_ns: int | None
    hz: float
    last_loss_age_ns: int | None = None  # time since the cause of its last restart; None: never restarted
    exposure_offset: ExposureOffset | None = None
    mount: pb.MountHealth | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotView:
    """State of the autopilot in the health report."""

    address: str
    line: LinkState
    link: LinkStatus
    attitude_age_ns: int | None
    heartbeat_age_ns: int | None = None


def clock_message(clock: ClockEstimate, restarts: int) -> pb.ClockEstimate:
    """Message of the clock estimate."""
    message = pb.ClockEstimate(
        source=CLOCK_SOURCES[clock.source],
        offset_ns=clock.offset_ns,
        drift=clock.drift,
        at_boot_ns=clock.at_boot_ns,
        exchanges=clock.exchanges,
        restarts=restarts,
    )
    if clock.bound_ns is not None:
        message.bound_ns = clock.bound_ns
    if clock.rtt_ns is not None:
        message.rtt_ns = clock.rtt_ns
    return message


def camera_message(view: CameraView) -> pb.CameraHealth:
    """Message of one camera."""
    s = view.status
    message = pb.CameraHealth(
        camera=s.camera,
        condition=str(s.condition),
        cause=view.blind or s.cause,
        required=view.required,
        blind=bool(view.blind),
        frames=s.frames,
        dropped=s.dropped,
        starts=s.starts,
        restart_count=max(0, s.starts - 1),
        last_loss=s.last_loss,
        hz=view.hz,
        info=None if s.info is None else wire.camera_message(s.info),
        mount=view.mount,
        condition_enum=f"CONDITION_{s.condition.name}",
    )
    if view.age_ns is not None:
        message.age_ns = view.age_ns
    if view.last_loss_age_ns is not None:
        message.last_loss_age_ns = view.last_loss_age_ns
    if view.exposure_offset is not None:
        message.exposure_offset.CopyFrom(exposure_offset_message(view.exposure_offset))
    return message


def exposure_offset_message(offset: ExposureOffset) -> pb.ExposureOffset:
    """Message of the measured exposure time offset; without a value unless it is measured."""
    message = pb.ExposureOffset(
        state=str(offset.state),
        text=offset.text,
        pairs=offset.pairs,
        warns=offset.warns,
        state_enum=f"STATE_{offset.state.name}",
    )
    if offset.offset_s is not None and offset.sigma_s is not None:
        message.offset_ms, message.sigma_ms = 1000.0 * offset.offset_s, 1000.0 * offset.sigma_s
    return message


def autopilot_message(view: AutopilotView) -> pb.AutopilotHealth:
    """Message of the autopilot and its link."""
    link, vehicle = view.link, view.link.vehicle
    message = pb.AutopilotHealth(
        address=view.address,
        line_open=view.line.open,
        line_error=view.line.error,
        line_warning="; ".join(filter(None, (view.line.flood, view.line.warning))),
        autopilot=vehicle.autopilot if vehicle else "",
        system_id=vehicle.system_id if vehicle else 0,
        armed=vehicle.armed if vehicle else False,
        attitude_hz=link.attitude_hz,
        position_hz=link.position_hz,
        clock=clock_message(link.clock, link.clock_restarts),
        counts=link.counts,
        flight_mode=mode_name(vehicle) if vehicle and vehicle.heartbeat_ns else "",
    )
    if view.attitude_age_ns is not None:
        message.attitude_age_ns = view.attitude_age_ns
    if view.heartbeat_age_ns is not None:
        message.heartbeat_age_ns = view.heartbeat_age_ns
    return message


def latency_message(stage: LatencyStage, p50_ms: float, p95_ms: float, p99_ms: float) -> pb.Latency:
    """Message of the percentiles of one stage."""
    return pb.Latency(
        stage=stage.value,
        p50_ms=p50_ms,
        p95_ms=p95_ms,
        p99_ms=p99_ms,
        stage_enum=f"STAGE_{stage.name}",
        text=stage.text,
    )


def recording_message(status: RecordStatus) -> pb.RecordingHealth:
    """Message of the recorder."""
    return pb.RecordingHealth(
        recording=status.recording,
        file=status.file,
        bytes=status.bytes,
        dropped=status.dropped,
        trouble=status.fault,
        repairing=status.repairing,
    )


def diagnostics_of(
    cameras: Iterable[CameraView], autopilot: AutopilotView | None, recording: RecordStatus | None, thread_fault: str
) -> list[Diagnostic]:
    """The diagnostics of threads, cameras, link and recorder, in this order. thread_fault: the required threads that have
    ended, or the one that does not respond, as text; empty: none."""
    views = list(cameras)
    found = [Diagnostic(DiagnosticCode.THREAD_STALLED, "", thread_fault)] if thread_fault else []
    if not views:
        text = "no camera is configured: add a [[camera]] to the configuration"
        found.append(Diagnostic(DiagnosticCode.NO_CAMERA_CONFIGURED, "", text))
    for view in sorted((v for v in views if v.blind), key=lambda v: not v.required):
        found.append(_unavailable(view))
    found += _autopilot_diagnostics(autopilot)
    if recording is not None and recording.fault:
        found.append(Diagnostic(DiagnosticCode.RECORDING_FAULT, "", recording.fault))
    return found


def _unavailable(view: CameraView) -> Diagnostic:
    camera = view.status.camera
    if view.required:
        return Diagnostic(DiagnosticCode.CAMERA_UNAVAILABLE, camera, f"camera {camera} is blind: {view.blind}")
    text = f"camera {camera} (not required) is blind: {view.blind}"
    return Diagnostic(DiagnosticCode.OPTIONAL_CAMERA_UNAVAILABLE, camera, text)


def _autopilot_diagnostics(view: AutopilotView | None) -> list[Diagnostic]:
    def of(code: DiagnosticCode, text: str) -> Diagnostic:
        return Diagnostic(code, "", text)

    if view is None:
        return [of(DiagnosticCode.NO_AUTOPILOT_CONFIGURED, "no autopilot is configured: set [autopilot] address")]
    if not view.line.open:
        return [of(DiagnosticCode.LINK_CLOSED, f"the link to the autopilot is not open: {view.line.error}")]
    found = [of(DiagnosticCode.UDP_FLOOD, view.line.flood)] if view.line.flood else []
    if view.line.warning:
        found.append(of(DiagnosticCode.LINK_SLOW, view.line.warning))
    signing = view.link.signing_fault
    if signing:
        found.append(of(DiagnosticCode.SIGNING_FAULT, signing))
    found += conflict_diagnostics(view.link.conflicts)
    if view.link.vehicle is None:
        if not signing and "system id" not in view.link.conflicts:
            found.append(of(DiagnosticCode.NO_HEARTBEAT, f"no heartbeat of an autopilot on {view.address}"))
        return found
    if view.attitude_age_ns is None or view.attitude_age_ns > ATTITUDE_OLD_NS:
        age = "was never received" if view.attitude_age_ns is None else f"is {view.attitude_age_ns / NS:.1f} s old"
        text = f"the attitude {age}: the autopilot does not send it or the link is interrupted"
        found.append(of(DiagnosticCode.ATTITUDE_STALE, text))
    clock = view.link.clock
    if clock.source is ClockSource.ENVELOPE:
        text = (
            "the autopilot does not answer TIMESYNC: its timestamps are estimated from arrival times and include the "
            f"delay of the link, which is assumed to be at most {UNKNOWN_DELAY_NS / 1e6:.0f} ms; a longer one displaces obstacles in turns"
        )
        found.append(of(DiagnosticCode.NO_TIMESYNC, text))
    elif clock.bound_ns is not None and not view.link.timesync_answered:
        text = (
            f"the autopilot no longer answers TIMESYNC in time: the error bound of its timestamps is {clock.bound_ns / 1e6:.1f} "
            "ms and grows"
        )
        found.append(of(DiagnosticCode.NO_TIMESYNC, text))
    elif clock.bound_ns is not None and clock.bound_ns > LARGE_BOUND_NS:
        found.append(of(DiagnosticCode.CLOCK_UNCERTAIN, clock_uncertain_text(clock.bound_ns)))
    return found


def clock_uncertain_text(bound_ns: int) -> str:
    """The cause and the remedy of a large error bound of the autopilot's clock."""
    return (
        f"the autopilot's timestamps may be wrong by {bound_ns / 1e6:.0f} ms, because TIMESYNC takes that long, or because the "
        "clock of this computer is being corrected (NTP): frames in fast turns are dropped, positions in fast flight are not used; "
        "use a faster link (921600 baud), or request lower rates; synchronise the clock before the flight"
    )


def state_of(cameras: Iterable[CameraView], diagnostics: Sequence[Diagnostic], started: bool) -> pb.Health.State:
    """The state of the service. BLIND: a required camera is blind, or all cameras are."""
    views = list(cameras)
    if not started:
        return pb.Health.STATE_STARTING
    if not views or all(v.blind for v in views) or any(v.blind and v.required for v in views):
        return pb.Health.STATE_BLIND
    return pb.Health.STATE_DEGRADED if diagnostics else pb.Health.STATE_ACTIVE


class ProcessUsage:
    """Processor time, memory and temperatures of the service."""

    def __init__(self) -> None:
        self._begun_ns = self._last_ns = time.monotonic_ns()
        self._cpu_s = _cpu_s()

    def fill(self, message: pb.Health) -> None:
        """Fills these fields of a report. The processor's share is measured since the previous call."""
        now_ns, cpu_s = time.monotonic_ns(), _cpu_s()
        message.uptime_ns = now_ns - self._begun_ns
        message.cpu_share = (cpu_s - self._cpu_s) / max(1e-3, (now_ns - self._last_ns) / NS)
        self._last_ns, self._cpu_s = now_ns, cpu_s
        with suppress(OSError):  # no file can be opened: the rest of the report counts
            message.memory_bytes = _memory_bytes()
            message.temperatures.extend(_temperatures())


def new_report(boot: str, number: int) -> pb.Health:
    """A report without content."""
    return pb.Health(schema_version=SCHEMA_VERSION, boot_id=boot, number=number, t_ns=time.monotonic_ns())


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _memory_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def _temperatures() -> list[pb.Temperature]:
    """Temperatures of the system's thermal sensors."""
    found = []
    for zone in sorted(THERMAL.glob("thermal_zone*")):
        try:
            celsius = int((zone / "temp").read_text()) / 1000.0
            found.append(pb.Temperature(sensor=(zone / "type").read_text().strip(), celsius=celsius))
        except (OSError, ValueError):
            continue  # the sensor is switched off
    return found

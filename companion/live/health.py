"""Health report: its messages and the state of the service."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from drivers.logs import codec as wire
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import LinkState
from drivers.mavlink.session_types import LinkStatus
from osape_client.proto import osape_v1_pb2 as pb

from ..autopilot.flight_modes import mode_name
from ..cameras.status import CameraStatus
from ..diagnostic import Diagnostic
from ..log.recorder import RecordStatus
from ..pipeline.encode import SCHEMA_VERSION
from ..pipeline.latency import LatencyStage
from ..self_check.exposure_offset import ExposureOffset

STATES = {
    pb.Health.STATE_STARTING: "starting",
    pb.Health.STATE_ACTIVE: "active",
    pb.Health.STATE_DEGRADED: "degraded",
    pb.Health.STATE_BLIND: "blind",
}
HEARTBEAT_STATES = {
    pb.Health.STATE_STARTING: dialect.MAV_STATE_STANDBY,
    pb.Health.STATE_ACTIVE: dialect.MAV_STATE_ACTIVE,
    pb.Health.STATE_DEGRADED: dialect.MAV_STATE_ACTIVE,
    pb.Health.STATE_BLIND: dialect.MAV_STATE_CRITICAL,
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
    link_state: LinkState
    status: LinkStatus
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
    status, vehicle = view.status, view.status.vehicle
    message = pb.AutopilotHealth(
        address=view.address,
        line_open=view.link_state.open,
        line_error=view.link_state.error,
        line_warning="; ".join(filter(None, (view.link_state.flood, view.link_state.warning))),
        autopilot=vehicle.autopilot if vehicle else "",
        system_id=vehicle.system_id if vehicle else 0,
        armed=vehicle.armed if vehicle else False,
        attitude_hz=status.attitude_hz,
        position_hz=status.position_hz,
        clock=clock_message(status.clock, status.clock_restarts),
        counts=status.counts,
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


def state_of(cameras: Iterable[CameraView], diagnostics: Sequence[Diagnostic], started: bool) -> pb.Health.State:
    """The state of the service. BLIND: a required camera is blind, or all cameras are."""
    views = list(cameras)
    if not started:
        return pb.Health.STATE_STARTING
    if not views or all(v.blind for v in views) or any(v.blind and v.required for v in views):
        return pb.Health.STATE_BLIND
    return pb.Health.STATE_DEGRADED if diagnostics else pb.Health.STATE_ACTIVE


def new_report(boot: str, number: int) -> pb.Health:
    """A report without content."""
    return pb.Health(schema_version=SCHEMA_VERSION, boot_id=boot, number=number, t_ns=time.monotonic_ns())

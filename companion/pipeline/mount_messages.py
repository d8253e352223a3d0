"""Encodes and decodes the state of the mount check, and formats it as text."""

from __future__ import annotations

import math

from core.self_check.mount_check import MountState, MountVerdict
from core.self_check.mount_filter import FilterState, N
from core.types import CameraMount
from osape_client.proto import osape_v1_pb2 as pb

from ..diagnostic import Diagnostic, DiagnosticCode

VERDICTS = {
    MountVerdict.UNKNOWN: pb.MountState.VERDICT_UNKNOWN,
    MountVerdict.VERIFIED: pb.MountState.VERDICT_VERIFIED,
    MountVerdict.DEGRADED: pb.MountState.VERDICT_DEGRADED,
    MountVerdict.UNVERIFIED_SLOPE: pb.MountState.VERDICT_UNVERIFIED_SLOPE,
    MountVerdict.ERROR: pb.MountState.VERDICT_ERROR,
}


def mount_state_message(state: MountState) -> pb.MountState:
    """Encodes the state that the next frame continues from."""
    return pb.MountState(
        t_ns=state.t_ns,
        measurements=state.measurements,
        verdict=VERDICTS[state.verdict],
        pending=VERDICTS[state.pending],
        streak=state.streak,
        slope_rad=state.slope_rad,
        ground=state.ground,
        confirmations=state.confirmations,
        residual_north_rad=state.residual_rad[0],
        residual_east_rad=state.residual_rad[1],
        mean=state.filter.mean,
        covariance=state.filter.covariance,
        heading_jump_ns=state.heading_jump_ns,
    )


def mount_state_from_message(message: pb.MountState) -> MountState:
    """Decodes the state. Raises ValueError for an inconsistent message."""
    if len(message.mean) != N or len(message.covariance) != N * (N + 1) // 2:
        raise ValueError(
            f"mount state with {len(message.mean)} and {len(message.covariance)} numbers, expected 5 and 15"
        )
    return MountState(
        t_ns=message.t_ns if message.HasField("t_ns") else None,
        measurements=message.measurements,
        verdict=MountVerdict(message.verdict),
        pending=MountVerdict(message.pending),
        streak=message.streak,
        slope_rad=message.slope_rad,
        ground=message.ground,
        confirmations=message.confirmations,
        residual_rad=(message.residual_north_rad, message.residual_east_rad),
        filter=FilterState(tuple(message.mean), tuple(message.covariance)),
        heading_jump_ns=message.heading_jump_ns,
    )


def mount_health(state: MountState, mount: CameraMount) -> pb.MountHealth:
    """The mount for the health report. mount: the configured one."""
    roll, pitch = (math.degrees(v) for v in state.error_rad)
    roll_sd, pitch_sd = (math.degrees(v) for v in state.error_sd_rad)
    to_roll, to_pitch, to_yaw = (math.degrees(v) for v in state.corrected(mount))
    return pb.MountHealth(
        verdict=VERDICTS[state.verdict],
        roll_error_deg=roll,
        pitch_error_deg=pitch,
        roll_sd_deg=roll_sd,
        pitch_sd_deg=pitch_sd,
        roll_deg=to_roll,
        pitch_deg=to_pitch,
        yaw_deg=to_yaw,
        slope_deg=math.degrees(state.slope_rad),
    )


def mount_lines(health: pb.MountHealth) -> str:
    """The keys for the camera's section of the configuration, as one line of text."""
    return f"roll_deg = {health.roll_deg:z.1f}, pitch_deg = {health.pitch_deg:z.1f}"


def mount_diagnostic(camera: str, health: pb.MountHealth) -> Diagnostic | None:
    """The fault of a mount with its remedy; None: no known fault."""
    error = f"roll {health.roll_error_deg:+z.1f} deg, pitch {health.pitch_error_deg:+z.1f} deg"
    if health.verdict == pb.MountState.VERDICT_ERROR:
        text = (
            f"camera {camera}: the mount differs from its configuration by {error}; its frames are invalid; "
            f"set {mount_lines(health)} (check with `companion doctor --mount`)"
        )
        return Diagnostic(DiagnosticCode.MOUNT_ERROR, camera, text)
    if health.verdict == pb.MountState.VERDICT_DEGRADED:
        text = (
            f"camera {camera}: the mount differs from its configuration by {error}; set "
            f"{mount_lines(health)} (check with `companion doctor --mount`)"
        )
        return Diagnostic(DiagnosticCode.MOUNT_DEGRADED, camera, text)
    if health.verdict == pb.MountState.VERDICT_UNVERIFIED_SLOPE:
        text = (
            f"camera {camera}: the ground appears inclined by {health.slope_deg:.1f} deg, by the terrain or by a wrong mount; its "
            "frames are invalid; turn the vehicle by 45 degrees or more with ground in view, or aim the camera at walls"
        )
        return Diagnostic(DiagnosticCode.MOUNT_UNVERIFIED, camera, text)
    return None


def mount_text(health: pb.MountHealth) -> str:
    """The text of `companion status`, one line."""
    text = {
        pb.MountState.VERDICT_UNKNOWN: "not verified yet",
        pb.MountState.VERDICT_VERIFIED: "verified",
        pb.MountState.VERDICT_DEGRADED: "wrong",
        pb.MountState.VERDICT_UNVERIFIED_SLOPE: "not verified, large slope, frames invalid",
        pb.MountState.VERDICT_ERROR: "wrong, frames invalid",
    }[health.verdict]
    yaw = ""
    if health.HasField("yaw_error_deg"):
        yaw = f"yaw {health.yaw_error_deg:+z.1f} +- {health.yaw_sd_deg:.1f} deg; "
    return (
        f"{text}; {yaw}error roll {health.roll_error_deg:+z.1f} +- {health.roll_sd_deg:.1f} deg, pitch {health.pitch_error_deg:+z.1f} +- "
        f"{health.pitch_sd_deg:.1f} deg; apparent slope of the ground {health.slope_deg:.1f} deg"
    )

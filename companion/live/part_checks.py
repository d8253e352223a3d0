"""Checks of the service's parts: which have ended by an exception, and which do not respond."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.signing import Signing

from ..cameras.supervisor import CameraSupervisor
from ..diagnostic import Diagnostic, DiagnosticCode
from ..streams.curve_auth import AllowList
from .depth_preview import DepthPreviews
from .pipeline_thread import PipelineThread

if TYPE_CHECKING:
    from ..autopilot.manager import Avoidance
    from ..guard.guard import Guard
    from .prometheus import MetricsServer

NS = 1_000_000_000
LINK_OPEN_NS = 2 * NS
"""Opening a link or a camera process may take this much longer than the liveness timeout."""


def failures(
    loop: PipelineThread,
    link: MavlinkLink | None,
    avoidance: Avoidance | None,
    guard: Guard | None,
    cameras: Mapping[str, CameraSupervisor],
) -> str:
    """The required threads that an exception has ended, as text; empty: none."""
    parts = {"the pipeline": loop.failure}
    if link is not None:
        parts["the link to the autopilot"] = link.failure
    if avoidance is not None:
        parts["the obstacle sender"] = avoidance.sender.failure
    if guard is not None:
        parts["the guard"] = guard.failure
    parts |= {f"the supervision of camera {name}": camera.failure for name, camera in cameras.items()}
    return "; ".join(f"{part} has ended: {failure}" for part, failure in parts.items() if failure)


def stalled_part(
    loop: PipelineThread,
    link: MavlinkLink | None,
    avoidance: Avoidance | None,
    guard: Guard | None,
    cameras: Mapping[str, CameraSupervisor],
    now_ns: int,
    timeout_ns: int,
) -> str:
    """The first required thread that has ended or has not responded for `timeout_ns`, as text; empty: none.

    The recorder is not checked here: a slow disk is reported but does not end the service."""
    if not loop.running:
        return "the pipeline has ended and"
    if loop.started and now_ns - loop.alive_ns > timeout_ns:
        return "the pipeline"
    if link is not None and now_ns - link.state.alive_ns > timeout_ns + LINK_OPEN_NS:
        return "the link to the autopilot"
    if avoidance is not None and avoidance.stalled(timeout_ns):
        return "the obstacle sender"
    if guard is not None and guard.stalled(now_ns, timeout_ns):
        return "the guard"
    for name, camera in cameras.items():
        if camera.status.alive_ns and now_ns - camera.status.alive_ns > timeout_ns + LINK_OPEN_NS:
            return f"the supervision of camera {name}"
    return ""


def ended_optional_parts(
    metrics: MetricsServer | None, previews: DepthPreviews, signing: Signing, allow: AllowList | None
) -> list[Diagnostic]:
    """Diagnostics of the optional parts that have ended. Recording and the merged world report their own."""
    texts: dict[DiagnosticCode, str] = {}
    if metrics is not None:
        texts[DiagnosticCode.METRICS_FAULT] = metrics.fault
    texts[DiagnosticCode.DEPTH_PREVIEW_FAULT] = previews.fault
    if signing.failure:
        texts[DiagnosticCode.SIGNATURE_CLOCK_FAULT] = f"timestamps of signatures are not saved ({signing.failure})"
    if allow and not allow.running:
        text = "the check of subscribers' keys has ended; new subscribers are refused. Restart the service"
        texts[DiagnosticCode.KEY_CHECK_FAULT] = text
    return [Diagnostic(code, "", text) for code, text in texts.items() if text]

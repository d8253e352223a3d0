"""The parts of the running service, and which of them have ended or do not respond."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.signing import Signing

from ..cameras.status import CameraStatus
from ..cameras.supervisor import CameraSupervisor
from ..diagnostic import Diagnostic, DiagnosticCode
from ..log.recorder import Recorder
from ..streams.curve_auth import AllowList
from .depth_preview import DepthPreviews
from .event_queue import EventQueue
from .pipeline_thread import PipelineThread

if TYPE_CHECKING:
    from ..autopilot.obstacle_output import ObstacleOutput
    from ..guard.guard import Guard
    from ..share.share_service import ShareService
    from .metrics_server import MetricsServer
    from .world_thread import WorldThread

NS = 1_000_000_000
LINK_OPEN_NS = 2 * NS
"""Opening a link or a camera process may take this much longer than the liveness timeout."""


@dataclass(slots=True, kw_only=True)
class Parts:
    """The parts of the service. None: not configured.

    Required are the pipeline, the link, the obstacle output, the guard and the supervision of each camera: without one of
    them the service ends. The others report their faults."""

    cameras: dict[str, CameraSupervisor]
    pipeline_thread: PipelineThread
    event_queue: EventQueue
    previews: DepthPreviews
    signing: Signing
    session: MavlinkSession | None = None
    link: MavlinkLink | None = None
    obstacle_output: ObstacleOutput | None = None
    guard: Guard | None = None
    share: ShareService | None = None
    recorder: Recorder | None = None
    metrics: MetricsServer | None = None
    world: WorldThread | None = None  # None: or not opened yet
    allow: AllowList | None = None  # None: or not opened yet

    def camera_statuses(self) -> dict[str, CameraStatus]:
        """The status of each camera, by name."""
        return {name: camera.status for name, camera in self.cameras.items()}

    def failures(self) -> str:
        """The required threads that an exception has ended, as text; empty: none. The service then ends and systemd restarts
        it (docs/reference/service.md)."""
        failures = {"the pipeline": self.pipeline_thread.failure}
        if self.link is not None:
            failures["the link to the autopilot"] = self.link.failure
        if self.obstacle_output is not None:
            failures["the obstacle sender"] = self.obstacle_output.sender.failure
        if self.guard is not None:
            failures["the guard"] = self.guard.failure
        failures |= {f"the supervision of camera {name}": camera.failure for name, camera in self.cameras.items()}
        return "; ".join(f"{part} has ended: {failure}" for part, failure in failures.items() if failure)

    def stalled(self, now_ns: int, timeout_ns: int) -> str:
        """The first required thread that has not responded for `timeout_ns`, as text; empty: none. Threads that an exception
        has ended are named at once by `failures`.

        The recorder is not checked here: a slow disk is reported but does not end the service."""
        alive_ns: dict[str, int] = {}
        if self.pipeline_thread.started.is_set():
            alive_ns["the pipeline"] = self.pipeline_thread.alive_ns
        if self.link is not None:
            alive_ns["the link to the autopilot"] = self.link.state.alive_ns + LINK_OPEN_NS
        if self.obstacle_output is not None:
            alive_ns["the obstacle sender"] = self.obstacle_output.sender.alive_ns
        if self.guard is not None:
            alive_ns["the guard"] = self.guard.alive_ns
        for name, camera in self.cameras.items():
            if camera.status.alive_ns:
                alive_ns[f"the supervision of camera {name}"] = camera.status.alive_ns + LINK_OPEN_NS
        silent = (part for part, part_ns in alive_ns.items() if now_ns - part_ns > timeout_ns)
        return next((f"{part} does not respond" for part in silent), "")

    def ended_optional(self) -> list[Diagnostic]:
        """Diagnostics of the optional parts that have ended. Recording and the merged world report their own."""
        texts: dict[DiagnosticCode, str] = {}
        if self.metrics is not None:
            texts[DiagnosticCode.METRICS_FAULT] = self.metrics.fault
        texts[DiagnosticCode.DEPTH_PREVIEW_FAULT] = self.previews.fault
        if self.signing.failure:
            texts[DiagnosticCode.SIGNATURE_CLOCK_FAULT] = (
                f"timestamps of signatures are not saved ({self.signing.failure})"
            )
        if self.allow and not self.allow.running:
            text = "the check of subscribers' keys has ended; new subscribers are refused. Restart the service"
            texts[DiagnosticCode.KEY_CHECK_FAULT] = text
        return [Diagnostic(code, "", text) for code, text in texts.items() if text]

"""Creates the parts of the service that use the autopilot's link: session, link, obstacle output and guard."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from core.types import AttitudeSample, PoseSample
from drivers.mavlink.address import parse_address
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.signing import Signing

from ..autopilot.session_factory import params_of
from ..cameras.supervisor import CameraSupervisor
from ..config.loader import Config
from ..paths import Folders

if TYPE_CHECKING:
    from ..autopilot.last_values import LastValuesFile
    from ..autopilot.obstacle_output import ObstacleOutput
    from ..guard.guard import Guard
    from ..share.share_service import ShareService


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCallbacks:
    """Receivers of the data of the link, called in its thread."""

    samples: Callable[[list[AttitudeSample | PoseSample]], None]
    message: Callable[[Any, int], None]
    # gets MAVLink messages as received, with the time of arrival in ns; None: they are not recorded
    raw: Callable[[bytes, int], None] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotParts:
    """None: not configured."""

    session: MavlinkSession | None = None
    link: MavlinkLink | None = None
    obstacle_output: ObstacleOutput | None = None
    guard: Guard | None = None

    def clock(self) -> tuple[ClockEstimate, int]:
        """The estimate of the autopilot's clock, and its restarts."""
        if self.session is None:
            return ClockEstimate(ClockSource.NONE), 0
        return self.session.clock.estimate, self.session.clock.restarts

    def armed(self) -> bool | None:
        """Whether the vehicle is armed; None: not known."""
        return None if self.session is None else self.session.own.armed(time.monotonic_ns())


def make_autopilot(
    config: Config,
    folders: Folders,
    cameras: Mapping[str, CameraSupervisor],
    signing: Signing,
    share: ShareService | None,
    callbacks: LinkCallbacks,
) -> AutopilotParts:
    """The parts that the configuration asks for; none without `[autopilot] address`. Obstacle output and guard are imported
    only where they are enabled."""
    if not config.autopilot.address:
        return AutopilotParts()
    reads: frozenset[int] = frozenset() if share is None else share.reads
    last: LastValuesFile | None = None
    if config.avoid.send:
        from ..autopilot.last_values import LastValuesFile
        from ..autopilot.obstacle_output import READS

        reads, last = reads | READS, LastValuesFile(folders.state)
        if config.guard.enabled:
            from ..guard.guard import READS as GUARD_READS

            reads |= GUARD_READS
    session = MavlinkSession(
        params_of(config),
        on_frame=callbacks.raw,
        signing=signing,
        reads=reads,
        on_message=callbacks.message if reads else None,
        expected=None if last is None else last.expected(),
        on_foreign=None if share is None else share.foreign,
        foreign_ids=frozenset() if share is None else share.foreign_reads,
    )
    link = MavlinkLink(parse_address(config.autopilot.address), session, callbacks.samples)
    if last is None:
        return AutopilotParts(session=session, link=link)
    from ..autopilot.line import line_of
    from ..autopilot.obstacle_output import ObstacleOutput, camera_use

    line, guard = line_of(session, link), None
    if config.guard.enabled:
        from ..guard.guard import Guard

        guard = Guard(config.guard, config.avoid, line, link.status, folders.state)
    observer = None if guard is None else guard.observe
    obstacle_output = ObstacleOutput(config.avoid, camera_use(config, cameras, observer), line, last)
    return AutopilotParts(session=session, link=link, obstacle_output=obstacle_output, guard=guard)

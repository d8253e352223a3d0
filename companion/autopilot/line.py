"""The autopilot at the other end of a link, as the obstacle output and the guard use it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import Vehicle


def _no_commands(message: Any, decided_by: Vehicle) -> None:
    raise RuntimeError("no command is sent on this line: it was created without `command`")


@dataclass(frozen=True, slots=True)
class AutopilotLine:
    """The line to one autopilot. Its functions may be called from any thread."""

    vehicle: Callable[[], Vehicle | None]  # returns the autopilot that is received now; None: none
    post: Callable[[Any], None]  # sends a message to it
    # returns an autopilot that is not received any more, as OwnVehicle.fell_silent says; None: none. It may still receive.
    silent: Callable[[], Vehicle | None] = lambda: None
    # sends a command that was decided by this state of the vehicle, unless a newer one contradicts it at the moment of
    # sending
    command: Callable[[Any, Vehicle], None] = _no_commands


def line_of(session: MavlinkSession, link: MavlinkLink) -> AutopilotLine:
    """Returns the line of a link. session: of the link."""

    def vehicle() -> Vehicle | None:
        return session.vehicle if session.connected(time.monotonic_ns()) else None

    def silent() -> Vehicle | None:
        return session.vehicle if session.own.fell_silent(time.monotonic_ns()) else None

    return AutopilotLine(vehicle, link.post, silent, link.post)

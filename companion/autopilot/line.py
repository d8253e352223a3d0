"""The autopilot at the other end of a link, as the obstacle output and the guard use it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import Vehicle


@dataclass(frozen=True, slots=True)
class AutopilotLine:
    """The line to one autopilot. Its functions may be called from any thread.

    Attributes:
        vehicle: returns the autopilot that is received now; None: none.
        post: sends a message to it.
        silent: returns an autopilot in flight that is not received any more; None: none. It may still receive.
        post_decided: sends a message that was decided by this state of the vehicle, unless a newer one contradicts it at the
            moment of sending; None: `command` compares them when it posts."""

    vehicle: Callable[[], Vehicle | None]
    post: Callable[[Any], None]
    silent: Callable[[], Vehicle | None] = lambda: None
    post_decided: Callable[[Any, Vehicle], None] | None = None

    def command(self, message: Any, decided_by: Vehicle) -> None:
        """Sends a command that was decided by this state of the vehicle, unless a newer one contradicts it."""
        if self.post_decided is not None:
            self.post_decided(message, decided_by)
            return
        vehicle = self.vehicle()
        if vehicle is not None and not vehicle.contradicts(decided_by):
            self.post(message)


def line_of(session: MavlinkSession, link: MavlinkLink) -> AutopilotLine:
    """Returns the line of a link. session: of the link."""

    def vehicle() -> Vehicle | None:
        return session.vehicle if session.connected(time.monotonic_ns()) else None

    def silent() -> Vehicle | None:
        return session.vehicle if session.fell_silent(time.monotonic_ns()) else None

    return AutopilotLine(vehicle, link.post, silent, link.post)

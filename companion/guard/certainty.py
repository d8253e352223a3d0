"""Certainty that a command of the guard reaches the right vehicle, and no other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from drivers.mavlink.commands import REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, request_message, set_message_interval
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import PX4, Vehicle

from .modes import MULTICOPTERS, STOP_ORDER

NS = 1_000_000_000
HEARTBEAT_HZ: Final = 5.0
"""Requested of the autopilot, so that a change of mode is known within 0.2 s. An autopilot that keeps 1 Hz is used as
well. PX4 never changes this rate, but sends a single heartbeat on request: while it is armed, each one is requested."""
LONGEST_HEARTBEAT_NS: Final = 2_500_000_000
FIRST_WAIT_NS: Final = NS
LONGEST_WAIT_NS: Final = 10 * NS
POLL_NS: Final = round(NS / HEARTBEAT_HZ)
AGAIN_NS: Final = 3 * NS
"""Interval of the request while it is acknowledged; otherwise FIRST_WAIT_NS."""
REACHED_NS: Final = 8 * NS
"""Time for which an acknowledgement counts; six requests are sent in it."""
CONFLICTS: Final = ("two autopilots", "two clocks", "two services", "several vehicles")
"""Topics of drivers.mavlink.conflicts that make it uncertain who receives a command, or whose answer arrives."""
_REQUESTS: Final = frozenset({SET_MESSAGE_INTERVAL, REQUEST_MESSAGE})
_ANSWERS: Final = frozenset({dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_UNSUPPORTED, dialect.MAV_RESULT_FAILED})
"""Results by which the command was received, which is all that matters here. PX4 answers a
request for the rate of its heartbeat with FAILED (MavlinkReceiver::set_message_interval)."""


@dataclass(slots=True)
class Certainty:
    """Requests more frequent heartbeats; the COMMAND_ACK shows that commands arrive and that answers come back."""

    _who: tuple[int, str] = (0, "")
    _reached_ns: int | None = None
    _next_ns: int = 0
    _wait_ns: int = FIRST_WAIT_NS

    def acknowledged(self, command: int, result: int, now_ns: int) -> None:
        """Handles a COMMAND_ACK of the vehicle for the service."""
        if command in _REQUESTS and result in _ANSWERS:
            self._reached_ns = now_ns

    def requests(self, vehicle: Vehicle, now_ns: int) -> list[Any]:
        """Returns the request to send now, if any. After a change of the vehicle it must be acknowledged again."""
        who = (vehicle.system_id, vehicle.autopilot)
        if who != self._who:
            self._who, self._reached_ns, self._next_ns = who, None, now_ns
            self._wait_ns = FIRST_WAIT_NS
        if vehicle.autopilot not in STOP_ORDER or now_ns < self._next_ns:
            return []
        if self._reached_ns is None:
            self._next_ns = now_ns + self._wait_ns
            self._wait_ns = min(2 * self._wait_ns, LONGEST_WAIT_NS)
        elif vehicle.autopilot == PX4 and vehicle.armed:
            self._next_ns = now_ns + POLL_NS
        else:
            self._next_ns = now_ns + (AGAIN_NS if now_ns - self._reached_ns <= AGAIN_NS else FIRST_WAIT_NS)
        if vehicle.autopilot == PX4:
            return [request_message(vehicle.system_id, dialect.MAVLINK_MSG_ID_HEARTBEAT)]
        return [set_message_interval(vehicle.system_id, dialect.MAVLINK_MSG_ID_HEARTBEAT, HEARTBEAT_HZ)]

    def silent(self, now_ns: int) -> bool:
        """True if the vehicle acknowledged commands before and does not any more, so that commands may not arrive.

        This is no doubt about who receives them."""
        return self._reached_ns is not None and now_ns - self._reached_ns > REACHED_NS

    def doubt(self, vehicle: Vehicle, conflicts: Mapping[str, str], signing_fault: str, now_ns: int) -> str:
        """Returns why it is not certain, in a few words; empty: it is."""
        if any(conflicts.get(topic) for topic in CONFLICTS):
            return next(topic for topic in CONFLICTS if conflicts.get(topic))
        if vehicle.autopilot not in STOP_ORDER:
            return "autopilot kind unknown"
        if vehicle.vehicle_type not in MULTICOPTERS:
            return "not a multicopter"
        if now_ns - vehicle.heartbeat_ns > LONGEST_HEARTBEAT_NS:
            return "no heartbeat"
        if signing_fault:
            return "message signing fault"
        return "commands are not acknowledged" if self._reached_ns is None else ""

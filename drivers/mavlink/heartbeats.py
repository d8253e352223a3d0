"""When a heartbeat of the autopilot was sent: copies that arrive late, and messages that have waited in a buffer."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

from .dialect import dialect
from .session_types import Vehicle

NS = 1_000_000_000
PAUSE_NS = NS * 15 // 10
"""After a longer time without a read the process may have been stopped: the link is read each 0.11 s or more often, and heartbeats
arrive once a second or more often."""
EMPTIED_NS = NS // 2
"""For this time after a pause what is read may have waited in a buffer. The kernel fills it with the oldest messages and drops the
newest."""
LATE_COPY_NS, _MOST = 10_000_000_000, 64
"""A network or a second route may deliver a heartbeat again for this long; greatest number of heartbeats that are kept for it."""


NO_VEHICLES = frozenset(
    {
        dialect.MAV_TYPE_ANTENNA_TRACKER,
        dialect.MAV_TYPE_GCS,
        dialect.MAV_TYPE_ONBOARD_CONTROLLER,
        dialect.MAV_TYPE_GIMBAL,
        dialect.MAV_TYPE_ADSB,
        dialect.MAV_TYPE_CAMERA,
        dialect.MAV_TYPE_CHARGING_STATION,
        dialect.MAV_TYPE_FLARM,
        dialect.MAV_TYPE_SERVO,
        dialect.MAV_TYPE_ODID,
        dialect.MAV_TYPE_BATTERY,
        dialect.MAV_TYPE_PARACHUTE,
        dialect.MAV_TYPE_LOG,
        dialect.MAV_TYPE_OSD,
        dialect.MAV_TYPE_IMU,
        dialect.MAV_TYPE_GPS,
        dialect.MAV_TYPE_WINCH,
    }
)
"""MAV_TYPE of what does not fly, and may nevertheless have component 1. ArduPilot's antenna tracker has an attitude of its own."""


def is_of_a_vehicle(heartbeat: Any) -> bool:
    """Returns whether a HEARTBEAT is of the autopilot of a vehicle."""
    is_autopilot = heartbeat.autopilot != dialect.MAV_AUTOPILOT_INVALID and int(heartbeat.type) not in NO_VEHICLES
    return bool(is_autopilot and heartbeat.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1)


class Heartbeats:
    """The accepted heartbeats, byte by byte."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=_MOST)

    def add(self, data: bytes, arrival_ns: int) -> None:
        """Keeps an accepted heartbeat."""
        self._kept.append((arrival_ns, data))

    def is_late_copy(self, data: bytes, new: Vehicle, old: Vehicle | None) -> bool:
        """Returns whether a heartbeat was received before, byte by byte, and would bring its state back. new: the vehicle by this
        heartbeat; old: by the one before; None: there is none.

        Each message of an autopilot has the next number of 256, so that a true return to an earlier state is hardly ever such a
        copy; the next heartbeat then shows it."""
        if old is None or replace(new, heartbeat_ns=old.heartbeat_ns) == old:
            return False
        since_ns = new.heartbeat_ns - LATE_COPY_NS
        return any(data == before and at_ns > since_ns for at_ns, before in self._kept)


class Arrivals:
    """Instants between which a message has arrived. A read after a pause also returns what arrived during the pause."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None  # newest read with bytes
        self._before_ns = 0  # newest read before the pause
        self._until_ns = 0  # what is read until then may have arrived during the pause

    def earliest_ns(self, read_ns: int) -> int:
        """Returns the earliest instant at which bytes that are read now can have arrived. Called for each read that returns
        bytes: a link that was silent for longer than PAUSE_NS counts as a pause too, so that the instant is too early, never
        too late."""
        newest_ns, self._newest_ns = self._newest_ns, read_ns
        if newest_ns is not None and read_ns - newest_ns > PAUSE_NS:
            if newest_ns >= self._until_ns:  # otherwise the buffer may still hold messages of the pause before
                self._before_ns = newest_ns
            self._until_ns = read_ns + EMPTIED_NS
        return self._before_ns if read_ns < self._until_ns else read_ns

"""Which autopilot is that of the own vehicle, by its newest heartbeat, and whether it is received.

Without a configured system id it is the one that is received first, until the service is started again: the own one may fall
silent and still receive, and must get no obstacles by the attitude of another one."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

from .anomalies import LinkAnomaly
from .clock_bounds import NS
from .conflicts import ConflictDetector
from .dialect import dialect
from .heartbeats import Arrivals, Heartbeats, is_of_a_vehicle
from .parser import MAVLINK1, Frame
from .session_types import ARDUPILOT, PX4, Vehicle

AUTOPILOTS = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: ARDUPILOT, dialect.MAV_AUTOPILOT_PX4: PX4}
SILENT_NS = 3 * NS
"""Without messages for this long an autopilot counts as disconnected."""
BROADCAST = 0
"""As target, this system id names all vehicles: an autopilot that uses it could not be commanded alone."""


class OwnVehicle:
    """The own vehicle's autopilot. `arrives` gets the time of each read, `heartbeat` each HEARTBEAT, `received` the time of each message
    of the autopilot. counts: refused heartbeats, by cause."""

    def __init__(self, configured: int, expected: Vehicle | None, conflicts: ConflictDetector) -> None:
        """Begins without a received autopilot.

        Args:
            configured: the only accepted system id; 0: any.
            expected: the autopilot of the last run, which counts before its first heartbeat.
            conflicts: gets the vehicles that may be the own one."""
        self.vehicle: Vehicle | None = None
        self.counts: Counter[LinkAnomaly] = Counter()
        self._configured, self._conflicts = configured, conflicts
        self._expected = expected
        if expected is not None and (expected.system_id == BROADCAST or configured not in (0, expected.system_id)):
            self._expected = None
        self._received_ns = 0
        self._heartbeats = Heartbeats()
        self._arrivals = Arrivals()
        self._earliest_ns = 0  # at which what is read now can have arrived

    def arrives(self, arrival_ns: int) -> None:
        """Takes the time of a read that returns bytes."""
        self._earliest_ns = self._arrivals.earliest_ns(arrival_ns)

    def recognise(self, frame: Frame) -> None:
        """Makes the expected vehicle the own one if the frame is of its autopilot. In flight its next heartbeat may arrive too late."""
        expected = self._expected
        if expected is None or self.vehicle is not None:
            return
        if (frame.system, frame.component) == (expected.system_id, dialect.MAV_COMP_ID_AUTOPILOT1):
            self._expected, self.vehicle = None, expected

    def is_source(self, message: Any) -> bool:
        """Returns whether a frame or message is of the own autopilot."""
        v = self.vehicle
        return (
            v is not None
            and message.get_srcSystem() == v.system_id
            and message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1
        )

    def received(self, arrival_ns: int) -> None:
        """Notes a message of the own autopilot."""
        self._received_ns = arrival_ns

    def heartbeat(self, m: Any, arrival_ns: int) -> None:
        """Takes a HEARTBEAT."""
        system = m.get_srcSystem()
        if not is_of_a_vehicle(m):
            return
        if system == BROADCAST:
            self.counts[LinkAnomaly.OTHER_VEHICLE] += 1
            return
        if self._configured not in (0, system):
            self._conflicts.left_out(system, arrival_ns)
            self.counts[LinkAnomaly.OTHER_VEHICLE] += 1
            return
        kind = AUTOPILOTS.get(int(m.autopilot), f"autopilot {int(m.autopilot)}")
        self._conflicts.vehicle(system, kind, arrival_ns)
        old = self.vehicle
        if old is not None and old.system_id != system:
            self._conflicts.still_counts(old.system_id, old.autopilot, arrival_ns)
            self.vehicle = replace(old, autopilot=self._conflicts.kind_of_all(old.autopilot, arrival_ns))
            self.counts[LinkAnomaly.OTHER_VEHICLE] += 1
            return
        data = bytes(m.get_msgbuf())
        vehicle = Vehicle(
            system,
            self._conflicts.kind(kind, arrival_ns),
            int(m.type),
            bool(int(m.base_mode) & dialect.MAV_MODE_FLAG_SAFETY_ARMED),
            int(m.custom_mode),
            self._earliest_ns,
            data[0] == MAVLINK1,
            int(m.system_status),
        )
        if self._heartbeats.is_late_copy(data, vehicle, old):
            self.counts[LinkAnomaly.LATE_HEARTBEAT] += 1
        else:
            self._heartbeats.add(data, arrival_ns)
            self.vehicle = vehicle

    def connected(self, now_ns: int) -> bool:
        """True if any message of the autopilot arrived recently. On a bad link, single heartbeats are lost too easily."""
        return self.vehicle is not None and now_ns - self._received_ns < SILENT_NS

    def armed(self, now_ns: int) -> bool | None:
        """Whether the vehicle is armed; None: not known. A silent autopilot may have been armed since."""
        if self.vehicle is None or (not self.vehicle.armed and not self.connected(now_ns)):
            return None
        return self.vehicle.armed

    def fell_silent(self, now_ns: int) -> bool:
        """True if the autopilot is not received any more, and was armed at its last message or may not be the own one, which may be
        armed. The own one may still receive."""
        v = self.vehicle
        return v is not None and not self.connected(now_ns) and (v.armed or self._conflicts.several_vehicles(now_ns))

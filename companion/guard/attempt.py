"""One attempt to stop the vehicle: the command, its acknowledgement, and whether a heartbeat shows its effect."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mavlink.session_types import Vehicle

from .modes import StopMethod
from .speed_limit import ACCEPTED, IN_PROGRESS

NS = 1_000_000_000
ACK_NS = NS * 4 // 10
"""An attempt without COMMAND_ACK is repeated after this time."""
MODE_NS = NS * 15 // 10
"""An acknowledged attempt is repeated if its mode does not appear in a heartbeat within this time: heartbeats may be
sent once a second."""
SETTLE_NS = NS // 2
"""A heartbeat that is this much later than an acknowledged attempt shows its mode, if it had an effect."""


@dataclass(slots=True)
class Attempt:
    """The newest attempt to stop.

    Attributes:
        method: method of the stop.
        command: MAV_CMD.
        t_ns: instant of sending.
        result: MAV_RESULT; None: not acknowledged."""

    method: StopMethod
    command: int
    t_ns: int
    result: int | None = None

    @property
    def refused(self) -> bool:
        """True if the autopilot has refused the command."""
        return self.result not in (None, ACCEPTED, IN_PROGRESS)

    def shown_without_effect(self, vehicle: Vehicle) -> bool:
        """True if a heartbeat is late enough to show an effect. The caller has compared the mode."""
        return vehicle.heartbeat_ns - self.t_ns >= SETTLE_NS

"""One attempt to stop the vehicle: what was sent, what was answered, and what a heartbeat shows of it."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mavlink.session_types import Vehicle

from .modes import StopMethod
from .speed_limit import ACCEPTED, IN_PROGRESS

NS = 1_000_000_000
ACK_NS = NS * 4 // 10
"""An attempt without COMMAND_ACK is repeated after this time."""
MODE_NS = NS * 15 // 10
"""An acknowledged attempt whose mode does not appear in a heartbeat is repeated after this time: heartbeats may come once a second."""
SETTLE_NS = NS // 2
"""A heartbeat so much later than an acknowledged attempt shows its mode, if it had an effect."""


@dataclass(slots=True)
class Attempt:
    """The newest attempt to stop. result: MAV_RESULT, None: not acknowledged."""

    method: StopMethod
    command: int
    t_ns: int
    result: int | None = None

    @property
    def refused(self) -> bool:
        """Whether the autopilot has answered that it does not do it."""
        return self.result not in (None, ACCEPTED, IN_PROGRESS)

    def shown_without_effect(self, vehicle: Vehicle) -> bool:
        """Whether a heartbeat is late enough to show the effect. The caller has compared the mode."""
        return vehicle.heartbeat_ns - self.t_ns >= SETTLE_NS

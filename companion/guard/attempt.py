"""One attempt to stop the vehicle: its command, when it counts as without effect, and the command of the next one."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mavlink.session_types import ARDUPILOT, Vehicle

from .modes import STOP_MODES, STOP_ORDER, StopMethod
from .speed_limit import ACCEPTED, IN_PROGRESS

NS = 1_000_000_000
ACK_NS = NS * 4 // 10
"""An attempt without COMMAND_ACK is repeated after this time."""
MODE_NS = NS * 15 // 10
"""An acknowledged attempt is repeated if its mode does not appear in a heartbeat within this time: heartbeats may be
sent once a second."""
SETTLE_NS = NS // 2
"""A heartbeat that is this much later than an acknowledged attempt shows its mode, if it had an effect."""
FIRST_METHOD_TIMES = 2
"""ArduCopter: number of attempts with BRAKE before LOITER."""
FAILED_AFTER = 3
"""Attempts without effect until the failure is announced. Further attempts follow, one per MODE_NS."""


@dataclass(slots=True)
class Attempt:
    """The newest attempt to stop."""

    method: StopMethod  # method of the stop
    command: int  # MAV_CMD
    t_ns: int  # instant of sending
    result: int | None = None  # MAV_RESULT; None: not acknowledged

    @property
    def refused(self) -> bool:
        """True if the autopilot has refused the command."""
        return self.result not in (None, ACCEPTED, IN_PROGRESS)

    def shown_without_effect(self, vehicle: Vehicle) -> bool:
        """True if a heartbeat is late enough to show an effect. The caller has compared the mode."""
        return vehicle.heartbeat_ns - self.t_ns >= SETTLE_NS

    def is_over(self, vehicle: Vehicle, now_ns: int, attempts: int) -> bool:
        """True if the attempt had no effect, so that the next one is due. attempts: number of attempts so far."""
        waited_ns = now_ns - self.t_ns
        if attempts >= FAILED_AFTER:
            return waited_ns >= MODE_NS
        if self.result is None:
            return waited_ns >= ACK_NS
        if self.result in (ACCEPTED, IN_PROGRESS):
            return waited_ns >= MODE_NS or self.shown_without_effect(vehicle)
        return True  # refused: the next attempt follows at once


def next_method(vehicle: Vehicle, last: Attempt | None, attempts: int) -> StopMethod:
    """Returns the method of the next attempt. last: the newest attempt; attempts: number of attempts so far.

    PX4 alternates between both methods. ArduCopter's LOITER reads the throttle stick, which may be low. It is used only
    after two attempts with BRAKE and evidence that the last one had no effect. Lost acknowledgements and heartbeats are
    no such evidence."""
    first, second = STOP_ORDER[vehicle.autopilot]
    if vehicle.autopilot != ARDUPILOT:
        return second if attempts % 2 else first
    if last is None or last.method is not first or vehicle.custom_mode == STOP_MODES[first]:
        return first
    failed = last.refused or last.shown_without_effect(vehicle)
    return second if failed and attempts >= FIRST_METHOD_TIMES else first

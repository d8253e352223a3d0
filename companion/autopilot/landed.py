"""Detects that the vehicle is on the ground, from EXTENDED_SYS_STATE and the arming state.

On the ground a camera a few centimetres above grass or gravel shows obstacles close to it, and ArduPilot refuses to
arm if anything is nearer than 0.6 m. On the ground such distances are therefore sent as "not seen": the artificial
wall for ArduPilot, unknown for PX4. They are never sent as clear."""

from __future__ import annotations

from typing import Any, Final

from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle

NS: Final = 1_000_000_000
NEAR_GROUND: Final = frozenset({dialect.MAV_LANDED_STATE_TAKEOFF, dialect.MAV_LANDED_STATE_LANDING})
FRESH_NS: Final = 3 * NS


class LandedState:
    """State of landing. `take` gets every message of the autopilot. The state is one tuple, which may be read from
    another thread."""

    def __init__(self) -> None:
        self._newest: tuple[int, int] = (0, 0)  # landed_state, instant

    def take(self, message: Any, now_ns: int) -> None:
        """Handles EXTENDED_SYS_STATE and ignores other messages."""
        if message.get_type() == "EXTENDED_SYS_STATE":
            self._newest = (int(message.landed_state), now_ns)

    def on_ground(self, vehicle: Vehicle, now_ns: int) -> bool:
        """True if the vehicle is on the ground. An autopilot that does not report it is on the ground while disarmed."""
        state, at_ns = self._newest
        if state != dialect.MAV_LANDED_STATE_UNDEFINED and now_ns - at_ns <= FRESH_NS:
            return bool(state == dialect.MAV_LANDED_STATE_ON_GROUND)
        return not vehicle.armed

    def takes_off_or_lands(self, now_ns: int) -> bool:
        """True if the autopilot reports that the vehicle takes off or lands."""
        state, at_ns = self._newest
        return state in NEAR_GROUND and now_ns - at_ns <= FRESH_NS

"""Flight modes that the guard watches, and modes by which it stops the vehicle. Numbers are custom_mode of HEARTBEAT."""

from __future__ import annotations

from enum import StrEnum
from typing import Final

from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER, PX4_AUTO, PX4_AUTO_LOITER, px4_mode_number
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from ..config.guard import GuardParams

MULTICOPTERS: Final = frozenset({2, 3, 13, 14, 15, 29, 35})
"""MAV_TYPE quadrotor, coaxial, hexarotor, octorotor, tricopter, dodecarotor and decarotor. The numbers of modes below
are those of multicopters: mode 17 of ArduPlane is a different mode."""


class Watched(StrEnum):
    """Groups of modes in which the autopilot flies by itself."""

    MISSION = "mission"
    RETURN = "return"
    GUIDED = "guided"


class StopMethod(StrEnum):
    """Commands that stop the vehicle."""

    PX4_HOLD = "px4_hold"
    PX4_REPOSITION = "px4_reposition"
    COPTER_BRAKE = "copter_brake"
    COPTER_LOITER = "copter_loiter"


_PX4_WATCHED = {
    px4_mode_number(PX4_AUTO, 4): Watched.MISSION,
    px4_mode_number(PX4_AUTO, 5): Watched.RETURN,
    px4_mode_number(6, 0): Watched.GUIDED,
}
_COPTER_WATCHED = {
    3: Watched.MISSION,
    27: Watched.RETURN,  # AUTO_RTL
    6: Watched.RETURN,
    21: Watched.RETURN,  # SMART_RTL
    4: Watched.GUIDED,
}
STOP_MODES: Final = {
    StopMethod.PX4_HOLD: px4_mode_number(PX4_AUTO, PX4_AUTO_LOITER),
    StopMethod.PX4_REPOSITION: px4_mode_number(PX4_AUTO, PX4_AUTO_LOITER),
    StopMethod.COPTER_BRAKE: COPTER_BRAKE,
    StopMethod.COPTER_LOITER: COPTER_LOITER,
}
"""custom_mode after each command."""
STOP_ORDER: Final = {
    PX4: (StopMethod.PX4_HOLD, StopMethod.PX4_REPOSITION),
    ARDUPILOT: (StopMethod.COPTER_BRAKE, StopMethod.COPTER_LOITER),
}
"""First and second stop command; `attempt.next_method` chooses between them."""
FAILSAFE_STATES: Final = frozenset({5, 6})
"""MAV_STATE CRITICAL and EMERGENCY: a failsafe is active."""


def watched_mode(kind: str, custom_mode: int, guard: GuardParams) -> Watched | None:
    """Returns the group of a mode if the configuration lets the guard act in it; None otherwise, as in all modes that
    a pilot flies."""
    group = {PX4: _PX4_WATCHED, ARDUPILOT: _COPTER_WATCHED}.get(kind, {}).get(custom_mode)
    active = {Watched.MISSION: guard.mission, Watched.RETURN: guard.return_home, Watched.GUIDED: guard.guided}
    return group if group is not None and active[group] else None


def takes_speed(kind: str, group: Watched) -> bool:
    """True if MAV_CMD_DO_CHANGE_SPEED has an effect: not in PX4's Offboard mode, which follows the setpoints that it
    receives."""
    return not (kind == PX4 and group is Watched.GUIDED)


def returns_by_failsafe(vehicle: Vehicle | None, guard: GuardParams) -> bool:
    """True if the heartbeat shows that a failsafe has commanded a return."""
    if vehicle is None or vehicle.system_status not in FAILSAFE_STATES:
        return False
    return watched_mode(vehicle.autopilot, vehicle.custom_mode, guard) is Watched.RETURN

"""What the autopilot does with obstacles, and with the failsafe, in each flight mode.

The values sent are the same in each mode: the mode is known up to a second late, and a mode that brakes may be chosen
at any moment. Modes and path planners that do not brake are reported. Sources: documentation and code of the
autopilots; LOITER was measured."""

from __future__ import annotations

from enum import StrEnum

from drivers.mavlink.commands import PX4_AUTO, px4_main_and_sub
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from .parameter_advice import AutopilotFacts, position_mode_fault


class Effect(StrEnum):
    """What a mode does before an obstacle, the artificial wall, or a sector without data."""

    BRAKES = "brakes"
    STANDS = "does not move"
    LEANS = "leans away from near obstacles, the pilot can override it"
    TARGETS = "limits velocity targets, not position targets"
    PLANS = "plans around obstacles, and when blind may plan around the artificial wall into unobserved space"
    WRONG_MODE = "does not brake with this MPC_POS_MODE"
    NOTHING = "does not brake"
    UNKNOWN = "is not known to brake"


_COPTER = {
    0: ("STABILIZE", Effect.NOTHING), 1: ("ACRO", Effect.NOTHING), 2: ("ALT_HOLD", Effect.LEANS),
    3: ("AUTO", Effect.NOTHING), 4: ("GUIDED", Effect.TARGETS), 5: ("LOITER", Effect.BRAKES), 6: ("RTL", Effect.NOTHING),
    7: ("CIRCLE", Effect.NOTHING), 9: ("LAND", Effect.NOTHING), 11: ("DRIFT", Effect.NOTHING),
    13: ("SPORT", Effect.NOTHING), 16: ("POSHOLD", Effect.NOTHING), 17: ("BRAKE", Effect.STANDS),
    20: ("GUIDED_NOGPS", Effect.NOTHING), 21: ("SMART_RTL", Effect.NOTHING), 22: ("FLOWHOLD", Effect.LEANS),
    23: ("FOLLOW", Effect.BRAKES), 24: ("ZIGZAG", Effect.BRAKES),
}  # fmt: skip
_COPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
"""MAV_TYPE of ArduCopter and of PX4's multicopters: quadrotor to decarotor, and helicopter. Others do not brake as described here, and
ArduPilot's numbers of modes mean other modes there."""
_PLANNED = ("AUTO", "GUIDED", "RTL")
"""Modes in which a path planner (OA_TYPE) works."""
_PX4 = {
    1: ("Manual", Effect.NOTHING),
    2: ("Altitude", Effect.NOTHING),
    3: ("Position", Effect.BRAKES),
    5: ("Acro", Effect.NOTHING),
    6: ("Offboard", Effect.NOTHING),
    7: ("Stabilized", Effect.NOTHING),
}
_PX4_AUTO = {
    1: ("Ready", Effect.STANDS),
    2: ("Takeoff", Effect.NOTHING),
    3: ("Hold", Effect.STANDS),
    4: ("Mission", Effect.NOTHING),
    5: ("Return", Effect.NOTHING),
    6: ("Land", Effect.NOTHING),
    8: ("Follow", Effect.NOTHING),
}


def mode_of(vehicle: Vehicle, facts: AutopilotFacts) -> tuple[str, Effect]:
    """Returns (name, effect) of the mode in the newest heartbeat."""
    number = vehicle.custom_mode
    copter = vehicle.vehicle_type in _COPTERS
    if vehicle.autopilot == PX4:
        main, sub = px4_main_and_sub(number)
        known = _PX4_AUTO.get(sub) if main == PX4_AUTO else _PX4.get(main)
        name, effect = known or (f"mode {main}.{sub}" if number else "mode not reported", Effect.UNKNOWN)
        if effect is Effect.BRAKES and facts.version is not None and position_mode_fault(facts):
            effect = Effect.WRONG_MODE
        return name, effect if copter else Effect.UNKNOWN
    if vehicle.autopilot == ARDUPILOT and copter:
        name, effect = _COPTER.get(number, (f"mode {number}", Effect.UNKNOWN))
        if name in _PLANNED and facts.values.get("OA_TYPE", 0.0) > 0.0:
            effect = Effect.PLANS
        return name, effect
    return f"mode {number}", Effect.UNKNOWN


def mode_name(vehicle: Vehicle) -> str:
    """Returns the name of the mode in the newest heartbeat."""
    return mode_of(vehicle, AutopilotFacts(kind=vehicle.autopilot))[0]


def mode_fault(vehicle: Vehicle, facts: AutopilotFacts) -> str:
    """Returns why the mode of an armed vehicle does not stop before obstacles and when blind, as text; empty: it
    does.

    The part before the colon is short enough for the ground station."""
    name, effect = mode_of(vehicle, facts)
    if not vehicle.armed or effect in (Effect.BRAKES, Effect.STANDS):
        return ""
    if vehicle.vehicle_type not in _COPTERS:
        return f"{name} {effect}: the vehicle is not a multicopter (MAV_TYPE {vehicle.vehicle_type})"
    if effect is Effect.WRONG_MODE:
        return f"{name} does not brake: {position_mode_fault(facts)}"
    where = "Position mode" if vehicle.autopilot == PX4 else "LOITER"
    if effect is Effect.PLANS:
        return (
            f"{name} plans around obstacles: when blind also around the artificial wall, into unobserved space; not tested; "
            f"{where} stops"
        )
    if effect is Effect.LEANS:
        return f"{name} only leans away from obstacles: the pilot can override it; {where} stops"
    if effect is Effect.TARGETS:
        unread = "" if "OA_TYPE" in facts.values else "; whether a path planner works (OA_TYPE) is not known"
        creeps = ""
        if facts.values.get("AVOID_ACCEL_MAX", 3.0) > 0.0:
            creeps = "; with fewer than 10 targets a second it may creep up to obstacles, unless AVOID_ACCEL_MAX = 0"
        flies = "with position targets it flies on, also when blind"
        return f"{name} brakes velocity targets alone: {flies}; {where} stops{unread}{creeps}"
    unread = "; or a path planner flies around: OA_TYPE is not known"
    planned = vehicle.autopilot == ARDUPILOT and name in _PLANNED and "OA_TYPE" not in facts.values
    return f"{name} {effect}: neither before obstacles nor when blind; {where} stops{unread if planned else ''}"

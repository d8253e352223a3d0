"""What the autopilot does with obstacles, and with the failsafe, in each flight mode.

The values sent are the same in each mode: the mode is known up to a second late, and a mode that brakes may be chosen
at any moment. Modes and path planners that do not brake are reported. Sources: documentation and code of the
autopilots (PX4: px4_custom_mode.h, FlightModeManager.cpp; ArduCopter: mode_*.cpp, AC_WPNav_OA.cpp); LOITER was
measured."""

from __future__ import annotations

from enum import StrEnum

from drivers.mavlink.commands import PX4_AUTO, px4_main_and_sub
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from .ardupilot_advice import BENDY_RULER
from .firmware_version import COPTER_FOLLOWS_POSITIONS, PX4_ACCELERATION_MODE
from .parameter_fault import AutopilotFacts
from .px4_advice import position_mode_fault


class Effect(StrEnum):
    """What a mode does before an obstacle, the artificial wall, or a sector without data."""

    BRAKES = "brakes"
    STANDS = "does not move"
    LEANS = "leans away from near obstacles, the pilot can override it"
    STICK = "brakes for the pilot's stick alone"
    TARGETS = "limits level velocity targets, not those of position, acceleration or attitude"
    LEVEL = "brakes in level flight alone"
    PLANS = "plans around obstacles, and when blind may plan around the artificial wall into unobserved space"
    WRONG_MODE = "does not brake with this MPC_POS_MODE"
    NOTHING = "does not brake"
    UNKNOWN = "is not known to brake"


_FOLLOW = 23
_COPTER = {
    0: ("STABILIZE", Effect.NOTHING), 1: ("ACRO", Effect.NOTHING), 2: ("ALT_HOLD", Effect.LEANS),
    3: ("AUTO", Effect.NOTHING), 4: ("GUIDED", Effect.TARGETS), 5: ("LOITER", Effect.BRAKES), 6: ("RTL", Effect.NOTHING),
    7: ("CIRCLE", Effect.NOTHING), 9: ("LAND", Effect.NOTHING), 11: ("DRIFT", Effect.NOTHING),
    13: ("SPORT", Effect.NOTHING), 14: ("FLIP", Effect.NOTHING), 15: ("AUTOTUNE", Effect.NOTHING),
    16: ("POSHOLD", Effect.NOTHING), 17: ("BRAKE", Effect.STANDS), 18: ("THROW", Effect.NOTHING),
    19: ("AVOID_ADSB", Effect.LEVEL), 20: ("GUIDED_NOGPS", Effect.NOTHING), 21: ("SMART_RTL", Effect.NOTHING),
    22: ("FLOWHOLD", Effect.LEANS), _FOLLOW: ("FOLLOW", Effect.UNKNOWN), 24: ("ZIGZAG", Effect.STICK),
    25: ("SYSTEMID", Effect.NOTHING), 26: ("AUTOROTATE", Effect.NOTHING), 27: ("AUTO_RTL", Effect.NOTHING),
    28: ("TURTLE", Effect.NOTHING),
}  # fmt: skip
_COPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
"""MAV_TYPE of ArduCopter and of PX4's multicopters: quadrotor to decarotor, and helicopter. Others do not brake as described here, and
ArduPilot's numbers of modes mean other modes there."""
_PLANNED = ("AUTO", "RTL", "SMART_RTL", "AUTO_RTL")
"""Modes that fly by the waypoint controller, in which a path planner (OA_TYPE) works. GUIDED does so from 4.1 on only with bit 6 of
GUID_OPTIONS, and only to position targets."""
PX4_POSITION = 3
_SLOW = 2
_PX4 = {
    1: ("Manual", Effect.NOTHING),
    2: ("Altitude", Effect.NOTHING),
    5: ("Acro", Effect.NOTHING),
    6: ("Offboard", Effect.NOTHING),
    7: ("Stabilized", Effect.NOTHING),
    10: ("Termination", Effect.NOTHING),
    11: ("Altitude Cruise", Effect.NOTHING),
}
_PX4_POSITION = {0: ("Position", Effect.BRAKES), 1: ("Orbit", Effect.NOTHING), _SLOW: ("Position Slow", Effect.UNKNOWN)}
"""Sub modes of main mode 3."""
_PX4_AUTO = {
    1: ("Ready", Effect.STANDS),
    2: ("Takeoff", Effect.NOTHING),
    3: ("Hold", Effect.STANDS),
    4: ("Mission", Effect.NOTHING),
    5: ("Return", Effect.NOTHING),
    6: ("Land", Effect.NOTHING),
    8: ("Follow", Effect.NOTHING),
    9: ("Precision Land", Effect.NOTHING),
}


def mode_of(vehicle: Vehicle, facts: AutopilotFacts) -> tuple[str, Effect]:
    """Returns (name, effect) of the mode in the newest heartbeat."""
    number = vehicle.custom_mode
    copter = vehicle.vehicle_type in _COPTERS
    if vehicle.autopilot == PX4:
        name, effect = _px4_mode(number, facts)
        return name, effect if copter else Effect.UNKNOWN
    if vehicle.autopilot == ARDUPILOT and copter:
        name, effect = _COPTER.get(number, (f"mode {number}", Effect.UNKNOWN))
        if number == _FOLLOW and facts.version is not None:
            effect = Effect.NOTHING if facts.version >= COPTER_FOLLOWS_POSITIONS else Effect.LEVEL
        if name in _PLANNED and facts.values.get("OA_TYPE") in BENDY_RULER:
            effect = Effect.PLANS
        return name, effect
    return f"mode {number}", Effect.UNKNOWN


def _px4_mode(number: int, facts: AutopilotFacts) -> tuple[str, Effect]:
    """Returns (name, effect) of a mode of a multicopter. Position Slow is flown by acceleration with every
    MPC_POS_MODE."""
    main, sub = px4_main_and_sub(number)
    sub_modes = {PX4_AUTO: _PX4_AUTO, PX4_POSITION: _PX4_POSITION}.get(main)
    known = _PX4.get(main) if sub_modes is None else sub_modes.get(sub)
    name, effect = known or (f"mode {main}.{sub}" if number else "mode not reported", Effect.UNKNOWN)
    if (main, sub) == (PX4_POSITION, _SLOW) and facts.version is not None:
        effect = Effect.BRAKES if facts.version >= PX4_ACCELERATION_MODE else Effect.NOTHING
    elif effect is Effect.BRAKES and facts.version is not None and position_mode_fault(facts):
        effect = Effect.WRONG_MODE
    return name, effect


def sends_obstacles_back(vehicle: Vehicle, facts: AutopilotFacts) -> bool:
    """Returns whether the autopilot should send the obstacles back now: PX4 evaluates them, and sends its map, only
    armed in Position mode and, from v1.16 on, in Position Slow."""
    if vehicle.autopilot != PX4:
        return True
    main, sub = px4_main_and_sub(vehicle.custom_mode)
    slow = sub == _SLOW and facts.version is not None and facts.version >= PX4_ACCELERATION_MODE
    return vehicle.armed and main == PX4_POSITION and (sub == 0 or slow)


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
    planner = facts.values.get("OA_TYPE")
    if effect is Effect.PLANS:
        return (
            f"{name} plans around obstacles: when blind also around the artificial wall, into unobserved space; not tested; "
            f"{where} stops"
        )
    if effect is Effect.LEANS:
        return f"{name} only leans away from obstacles: the pilot can override it; {where} stops"
    if effect is Effect.STICK:
        legs = "it flies on, also when blind"
        if planner is None:
            legs += ", or a path planner flies around: OA_TYPE is not known"
        elif planner in BENDY_RULER:
            legs = "a path planner (OA_TYPE) flies around obstacles, and when blind around the artificial wall into unobserved space"
        return f"{name} {effect}: on the legs that it flies by itself {legs}; {where} stops"
    if effect is Effect.TARGETS:
        plans = "; whether a path planner works (OA_TYPE) is not known" if planner is None else ""
        if planner in BENDY_RULER:
            plans = "; to position targets a path planner (OA_TYPE) may fly around the artificial wall"
        creeps = ""
        if facts.values.get("AVOID_ACCEL_MAX", 3.0) > 0.0:
            creeps = "; with fewer than 10 targets a second it may creep up to obstacles, unless AVOID_ACCEL_MAX = 0"
        flies = "with other targets, and while it climbs or descends, it flies on, also when blind"
        return f"{name} brakes level velocity targets alone: {flies}; {where} stops{plans}{creeps}"
    if effect is Effect.LEVEL:
        return f"{name} {effect}: while it climbs or descends it flies on, also when blind; {where} stops"
    unread = "; or a path planner flies around: OA_TYPE is not known"
    planned = vehicle.autopilot == ARDUPILOT and name in _PLANNED and "OA_TYPE" not in facts.values
    return f"{name} {effect}: neither before obstacles nor when blind; {where} stops{unread if planned else ''}"

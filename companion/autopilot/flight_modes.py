"""What the autopilot's flight mode makes of what it is told, and so of the policy when blind.

What is sent is the same in each mode: the mode is known a second late, and a mode that brakes may be chosen at any
moment. Where the mode, or a path planner, makes it useless, that is said. By the autopilots' documentation and sources;
LOITER alone was measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from drivers.mavlink.session import Vehicle

PX4, ARDUPILOT = "PX4", "ArduPilot"


class Effect(StrEnum):
    """What becomes of an obstacle, and of the wall or the unknown of a blind camera."""

    BRAKES = "brakes"
    STANDS = "is still by itself"
    LEANS = "leans away from what is near, the pilot may overrule it"
    TARGETS = "limits velocity targets, not position targets"
    PLANS = "goes round obstacles, and when blind may go round the wall of the policy to where nobody looks"
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
_PLANNED = ("AUTO", "GUIDED", "RTL")
"""In which a path planner (OA_TYPE) works."""
_PX4 = {
    1: ("Manual", Effect.NOTHING), 2: ("Altitude", Effect.NOTHING), 3: ("Position", Effect.BRAKES),
    5: ("Acro", Effect.NOTHING), 6: ("Offboard", Effect.NOTHING), 7: ("Stabilized", Effect.NOTHING),
}  # fmt: skip
_PX4_AUTO = {
    1: ("Ready", Effect.STANDS), 2: ("Takeoff", Effect.NOTHING), 3: ("Hold", Effect.STANDS),
    4: ("Mission", Effect.NOTHING), 5: ("Return", Effect.NOTHING), 6: ("Land", Effect.NOTHING),
    8: ("Follow", Effect.NOTHING),
}  # fmt: skip
_PX4_AUTO_MAIN = 4


def mode_of(vehicle: Vehicle, parameters: Mapping[str, float]) -> tuple[str, Effect]:
    """(name, effect) of the mode that its newest heartbeat tells. parameters: those that were read."""
    number = vehicle.custom_mode
    if vehicle.autopilot == PX4:
        main, sub = (number >> 16) & 0xFF, (number >> 24) & 0xFF
        known = _PX4_AUTO.get(sub) if main == _PX4_AUTO_MAIN else _PX4.get(main)
        return known or (f"mode {main}.{sub}", Effect.UNKNOWN)
    if vehicle.autopilot == ARDUPILOT:
        name, effect = _COPTER.get(number, (f"mode {number}", Effect.UNKNOWN))
        if name in _PLANNED and parameters.get("OA_TYPE", 0.0) > 0.0:
            effect = Effect.PLANS
        return name, effect
    return f"mode {number}", Effect.UNKNOWN


def mode_trouble(vehicle: Vehicle, parameters: Mapping[str, float]) -> str:
    """What keeps an armed vehicle in its mode from stopping before obstacles and when blind, in words; empty: nothing. The
    part before the colon is short enough for the ground station."""
    name, effect = mode_of(vehicle, parameters)
    if not vehicle.armed or effect in (Effect.BRAKES, Effect.STANDS):
        return ""
    where = "Position mode" if vehicle.autopilot == PX4 else "LOITER"
    if effect is Effect.PLANS:
        return (
            f"{name} plans round obstacles: when blind, too, round the wall of the policy, to where nobody looks; it was not "
            f"tried; {where} stops"
        )
    if effect is Effect.LEANS:
        return f"{name} only leans away from obstacles: the pilot may overrule it; {where} stops"
    if effect is Effect.TARGETS:
        unread = "" if "OA_TYPE" in parameters else "; whether a path planner works (OA_TYPE) is not known"
        return (
            f"{name} brakes velocity targets alone: with position targets it flies on, blind too; {where} stops{unread}"
        )
    unread = "; or a path planner goes round: OA_TYPE is not known"
    planned = vehicle.autopilot == ARDUPILOT and name in _PLANNED and "OA_TYPE" not in parameters
    return f"{name} {effect}: neither before obstacles nor when blind; {where} stops{unread if planned else ''}"

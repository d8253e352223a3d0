"""Checks that the autopilot points the camera along the path in the modes that the guard watches, and advises what to
set.

The guard stops a vehicle that flies faster than BLIND_SPEED_M_S to where no camera looks. Values and behaviour are
taken from the sources: PX4 FlightTaskAuto::_set_heading_from_mode and multicopter_autonomous_params,
RTL::set_rtl_item up to v1.14 (RTL_HDG_MD was removed after it, PX4 pull request 22731); ArduCopter
Mode::AutoYaw::default_mode, ModeRTL::return_start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from drivers.mavlink.session_types import ARDUPILOT, PX4

from ..autopilot.parameter_fault import AutopilotFacts
from ..config.guard import GuardParams

PX4_YAW_FIRST: Final = 4
"""MPC_YAW_MODE: the vehicle turns to the waypoint, then it flies."""
_PX4_HEADINGS: Final = {
    0: "it turns to the waypoint while it flies, so that it begins a leg to where the camera does not look",
    1: "it points home, and the camera does not look along the path",
    2: "it points away from home, and the camera does not look along the path",
    3: "it turns along the path while it flies, so that it begins a leg to where the camera does not look",
    5: "it keeps its heading, and the camera does not look along the path",
}
_COPTER_NEXT_WAYPOINT, _COPTER_EXCEPT_RTL = 1, 2
_COPTER_HEADINGS: Final = {
    0: "it keeps its heading, and the camera does not look along the path",
    3: "it turns along its course from 1 m/s on, so that it begins a leg to where the camera does not look",
}
_UNKNOWN: Final = "what this value means is not known here"
_STOPS: Final = "the guard stops the vehicle there, unless cameras look in all directions"
WIDEST_GAP_RAD: Final = math.radians(121.0)


def heading_advice(facts: AutopilotFacts, guard: GuardParams) -> list[str]:
    """Returns faults of the heading parameters, as text; empty: none, or the parameters were not read."""
    if facts.kind == PX4:
        return _px4_advice(facts, guard)
    return _copter_advice(facts, guard) if facts.kind == ARDUPILOT else []


def _px4_advice(facts: AutopilotFacts, guard: GuardParams) -> list[str]:
    out = []
    mode, in_return = facts.values.get("MPC_YAW_MODE"), facts.values.get("RTL_HDG_MD")
    if (guard.mission or guard.return_home) and mode not in (None, PX4_YAW_FIRST):
        why = _PX4_HEADINGS.get(int(mode), _UNKNOWN)
        out.append(f"MPC_YAW_MODE = {mode:g}: {why}; {_STOPS}; set it to {PX4_YAW_FIRST} (turn first, then fly)")
    if guard.return_home and in_return not in (None, 0.0):
        out.append(
            f"RTL_HDG_MD = {in_return:g}: in Return it does not point along the path; {_STOPS}; set it to 0 (towards the destination), "
            "or [guard] return_home = false"
        )
    return out


def _copter_advice(facts: AutopilotFacts, guard: GuardParams) -> list[str]:
    behaviour = facts.values.get("WP_YAW_BEHAVIOR")
    if behaviour in (None, _COPTER_NEXT_WAYPOINT) or not (guard.mission or guard.return_home):
        return []
    if behaviour == _COPTER_EXCEPT_RTL:
        if not guard.return_home:
            return []
        return [
            f"WP_YAW_BEHAVIOR = 2: in RTL it keeps its heading, and the camera does not look along the path; {_STOPS}; set it to "
            f"{_COPTER_NEXT_WAYPOINT} (face the next waypoint), or [guard] return_home = false"
        ]
    why = _COPTER_HEADINGS.get(int(behaviour), _UNKNOWN)
    return [
        f"WP_YAW_BEHAVIOR = {behaviour:g}: {why}; {_STOPS}; set it to {_COPTER_NEXT_WAYPOINT} (face the next waypoint)"
    ]


def look_all_around(yaws_rad: Sequence[float]) -> bool:
    """True if cameras at these yaw angles leave no gap of more than 120 degrees between the middles of two of them."""
    turned = sorted(yaw % math.tau for yaw in yaws_rad)
    gaps = [b - a for a, b in zip(turned, [*turned[1:], turned[0] + math.tau], strict=True)] if turned else []
    return bool(gaps) and max(gaps) <= WIDEST_GAP_RAD

"""Checks the autopilot's parameters: which of them prevent braking, and what to set instead."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.mavlink.session_types import ARDUPILOT, PX4

from ..config.avoidance import AvoidParams
from ..pipeline.latency import LatencyStage
from .failsafe import FENCE_SHARE
from .firmware_version import PX4_ACCELERATION_MODE, FirmwareVersion
from .parameters import RC_OPTIONS

RC_PROXIMITY_SWITCH = 40
"""RCn_OPTION of ArduPilot for a switch that turns proximity avoidance on and off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFacts:
    """What was read from an autopilot.

    Attributes:
        kind: kind of the autopilot.
        values: parameters by name.
        silent: parameters that it did not answer.
        version: version of its firmware; None: it did not answer."""

    kind: str
    values: Mapping[str, float] = field(default_factory=dict)
    silent: tuple[str, ...] = ()
    version: FirmwareVersion | None = None


def braking_position_modes(version: FirmwareVersion) -> tuple[int, ...]:
    """Returns the values of PX4's MPC_POS_MODE with which Position mode brakes. The first one is the one to set.

    Source: PX4 v1.14.3, v1.15.4 (FlightTaskManualPosition) and v1.16.0 (StickAccelerationXY)."""
    return (4,) if version >= PX4_ACCELERATION_MODE else (0, 3)


def position_mode_fault(facts: AutopilotFacts) -> str:
    """Returns why PX4's Position mode does not or may not brake, as text; empty: it brakes, or nothing was read."""
    mode = facts.values.get("MPC_POS_MODE")
    if facts.kind != PX4 or mode is None:
        return ""
    if facts.version is None:
        return (
            f"PX4's version is not known: with MPC_POS_MODE = {mode:g} it brakes only if it is "
            + (
                "v1.16 or newer"
                if mode == 4.0
                else "v1.15 or older"
                if mode in (0.0, 3.0)
                else "none of v1.14 to v1.16"
            )
            + " (v1.15 and older need 0 or 3, v1.16 and newer 4); look up the version in the ground station"
        )
    good = braking_position_modes(facts.version)
    if mode in good:
        return ""
    return f"PX4 v{facts.version} will not brake: MPC_POS_MODE = {mode:g}; set it to {good[0]}"


def advice(facts: AutopilotFacts, avoid: AvoidParams) -> list[str]:
    """Returns faults of the parameters, as text, the worst first."""
    lines = [
        f"the autopilot did not answer for {name}: not in this firmware, or the link loses messages"
        for name in facts.silent
    ]
    if facts.kind == PX4:
        return [*_px4_advice(facts, avoid), *lines]
    if facts.kind == ARDUPILOT:
        return [*_ardupilot_advice(facts.values, avoid), *lines]
    return lines


def _px4_advice(facts: AutopilotFacts, avoid: AvoidParams) -> list[str]:
    v, far_m = facts.values, avoid.max_distance_m
    lines = []
    if v.get("CP_DIST", 1.0) <= 0.0:
        lines.append(
            f"PX4 will not brake: CP_DIST = {v['CP_DIST']:g} switches collision prevention off; set it to the distance to keep, for example 3 m"
        )
    elif v.get("CP_DIST", 0.0) >= far_m:
        lines.append(
            f"PX4 would never fly on: CP_DIST = {v['CP_DIST']:g} m is not less than [avoid] max_distance_m = {far_m:g} m"
        )
    if fault := position_mode_fault(facts):
        lines.append(fault)
    if v.get("CP_GO_NO_DATA", 0.0) > 0.0:
        lines.append(
            "PX4 flies where no camera looks: CP_GO_NO_DATA = 1; with 0 it moves only into directions with data"
        )
    return lines


def _ardupilot_advice(v: Mapping[str, float], avoid: AvoidParams) -> list[str]:
    far_m = avoid.max_distance_m
    lines = []
    if v.get("PRX1_TYPE", 2.0) != 2.0:
        lines.append(
            f"ArduPilot does not read obstacles: PRX1_TYPE = {v['PRX1_TYPE']:g}; set it to 2 (MAVLink) and restart the autopilot"
        )
    if not int(v.get("AVOID_ENABLE", 7.0)) & 2:
        lines.append(
            f"ArduPilot will not brake: AVOID_ENABLE = {v['AVOID_ENABLE']:g} is without 2 (proximity sensors); set it to 7"
        )
    lines += _proximity_advice(v, avoid)
    if v.get("AVOID_MARGIN", 2.0) / FENCE_SHARE >= far_m:
        lines.append(
            f"AVOID_MARGIN = {v['AVOID_MARGIN']:g} m leaves no room below [avoid] max_distance_m = {far_m:g} m"
        )
    if v.get("AVOID_BEHAVE", 1.0) == 0.0:
        lines.append("AVOID_BEHAVE = 0: in LOITER it slides along obstacles instead of stopping; set it to 1")
    if v.get("AVOID_BACKUP_SPD", 0.0) > 0.0:
        lines.append(
            f"AVOID_BACKUP_SPD = {v['AVOID_BACKUP_SPD']:g} m/s: nearer than AVOID_MARGIN it backs away into directions that no camera may cover; 0 makes it stand"
        )
    if v.get("OA_TYPE", 0.0) > 0.0:
        lines.append(
            f"OA_TYPE = {v['OA_TYPE']:g}: in AUTO, GUIDED and RTL a path planner goes round obstacles, and when blind round the wall into unobserved space; 0 switches it off"
        )
    return lines


def _proximity_advice(v: Mapping[str, float], avoid: AvoidParams) -> list[str]:
    """Returns faults that prevent braking although PRX1_TYPE and AVOID_ENABLE are correct. From ArduPilot's sources,
    not flown."""
    lines = []
    wall_m = v.get("AVOID_MARGIN", avoid.avoid_margin_m)
    low_m, high_m = v.get("PRX1_MIN", 0.0), v.get("PRX1_MAX", 0.0)
    if low_m > avoid.min_distance_m:
        effect = "also the artificial wall" if low_m >= wall_m else "while they are nearer"
        lines.append(f"ArduPilot ignores obstacles nearer than PRX1_MIN = {low_m:g} m, {effect}; set it to 0")
    if 0.0 < high_m < avoid.max_distance_m:
        effect = "also the artificial wall" if high_m <= wall_m / FENCE_SHARE else "so that it brakes late"
        lines.append(f"ArduPilot ignores obstacles farther than PRX1_MAX = {high_m:g} m, {effect}; set it to 0")
    if v.get("PRX1_ORIENT", 0.0) != 0.0:
        lines.append(f"ArduPilot mirrors the directions of obstacles: PRX1_ORIENT = {v['PRX1_ORIENT']:g}; set it to 0")
    if v.get("PRX1_YAW_CORR", 0.0) != 0.0:
        lines.append(
            f"ArduPilot turns the directions of obstacles: PRX1_YAW_CORR = {v['PRX1_YAW_CORR']:g} degrees; set it to 0"
        )
    if v.get("PRX_IGN_GND", 0.0) != 0.0:
        lines.append(
            f"ArduPilot drops obstacles and the artificial wall near the ground: PRX_IGN_GND = {v['PRX_IGN_GND']:g}, and a vehicle "
            "that leans takes those ahead for lower ones; set it to 0"
        )
    if v.get("AVOID_ALT_MIN", 0.0) > 0.0:
        lines.append(f"ArduPilot does not brake below AVOID_ALT_MIN = {v['AVOID_ALT_MIN']:g} m; set it to 0")
    switches = [name for name in RC_OPTIONS if v.get(name) == RC_PROXIMITY_SWITCH]
    if switches:
        lines.append(
            f"a switch of the transmitter turns proximity avoidance off: {', '.join(switches)} = {RC_PROXIMITY_SWITCH}; keep it on, or set the option to 0"
        )
    return lines


def delay_advice(facts: AutopilotFacts, latency: tuple[LatencyStage, float, float, float] | None) -> list[str]:
    """Returns a fault if CP_DELAY is less than the measured latency.

    latency: (stage, p50, p95, p99) in ms from exposure to sending. PX4 does not know it, nor the time on the link,
    some milliseconds."""
    if facts.kind != PX4 or latency is None or "CP_DELAY" not in facts.values:
        return []
    p99_s = latency[3] / 1000.0
    if facts.values["CP_DELAY"] >= p99_s:
        return []
    return [
        f"PX4 brakes too late: CP_DELAY = {facts.values['CP_DELAY']:g} s, but one in a hundred obstacles is older than {p99_s:.2f} s "
        f"when it is sent; set CP_DELAY to {math.ceil(20.0 * (p99_s + 0.02)) / 20.0:g}"
    ]

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

LEAST_CUTOFF_HZ = 1.0
"""Of ArduPilot's low pass on the distance of a face. It delays an approaching obstacle by 1 / (2 pi f); 0: no low pass."""
MAVLINK_SENSOR = 2.0
"""PRXn_TYPE of ArduPilot for obstacles by MAVLink."""
RC_PROXIMITY_SWITCH = 40
"""RCn_OPTION of ArduPilot for a switch that turns proximity avoidance on and off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFacts:
    """What was read from an autopilot."""

    kind: str  # kind of the autopilot
    values: Mapping[str, float] = field(default_factory=dict)  # parameters by name
    silent: tuple[str, ...] = ()  # parameters that it did not answer
    version: FirmwareVersion | None = None  # version of its firmware; None: it did not answer


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


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """A parameter whose value keeps the vehicle from braking, or may."""

    text: str  # the fault and what to do
    name: str  # the parameter
    # the value that `companion doctor --apply` writes; None: none, since the value is a matter of preference
    to: float | None = None
    effect: str = ""  # what the autopilot does with that value, as text


def advice(facts: AutopilotFacts, avoid: AvoidParams) -> list[str]:
    """Returns faults of the parameters, as text, the worst first."""
    silent = [
        f"the autopilot did not answer for {name}: not in this firmware, or the link loses messages"
        for name in facts.silent
    ]
    return [fault.text for fault in parameter_faults(facts, avoid)] + silent


def parameter_faults(facts: AutopilotFacts, avoid: AvoidParams) -> list[ParameterFault]:
    """Returns the faults of the parameters that were read, the worst first."""
    if facts.kind == PX4:
        return _px4_faults(facts, avoid)
    return _ardupilot_faults(facts.values, avoid) if facts.kind == ARDUPILOT else []


def _keep_m(avoid: AvoidParams) -> float:
    """Returns the distance from obstacles to advise: of PX4's CP_DIST, in m."""
    return min(3.0, 0.5 * avoid.max_distance_m)


def _px4_faults(facts: AutopilotFacts, avoid: AvoidParams) -> list[ParameterFault]:
    v, far_m = facts.values, avoid.max_distance_m
    found = []
    dist_m = v.get("CP_DIST", _keep_m(avoid))
    if not 0.0 < dist_m < far_m:
        text = (
            f"PX4 will not brake: CP_DIST = {dist_m:g} switches collision prevention off; set it to the distance to keep, for example 3 m"
            if dist_m <= 0.0
            else f"PX4 would never fly on: CP_DIST = {dist_m:g} m is not less than [avoid] max_distance_m = {far_m:g} m"
        )
        found.append(ParameterFault(text, "CP_DIST", _keep_m(avoid), "the distance to keep, in m; 0 is off"))
    if fault := position_mode_fault(facts):
        to = None if facts.version is None else float(braking_position_modes(facts.version)[0])
        found.append(ParameterFault(fault, "MPC_POS_MODE", to, f"the mode that brakes in v{facts.version}"))
    text = "PX4 flies where no camera looks: CP_GO_NO_DATA = {:g}; with 0 it moves only into directions with data"
    found += _unless(v, "CP_GO_NO_DATA", 0.0, text, "it moves only into directions with data")
    if v.get("COM_OBS_AVOID", 0.0) != 0.0:
        # up to v1.15. Component 196 passes its check before arming, but sends no path. Not written: with 0 missions fly on
        text = (
            f"PX4 hovers in Mission, Return, Takeoff and Land: COM_OBS_AVOID = {v['COM_OBS_AVOID']:g} waits for a path from a "
            "companion computer, and none is sent; set it to 0"
        )
        found.append(ParameterFault(text, "COM_OBS_AVOID"))
    return found


def _unless(v: Mapping[str, float], name: str, good: float, text: str, effect: str) -> list[ParameterFault]:
    """Returns the fault of a parameter that was read with another value than `good`. text: with the value at {:g}."""
    value = v.get(name, good)
    return [] if value == good else [ParameterFault(text.format(value), name, good, effect)]


def _ardupilot_faults(v: Mapping[str, float], avoid: AvoidParams) -> list[ParameterFault]:
    """Returns the faults of ArduPilot's parameters, those after AVOID_ENABLE by its sources, not flown."""
    found = _sensor_faults(v)
    enable = int(v.get("AVOID_ENABLE", 7.0))
    if not enable & 2:
        text = f"ArduPilot will not brake: AVOID_ENABLE = {enable} is without 2 (proximity sensors); set it to 7"
        found.append(ParameterFault(text, "AVOID_ENABLE", float(enable | 2), "it brakes for obstacles"))
    found += _proximity_faults(v, avoid)
    margin_m, far_m = v.get("AVOID_MARGIN", 2.0), avoid.max_distance_m
    if margin_m / FENCE_SHARE >= far_m:
        text = f"AVOID_MARGIN = {margin_m:g} m leaves no room below [avoid] max_distance_m = {far_m:g} m"
        to = min(2.0, _keep_m(avoid))
        found.append(ParameterFault(text, "AVOID_MARGIN", to, "room below [avoid] max_distance_m, in m"))
    text = "AVOID_BEHAVE = {:g}: in LOITER it slides along obstacles instead of stopping; set it to 1"
    found += _unless(v, "AVOID_BEHAVE", 1.0, text, "it stops instead of sliding along obstacles")
    text = (
        "AVOID_BACKUP_SPD = {:g} m/s: nearer than AVOID_MARGIN it backs away into directions that no camera may cover; 0 "
        "makes it stand"
    )
    found += _unless(v, "AVOID_BACKUP_SPD", 0.0, text, "it does not back away into unobserved space")
    if v.get("OA_TYPE", 0.0) > 0.0:
        text = (
            f"OA_TYPE = {v['OA_TYPE']:g}: in AUTO, GUIDED and RTL a path planner flies around obstacles, and when blind around the "
            "wall into unobserved space; 0 switches it off"
        )
        found.append(ParameterFault(text, "OA_TYPE"))
    return found


def _sensor_faults(v: Mapping[str, float]) -> list[ParameterFault]:
    """Returns the fault of ArduPilot's proximity sensors. Another sensor is reported and not replaced."""
    first, second = v.get("PRX1_TYPE", MAVLINK_SENSOR), v.get("PRX2_TYPE", 0.0)
    if first == MAVLINK_SENSOR:
        return []
    if second == MAVLINK_SENSOR:
        text = (
            "PRX2_TYPE = 2: it reads obstacles as second proximity sensor, whose parameters (PRX2_...) are not checked here; make "
            "it the first one: PRX1_TYPE = 2"
        )
        return [ParameterFault(text, "PRX1_TYPE")]
    if first != 0.0:
        text = (
            f"ArduPilot does not read obstacles: PRX1_TYPE = {first:g} is another sensor; make it the second one (PRX2_TYPE), set "
            "PRX1_TYPE to 2 (MAVLink) and restart the autopilot"
        )
        return [ParameterFault(text, "PRX1_TYPE")]
    text = "ArduPilot does not read obstacles: PRX1_TYPE = 0; set it to 2 (MAVLink) and restart the autopilot"
    return [ParameterFault(text, "PRX1_TYPE", MAVLINK_SENSOR, "it reads obstacles from MAVLink")]


def _proximity_faults(v: Mapping[str, float], avoid: AvoidParams) -> list[ParameterFault]:
    """Returns faults that prevent braking although PRX1_TYPE and AVOID_ENABLE are correct."""
    found = []
    wall_m = v.get("AVOID_MARGIN", avoid.avoid_margin_m)
    low_m, high_m = v.get("PRX1_MIN", 0.0), v.get("PRX1_MAX", 0.0)
    if low_m > avoid.min_distance_m:
        effect = "also the artificial wall" if low_m >= wall_m else "while they are nearer"
        text = f"ArduPilot ignores obstacles nearer than PRX1_MIN = {low_m:g} m, {effect}; set it to 0"
        found.append(ParameterFault(text, "PRX1_MIN", 0.0, "it reads near obstacles and the artificial wall"))
    if 0.0 < high_m < avoid.max_distance_m:
        effect = "also the artificial wall" if high_m <= wall_m / FENCE_SHARE else "so that it brakes late"
        text = f"ArduPilot ignores obstacles farther than PRX1_MAX = {high_m:g} m, {effect}; set it to 0"
        found.append(ParameterFault(text, "PRX1_MAX", 0.0, "it reads far obstacles"))
    text = "ArduPilot mirrors the directions of obstacles: PRX1_ORIENT = {:g}; set it to 0"
    found += _unless(v, "PRX1_ORIENT", 0.0, text, "directions are not mirrored")
    text = "ArduPilot turns the directions of obstacles: PRX1_YAW_CORR = {:g} degrees; set it to 0"
    found += _unless(v, "PRX1_YAW_CORR", 0.0, text, "directions are not turned")
    text = (
        "ArduPilot drops obstacles and the artificial wall near the ground: PRX_IGN_GND = {:g}, and a vehicle that leans takes "
        "those ahead for lower ones; set it to 0"
    )
    found += _unless(v, "PRX_IGN_GND", 0.0, text, "it reads obstacles and the artificial wall near the ground")
    cutoff_hz = v.get("PRX_FILT", 0.0)
    if 0.0 < cutoff_hz < LEAST_CUTOFF_HZ:
        late_s = 1.0 / (math.tau * cutoff_hz)
        text = f"ArduPilot delays an approaching obstacle by {late_s:.1f} s: PRX_FILT = {cutoff_hz:g} Hz; set it to 1 to 2 Hz"
        found.append(
            ParameterFault(text, "PRX_FILT", LEAST_CUTOFF_HZ, "an approaching obstacle is delayed by 0.2 s at most")
        )
    text = "ArduPilot does not brake below AVOID_ALT_MIN = {:g} m; set it to 0"
    found += _unless(v, "AVOID_ALT_MIN", 0.0, text, "it brakes at each height")
    switches = [name for name in RC_OPTIONS if v.get(name) == RC_PROXIMITY_SWITCH]
    if switches:
        text = (
            f"a switch of the transmitter turns proximity avoidance off: {', '.join(switches)} = {RC_PROXIMITY_SWITCH}; keep "
            "it on, or set the option to 0"
        )
        found.append(ParameterFault(text, switches[0]))
    return found


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

"""Faults of ArduPilot's parameters: which of them prevent braking, and what to set instead."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..config.avoidance import AvoidParams
from .failsafe import FENCE_SHARE
from .parameter_fault import ParameterFault, keep_m, unless
from .parameters import RC_OPTIONS

LEAST_MARGIN_M = 0.5
"""AVOID_MARGIN. The fence of ArduPilot has no corner nearer than 0.6 m, and the artificial wall is not nearer than min_distance_m."""
LEAST_DEAD_ZONE_M = 0.05
"""AVOID_BACKUP_DZ: the fence of the artificial wall is up to STOP_INSIDE_M (0.04 m) inside of AVOID_MARGIN."""
LEAST_CUTOFF_HZ = 1.0
"""Of ArduPilot's low pass on the distance of a face. It delays an approaching obstacle by 1 / (2 pi f); 0: no low pass."""
MAVLINK_SENSOR = 2.0
"""PRXn_TYPE of ArduPilot for obstacles by MAVLink."""
BENDY_RULER = (1.0, 3.0)
"""OA_TYPE of path planners that read obstacles; 2 plans by fences alone."""
RC_PROXIMITY_SWITCH = 40
"""RCn_OPTION of ArduPilot for a switch that turns proximity avoidance on and off."""


def ardupilot_faults(v: Mapping[str, float], avoid: AvoidParams) -> list[ParameterFault]:
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
        to = min(2.0, keep_m(avoid))
        found.append(ParameterFault(text, "AVOID_MARGIN", to, "room below [avoid] max_distance_m, in m"))
    if margin_m < LEAST_MARGIN_M:
        text = f"AVOID_MARGIN = {margin_m:g} m is too small: when blind the vehicle creeps on in LOITER; set it to 2 m"
        found.append(ParameterFault(text, "AVOID_MARGIN", min(2.0, keep_m(avoid)), "the distance to keep, in m"))
    text = "AVOID_BEHAVE = {:g}: in LOITER it slides along obstacles instead of stopping; set it to 1"
    found += unless(v, "AVOID_BEHAVE", 1.0, text, "it stops instead of sliding along obstacles")
    found += _backing_faults(v, avoid)
    if v.get("OA_TYPE") in BENDY_RULER:
        text = (
            f"OA_TYPE = {v['OA_TYPE']:g}: in AUTO, RTL and ZIGZAG, with bit 6 of GUID_OPTIONS also in GUIDED, a path planner flies around "
            "obstacles, and when blind around the wall into unobserved space; 0 switches it off"
        )
        found.append(ParameterFault(text, "OA_TYPE"))
    return found


def _backing_faults(v: Mapping[str, float], avoid: AvoidParams) -> list[ParameterFault]:
    """Returns the faults of parameters by which ArduPilot moves away from what is nearer than AVOID_MARGIN. It does so without
    regard to directions that nothing was sent for."""
    wall = ""
    if v.get("AVOID_BACKUP_DZ", LEAST_DEAD_ZONE_M) < LEAST_DEAD_ZONE_M:
        wall = f", with AVOID_BACKUP_DZ = {v['AVOID_BACKUP_DZ']:g} m also from the artificial wall, without end"
    text = (
        "AVOID_BACKUP_SPD = {:g} m/s: nearer than AVOID_MARGIN it backs away into directions that no camera may cover"
        f"{wall}; 0 makes it stand"
    )
    found = unless(v, "AVOID_BACKUP_SPD", 0.0, text, "it does not back away into unobserved space")
    if avoid.points or avoid.upward:
        text = (
            "AVOID_BACKZ_SPD = {:g} m/s: nearer than AVOID_MARGIN it climbs or descends away from what is below or above "
            "(points, upward), whatever is there; 0 switches it off"
        )
        found += unless(v, "AVOID_BACKZ_SPD", 0.0, text, "it neither climbs nor descends to keep its distance")
    return found


def _sensor_faults(v: Mapping[str, float]) -> list[ParameterFault]:
    """Returns the fault of ArduPilot's proximity sensors. Another sensor is reported and not replaced."""
    first, second = v.get("PRX1_TYPE", MAVLINK_SENSOR), v.get("PRX2_TYPE", 0.0)
    if first == MAVLINK_SENSOR and second in (0.0, MAVLINK_SENSOR):
        return []
    if first == MAVLINK_SENSOR:
        text = (
            f"ArduPilot forgets what the second proximity sensor (PRX2_TYPE = {second:g}) measured with each message of this service, "
            "until it measures again; set PRX2_TYPE to 0, or do not rely on that sensor"
        )
        return [ParameterFault(text, "PRX2_TYPE")]
    if second == MAVLINK_SENSOR:
        text = (
            "PRX2_TYPE = 2: it reads obstacles as second proximity sensor, whose parameters (PRX2_...) are not checked here; make "
            "it the first one: PRX1_TYPE = 2"
        )
        return [ParameterFault(text, "PRX1_TYPE")]
    if first != 0.0:
        text = (
            f"ArduPilot does not read obstacles: PRX1_TYPE = {first:g} is another sensor; remove it or choose between both: set "
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
    found += unless(v, "PRX1_ORIENT", 0.0, text, "directions are not mirrored")
    text = "ArduPilot turns the directions of obstacles: PRX1_YAW_CORR = {:g} degrees; set it to 0"
    found += unless(v, "PRX1_YAW_CORR", 0.0, text, "directions are not turned")
    text = (
        "ArduPilot drops obstacles and the artificial wall near the ground: PRX_IGN_GND = {:g}, and a vehicle that leans takes "
        "those ahead for lower ones; set it to 0"
    )
    found += unless(v, "PRX_IGN_GND", 0.0, text, "it reads obstacles and the artificial wall near the ground")
    cutoff_hz = v.get("PRX_FILT", 0.0)
    if 0.0 < cutoff_hz < LEAST_CUTOFF_HZ:
        late_s = 1.0 / (math.tau * cutoff_hz)
        text = f"ArduPilot delays an approaching obstacle by {late_s:.1f} s: PRX_FILT = {cutoff_hz:g} Hz; set it to 1 to 2 Hz"
        found.append(
            ParameterFault(text, "PRX_FILT", LEAST_CUTOFF_HZ, "an approaching obstacle is delayed by 0.2 s at most")
        )
    text = "ArduPilot does not brake below AVOID_ALT_MIN = {:g} m; set it to 0"
    found += unless(v, "AVOID_ALT_MIN", 0.0, text, "it brakes at each height")
    switches = [name for name in RC_OPTIONS if v.get(name) == RC_PROXIMITY_SWITCH]
    if switches:
        text = (
            f"a switch of the transmitter turns proximity avoidance off: {', '.join(switches)} = {RC_PROXIMITY_SWITCH}; keep "
            "it on, or set the option to 0"
        )
        found.append(ParameterFault(text, switches[0]))
    return found

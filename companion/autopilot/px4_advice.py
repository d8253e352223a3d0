"""Faults of PX4's parameters: which of them prevent braking, and what to set instead."""

from __future__ import annotations

import math

from drivers.mavlink.session_types import PX4

from ..config.avoidance import AvoidParams
from ..pipeline.latency import LatencyStage
from .firmware_version import PX4_ACCELERATION_MODE, FirmwareVersion
from .parameter_fault import AutopilotFacts, ParameterFault, keep_m, unless


def px4_faults(facts: AutopilotFacts, avoid: AvoidParams) -> list[ParameterFault]:
    """Returns the faults of PX4's parameters that were read."""
    v, far_m = facts.values, avoid.max_distance_m
    found = []
    dist_m = v.get("CP_DIST", keep_m(avoid))
    if not 0.0 < dist_m < far_m:
        text = (
            f"PX4 will not brake: CP_DIST = {dist_m:g} switches collision prevention off; set it to the distance to keep, for example 3 m"
            if dist_m <= 0.0
            else f"PX4 would never fly on: CP_DIST = {dist_m:g} m is not less than [avoid] max_distance_m = {far_m:g} m"
        )
        found.append(ParameterFault(text, "CP_DIST", keep_m(avoid), "the distance to keep, in m; 0 is off"))
    if fault := position_mode_fault(facts):
        to = None if facts.version is None else float(braking_position_modes(facts.version)[0])
        found.append(ParameterFault(fault, "MPC_POS_MODE", to, f"the mode that brakes in v{facts.version}"))
    text = "PX4 flies where no camera looks: CP_GO_NO_DATA = {:g}; with 0 it moves only into directions with data"
    found += unless(v, "CP_GO_NO_DATA", 0.0, text, "it moves only into directions with data")
    if v.get("COM_OBS_AVOID", 0.0) != 0.0:
        # up to v1.15. Component 196 passes its check before arming, but sends no path. Not written: with 0 missions fly on
        text = (
            f"PX4 hovers in Mission, Return, Takeoff and Land: COM_OBS_AVOID = {v['COM_OBS_AVOID']:g} waits for a path from a "
            "companion computer, and none is sent; set it to 0"
        )
        found.append(ParameterFault(text, "COM_OBS_AVOID"))
    return found


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

"""Checks the autopilot's parameters: which of them prevent braking, and what to set instead."""

from __future__ import annotations

from drivers.mavlink.session_types import ARDUPILOT, PX4

from ..config.avoidance import AvoidParams
from .ardupilot_advice import ardupilot_faults
from .parameter_fault import AutopilotFacts, ParameterFault
from .px4_advice import px4_faults


def advice(facts: AutopilotFacts, avoid: AvoidParams) -> list[str]:
    """Returns faults of the parameters, as text, the worst first."""
    found = [fault.text for fault in parameter_faults(facts, avoid)]
    if facts.silent:
        remedy = "the link loses messages, or the firmware is too old: update it"
        found.append(f"the autopilot did not answer for {', '.join(facts.silent)}: {remedy}")
    return found


def parameter_faults(facts: AutopilotFacts, avoid: AvoidParams) -> list[ParameterFault]:
    """Returns the faults of the parameters that were read, the worst first."""
    if facts.kind == PX4:
        return px4_faults(facts, avoid)
    return ardupilot_faults(facts.values, avoid) if facts.kind == ARDUPILOT else []

"""What was read from an autopilot, and a fault of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..config.avoidance import AvoidParams
from .firmware_version import FirmwareVersion


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFacts:
    """What was read from an autopilot."""

    kind: str  # kind of the autopilot
    values: Mapping[str, float] = field(default_factory=dict)  # parameters by name
    silent: tuple[str, ...] = ()  # parameters that it did not answer
    version: FirmwareVersion | None = None  # version of its firmware; None: it did not answer


@dataclass(frozen=True, slots=True)
class ParameterFault:
    """A parameter whose value keeps the vehicle from braking, or may."""

    text: str  # the fault and what to do
    name: str  # the parameter
    # the value that `companion doctor --apply` writes; None: none, since the value is a matter of preference
    to: float | None = None
    effect: str = ""  # what the autopilot does with that value, as text


def keep_m(avoid: AvoidParams) -> float:
    """Returns the distance from obstacles to advise: of PX4's CP_DIST, in m."""
    return min(3.0, 0.5 * avoid.max_distance_m)


def unless(v: Mapping[str, float], name: str, good: float, text: str, effect: str) -> list[ParameterFault]:
    """Returns the fault of a parameter that was read with another value than `good`. text: with the value at {:g}."""
    value = v.get(name, good)
    return [] if value == good else [ParameterFault(text.format(value), name, good, effect)]

"""Holds the last velocity of the vehicle for a short time when no velocity is known.

The held velocity keeps its own stamp. The vehicle may be faster meanwhile: `assessment.PathAssessor` adds the speed
that it can have gained, and a vehicle does not count as standing by a velocity that is not measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from ..autopilot.surroundings import Surroundings

NS = 1_000_000_000
HOLD_NS: Final = 2 * NS
"""Time after its stamp for which the last velocity is used."""


@dataclass(slots=True)
class VelocityHold:
    """Holds the last velocity. `held` gets the surroundings of each decision, in order."""

    _velocity_ned_m_s: tuple[float, float, float] | None = None
    _t_ns: int = 0

    def held(self, s: Surroundings) -> Surroundings:
        """Returns the surroundings, with the last velocity and its stamp if none is known now and that one is not
        older than HOLD_NS."""
        if s.velocity_ned_m_s is not None:
            self._velocity_ned_m_s, self._t_ns = s.velocity_ned_m_s, s.t_ns if s.velocity_ns is None else s.velocity_ns
            return s
        if self._velocity_ned_m_s is None or s.t_ns - self._t_ns > HOLD_NS:
            return s
        return replace(s, velocity_ned_m_s=self._velocity_ned_m_s, velocity_ns=self._t_ns)

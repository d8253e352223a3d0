"""The velocity of the vehicle for the guard: the last one stands in for a short time where none is known.

It keeps its own stamp. The vehicle may be faster meanwhile: `assessment.PathAssessor` adds what it can gain, and a vehicle is not
taken to stand by a velocity that is not measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from ..autopilot.surroundings import Surroundings

NS = 1_000_000_000
HOLD_NS: Final = 2 * NS
"""The last velocity stands in for so long after its stamp."""


@dataclass(slots=True)
class VelocityHold:
    """`held` receives the surroundings of each decision, in order."""

    _velocity_ned_m_s: tuple[float, float, float] | None = None
    _t_ns: int = 0

    def held(self, s: Surroundings) -> Surroundings:
        """The same with the last velocity and its stamp, where that is not older than HOLD_NS and none is known now."""
        if s.velocity_ned_m_s is not None:
            self._velocity_ned_m_s, self._t_ns = s.velocity_ned_m_s, s.t_ns if s.velocity_ns is None else s.velocity_ns
            return s
        if self._velocity_ned_m_s is None or s.t_ns - self._t_ns > HOLD_NS:
            return s
        return replace(s, velocity_ned_m_s=self._velocity_ned_m_s, velocity_ns=self._t_ns)

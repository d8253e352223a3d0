"""Sections of the autopilot's position estimate: between two jumps of it, positions can be compared.

ODOMETRY counts its jumps (reset_counter). LOCAL_POSITION_NED, which both autopilots send, does not: there a position that the
velocity does not explain is a jump. What was remembered in ned before a jump stands at another place after it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from core.types import PoseSample

NS: Final = 1_000_000_000
JUMP_M: Final = 0.5
"""A smaller step is the estimate's correction, within the margins of the obstacle output."""
JUMP_SPEED_M_S: Final = 5.0
"""Greater by this times the time between two positions: the velocity may change between them."""
UNKNOWN_SPEED_M_S: Final = 30.0
"""The same without a velocity."""
LONGEST_NS: Final = NS
"""After a longer time without a position the two are not compared: it may have jumped meanwhile."""


@dataclass(slots=True)
class PositionSections:
    """`take` the positions as they come. number: of the present section; since_ns: arrival of its first position, from which on
    all parts of the service use it."""

    number: int = 0
    since_ns: int = 0
    _newest: PoseSample | None = None

    def take(self, sample: PoseSample) -> None:
        """A position. One that is older than the newest changes nothing."""
        newest = self._newest
        if newest is not None and sample.t_ns <= newest.t_ns:
            return
        if newest is None or sample.reset_counter != newest.reset_counter or _jumped(newest, sample):
            self.number, self.since_ns = self.number + 1, sample.t_arrival_ns
        self._newest = sample


def _jumped(before: PoseSample, after: PoseSample) -> bool:
    """Whether the velocities at both positions do not explain the way between them."""
    if after.t_ns - before.t_ns > LONGEST_NS:
        return True
    time_s = (after.t_ns - before.t_ns) / NS
    velocities = [s.velocity_ned_m_s for s in (before, after) if s.velocity_ned_m_s is not None]
    way_m = [b - a for a, b in zip(before.position_ned_m, after.position_ned_m, strict=True)]
    if not velocities:
        return math.hypot(*way_m) > JUMP_M + UNKNOWN_SPEED_M_S * time_s
    mean_m_s = [sum(v) / len(velocities) for v in zip(*velocities, strict=True)]
    unexplained_m = math.hypot(*(w - v * time_s for w, v in zip(way_m, mean_m_s, strict=True)))
    return unexplained_m > JUMP_M + JUMP_SPEED_M_S * time_s

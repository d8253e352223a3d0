"""Divides the autopilot's position estimate into sections between its jumps.

Positions can be compared only within a section: after a jump, what was remembered in ned is at another place.
ODOMETRY counts the jumps of the estimate (reset_counter). LOCAL_POSITION_NED, which both autopilots send, does not:
there, a step that the velocity does not explain counts as a jump."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from core.types import PoseSample

NS: Final = 1_000_000_000
JUMP_M: Final = 0.5
"""Smallest step that counts as a jump. A smaller one is a correction of the estimate within the margins of the
obstacle output."""
JUMP_SPEED_M_S: Final = 5.0
"""The limit grows by this times the time between two positions, because the velocity may change between them."""
UNKNOWN_SPEED_M_S: Final = 30.0
"""The same if no velocity is known."""
LONGEST_NS: Final = NS
"""After a longer time without a position a new section begins, because the estimate may have jumped meanwhile."""


@dataclass(slots=True)
class PositionSections:
    """Number and beginning of the present section.

    Attributes:
        number: number of the section.
        since_ns: arrival of its first position. All parts of the service use the section from then on."""

    number: int = 0
    since_ns: int = 0
    _newest: PoseSample | None = None

    def take(self, sample: PoseSample) -> None:
        """Handles a position. One that is not newer than the newest changes nothing."""
        newest = self._newest
        if newest is not None and sample.t_ns <= newest.t_ns:
            return
        if newest is None or sample.reset_counter != newest.reset_counter or _jumped(newest, sample):
            self.number, self.since_ns = self.number + 1, sample.t_arrival_ns
        self._newest = sample


def _jumped(before: PoseSample, after: PoseSample) -> bool:
    """True if the velocities at two positions do not explain the distance between them."""
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

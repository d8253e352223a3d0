"""The path in a turn: how fast the course changes, and in which directions the vehicle may fly within its braking distance.

The course does not change on a straight leg. At a waypoint that is flown through it does, and an obstacle beside the tangent comes
into the path only when the braking distance no longer fits before it. A turn may end at any moment, so that everything between the
tangent and the arc of the present turn may be reached. A point of the arc at distance d lies d k / 2 beside the tangent, where the
curvature k is the rate of the course over the speed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from ..autopilot.surroundings import Surroundings

NS = 1_000_000_000
WINDOW_NS, LONGEST_NS = 3 * NS // 10, 6 * NS // 10
"""The rate is taken over the first sample that is older than WINDOW_NS; from an older one than LONGEST_NS none is taken."""
LEAST_SPEED_M_S: Final = 1.0
"""Slower, the course is mostly noise, and the braking distance is short."""
LEAST_RAD_S: Final = math.radians(6.0)
"""A lower rate moves the vehicle aside by 0.6 m at most within 6 m at 3 m/s."""
LEAST_LATERAL_M_S2: Final = 0.3
"""A rate that less lateral acceleration makes is noise: 0.03 m/s on each component of the velocity make 0.14 m/s2 over WINDOW_NS."""
STEP_RAD: Final = math.radians(6.0)
"""Between two directions of the fan: 0.8 m at a distance of 8 m, less than the width of the corridor."""
WIDEST_RAD: Final = math.radians(60.0)
AHEAD_S: Final = 0.4
"""A vehicle goes on turning for so long after a stop command: link, change of mode, limit of the jerk."""


@dataclass(slots=True)
class CourseRate:
    """`take` the surroundings of each decision, in order: rad/s clockwise, 0 where none is known or it is noise."""

    _courses: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=32))

    def take(self, s: Surroundings) -> float:
        """The rate over the last WINDOW_NS."""
        velocity = s.velocity_ned_m_s
        speed_m_s = 0.0 if velocity is None else math.hypot(*velocity[:2])
        if velocity is None or speed_m_s < LEAST_SPEED_M_S:
            self._courses.clear()
            return 0.0
        course_rad = math.atan2(velocity[1], velocity[0])
        self._courses.append((s.t_ns, course_rad))
        for t_ns, before_rad in reversed(self._courses):
            age_ns = s.t_ns - t_ns
            if age_ns > LONGEST_NS:
                return 0.0
            if age_ns >= WINDOW_NS:
                rate = math.remainder(course_rad - before_rad, math.tau) * NS / age_ns
                return rate if abs(rate) >= max(LEAST_RAD_S, LEAST_LATERAL_M_S2 / speed_m_s) else 0.0
        return 0.0


def fan(turn_rad_s: float, speed_m_s: float, longest_m: float) -> list[tuple[float, float]]:
    """(angle, from_m) of the directions beside the tangent, radians clockwise from it; each counts from a distance on at which
    the arc is not beyond it. Empty on a straight path."""
    if turn_rad_s == 0.0 or speed_m_s < LEAST_SPEED_M_S:
        return []
    curvature = abs(turn_rad_s) / speed_m_s
    widest = min(WIDEST_RAD, 0.5 * curvature * longest_m)
    count = math.floor(widest / STEP_RAD) + 1
    steps = range(1, min(count, math.floor(WIDEST_RAD / STEP_RAD)) + 1)
    return [(math.copysign(k * STEP_RAD, turn_rad_s), 2.0 * (k - 1) * STEP_RAD / curvature) for k in steps]

"""The path in a turn: the rate of the course, and the directions in which the vehicle may fly within its braking
distance.

On a straight leg the course does not change. At a waypoint that is flown through it does, and an obstacle beside the
tangent enters the path only when the braking distance does not fit any more. A turn may end at any moment, so that
the vehicle may reach all space between the tangent and the arc of the present turn. A point of the arc at distance d
lies d^2 k / 2 beside the tangent, at an angle of d k / 2, where the curvature k is the rate of the course over the
speed."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from ..autopilot.surroundings import Surroundings
from .lean import Horizontal, LeanAcceleration

NS = 1_000_000_000
WINDOW_NS, LONGEST_NS = 3 * NS // 10, 6 * NS // 10
"""The rate is computed from the first sample that is older than WINDOW_NS, but not from one older than LONGEST_NS."""
LEAST_SPEED_M_S: Final = 1.0
"""For a slower vehicle the rate of the course is mostly noise."""
SLOWEST_M_S: Final = 0.3
"""A slower vehicle is not stopped before an obstacle."""
LEAST_LATERAL_M_S2: Final = 0.2
"""Least lateral acceleration of a turn, by the lean; less is noise. From 2 m/s on, the arc of a weaker turn leaves the
corridor only beyond the braking distance. Without a lean it holds for a slow vehicle only."""
SURE_M_S: Final = 0.4
"""Change of the velocity across the course within SURE_NS that is a turn whatever the lean is. A noise of 0.1 m/s in each
component changes it by 0.14 m/s (standard deviation)."""
SURE_NS = NS
HOLD_NS = 6 * NS // 10
"""Time for which the last rate is used if there is no newer velocity."""
STARTS_M_S2: Final = 1.0
LEAST_DRIFT: Final = 0.02
"""A slow vehicle that gains speed at STARTS_M_S2 begins a leg. A drift of 0.1 m/s beside the leg then turns its
course by 10 degrees. The acceleration shows the direction of the leg, unless less than LEAST_DRIFT of it is across
the course."""
WIDEST_RAD: Final = math.radians(60.0)
AHEAD_S: Final = 0.4
"""Time for which a vehicle continues to turn after a stop command: link, change of mode, limited jerk."""


@dataclass(slots=True)
class CourseRate:
    """Rate of the course, in rad/s clockwise; 0: not known, or noise. `take` gets the surroundings of each decision,
    in order.

    The velocity shows a turn if the vehicle also leans into it, or if the velocity changes by more than noise. If the
    vehicle was slow within the window, its course is not yet that of its path, since it still drifts as before. The
    angle to the velocity that its acceleration gives it within one second is used instead, and 0 while it slows
    down."""

    _velocities: deque[tuple[int, float, float]] = field(default_factory=lambda: deque(maxlen=32))
    _lean: LeanAcceleration = field(default_factory=LeanAcceleration)
    _last: float = 0.0
    _last_ns: int | None = None

    def take(self, s: Surroundings) -> float:
        """Returns the rate over the last WINDOW_NS of the velocity's own time; the last known rate for up to HOLD_NS."""
        if s.here is not None and s.here.lean_m_s2 is not None:
            self._lean.take(s.t_ns, s.here.lean_m_s2)
        rate = self._newest(s)
        if rate is not None:
            self._last, self._last_ns = rate, s.t_ns
        held = self._last_ns is not None and s.t_ns - self._last_ns <= HOLD_NS
        return self._last if held else 0.0

    def _newest(self, s: Surroundings) -> float | None:
        """Returns the rate by the newest velocity; None: there is no newer one, or none of WINDOW_NS before."""
        at_ns = s.t_ns if s.velocity_ns is None else s.velocity_ns
        if s.velocity_ned_m_s is None or (self._velocities and at_ns <= self._velocities[-1][0]):
            return None
        north, east, _ = s.velocity_ned_m_s
        self._velocities.append((at_ns, north, east))
        for t_ns, north_before, east_before in reversed(self._velocities):
            age_ns = at_ns - t_ns
            if age_ns > LONGEST_NS:
                return None
            if age_ns >= WINDOW_NS:
                self._lean.settle(t_ns, at_ns, (north - north_before, east - east_before))
                lean_m_s2 = self._lean.newest_m_s2(s.t_ns)
                return self._between((north, east), (north_before, east_before), age_ns / NS, lean_m_s2)
        return None

    def _between(
        self, now_m_s: Horizontal, before_m_s: Horizontal, time_s: float, lean_m_s2: Horizontal | None
    ) -> float:
        """Returns the rate between two velocities; 0: noise. lean_m_s2: acceleration by the lean; None: not known."""
        if min(math.hypot(*now_m_s), math.hypot(*before_m_s)) < LEAST_SPEED_M_S:
            changes = (now_m_s[0] - before_m_s[0]) / time_s, (now_m_s[1] - before_m_s[1]) / time_s
            return _slow_rate(now_m_s, lean_m_s2 or changes)
        rate_rad_s = _rate(now_m_s, before_m_s, time_s)
        return rate_rad_s if lean_m_s2 is None or self._leans_into(rate_rad_s, lean_m_s2) else 0.0

    def _leans_into(self, rate_rad_s: float, lean_m_s2: Horizontal) -> bool:
        """True if the lean shows a turn of this sense, or the velocity alone does."""
        at_ns, north, east = self._velocities[-1]
        changes_m_s = (
            _across_along((north - before_north, east - before_east), (north, east))[0]
            for t_ns, before_north, before_east in self._velocities
            if at_ns - t_ns <= SURE_NS
        )
        sense = math.copysign(1.0, rate_rad_s)
        across_m_s2, _ = _across_along(lean_m_s2, (north, east))
        return sense * across_m_s2 >= LEAST_LATERAL_M_S2 or max(sense * c for c in changes_m_s) >= SURE_M_S


def _rate(now_m_s: Horizontal, before_m_s: Horizontal, time_s: float) -> float:
    """Returns the rate between two velocities, rad/s clockwise."""
    (north, east), (north_before, east_before) = now_m_s, before_m_s
    return math.remainder(math.atan2(east, north) - math.atan2(east_before, north_before), math.tau) / time_s


def _slow_rate(velocity_m_s: Horizontal, acceleration_m_s2: Horizontal) -> float:
    """Returns the rate of a slow vehicle, rad/s clockwise; 0: noise, or it slows down or stands."""
    speed_m_s = math.hypot(*velocity_m_s)
    if speed_m_s < SLOWEST_M_S:
        return 0.0
    across, along = _across_along(acceleration_m_s2, velocity_m_s)
    turns = abs(across) >= (LEAST_LATERAL_M_S2 if along < STARTS_M_S2 else LEAST_DRIFT * along)
    return math.atan2(across, speed_m_s + along) if turns and along > 0.0 else 0.0


def _across_along(a: Horizontal, course: Horizontal) -> tuple[float, float]:
    """Returns the parts of a vector to the right of a course and along it."""
    (a_north, a_east), (north, east) = a, course
    length = math.hypot(north, east)
    return (north * a_east - east * a_north) / length, (north * a_north + east * a_east) / length


def turns(turn_rad_s: float, speed_m_s: float, braking_m: float, side_m: float) -> bool:
    """True if the arc deviates from the tangent by more than side_m within the braking distance. A slow vehicle turns
    at any rate."""
    if speed_m_s < LEAST_SPEED_M_S:
        return turn_rad_s != 0.0 and speed_m_s >= SLOWEST_M_S
    return 0.5 * braking_m**2 * abs(turn_rad_s) / speed_m_s > side_m


def fan(turn_rad_s: float, speed_m_s: float, longest_m: float, half_width_m: float) -> list[tuple[float, float]]:
    """Returns (angle, from_m) of the directions beside the tangent, in radians clockwise from the path.

    Each direction counts from the distance at which the arc reaches it. Corridors of half_width_m leave no gap up to
    longest_m. For a slow vehicle, all directions count that it reaches by one second of turning."""
    if turn_rad_s == 0.0 or speed_m_s < SLOWEST_M_S:
        return []
    step = 2.0 * half_width_m / longest_m
    curvature = abs(turn_rad_s) / speed_m_s
    slow = speed_m_s < LEAST_SPEED_M_S
    widest = min(WIDEST_RAD, abs(turn_rad_s) if slow else 0.5 * curvature * longest_m)
    return [
        (math.copysign(k * step, turn_rad_s), 0.0 if slow else 2.0 * (k - 1) * step / curvature)
        for k in range(1, math.floor(widest / step) + 2)
    ]

"""What the guard takes for free along the vehicle's path, and the truth.

Every part is that of the guard but its thread and its commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from companion.autopilot.surroundings import Surroundings
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.assessment import PathAssessor
from companion.guard.braking import braking_of
from companion.guard.kept_views import KeptViews
from companion.guard.path_sight import path_sight
from companion.guard.turn import CourseRate
from companion.guard.velocity_hold import VelocityHold
from drivers.simulation.flight_path import VehicleState

HALF_WIDTH_M = 0.3
"""Half of the width of the judged corridor. That of the guard is wider; of its border a fifth may be missed."""


@dataclass(frozen=True, slots=True)
class PathClaim:
    """angle_rad: of the path, clockwise from the vehicle's axis; room_m: from its middle."""

    angle_rad: float
    room_m: float


@dataclass(slots=True)
class PathWatch:
    """`observe` gets the surroundings of each decision. claim: by the newest one; None: the guard claims nothing."""

    avoid: AvoidParams
    guard: GuardParams = field(default_factory=GuardParams)
    claim: PathClaim | None = None
    _rate: CourseRate = field(default_factory=CourseRate)
    _velocity: VelocityHold = field(default_factory=VelocityHold)
    _views: KeptViews = field(default_factory=KeptViews)
    _assessor: PathAssessor = field(init=False)

    def __post_init__(self) -> None:
        self._assessor = PathAssessor(self.guard, braking_of(self.guard, self.avoid), self.avoid)

    def observe(self, s: Surroundings) -> None:
        """Makes the claim of a decision."""
        turn_rad_s = self._rate.take(s)
        sight = path_sight(self._velocity.held(s), self.avoid, self.guard, turn_rad_s, self._views.before(s))
        self._views.take(s)
        self._assessor.take(sight)
        verdict = self._assessor.verdict(s.t_ns)
        self.claim = None
        if verdict is not None and sight.course_rad is not None and s.here is not None:
            self.claim = PathClaim(sight.course_rad - s.here.heading_rad, verdict.room_m)


def true_room_m(outline_m: NDArray[np.float64], state: VehicleState, angle_rad: float) -> float:
    """Returns the distance from the vehicle's middle along a path to the first point of the outlines; inf: none."""
    heading = state.euler_rad[2] + angle_rad
    c, s = math.cos(heading), math.sin(heading)
    north, east = (outline_m - np.array(state.position_ned_m[:2])).T
    along, across = c * north + s * east, -s * north + c * east
    return float(np.min(along[(along > 0.0) & (np.abs(across) <= HALF_WIDTH_M)], initial=math.inf))

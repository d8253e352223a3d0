"""Whether the vehicle may fly on as it does: from the sights of the path to one verdict.

Space seen free belongs to the world, not to a frame: what an earlier frame saw free is still free a moment later, nearer by
the way flown, unless a newer frame shows an obstacle in it. It counts for `keep_free_s` and along nearly the same course, for each
ray of the corridor: holes of the depth image lie at other places in each frame. A frame that sees less, without an obstacle,
therefore does not stop the vehicle by itself. Obstacles count at once; those with few pixels once a second frame shows them at the
same place.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..config.guard import GuardParams
from .braking import Braking
from .path_sight import Frame, PathSight, common_free_m
from .velocity_hold import HOLD_NS

NS = 1_000_000_000
SAME_COURSE_RAD = math.radians(3.0)
STALE_NS = 400_000_000
"""An older exposure shows nothing of the path."""
FRAME_BEFORE_NS = 150_000_000
"""An older frame does not stand in for the newest one along the course that follows."""
CONFIRM_NS = 500_000_000
REMEMBERED_NS = 3_000_000_000
"""The obstacle output remembers for so long."""
PLACE_M, PLACE_SHARE = 0.15, 0.1
"""Two frames show the same obstacle if its places agree within this much, and this share of the distance."""
NEAR_M = 2.5
"""Nearer, an obstacle with little support needs two more frames: it was not there in the frames in which it was farther away."""
LEAST_MOVING_M_S = 0.3
"""Slower, the vehicle stands for the purpose of stopping it before an obstacle."""
LIMIT_STEP_M_S = 0.5
PREDICT_S = 0.6
"""A speed limit works so much later: link and jerk limit. A vehicle that accelerates is faster by then."""
STOP_PREDICT_S = 0.4
"""A vehicle that accelerates gains speed for so long after a stop command, until the limited jerk has ended its acceleration: from
3 m/s2 at 4 m/s3 it gains 1.1 m/s."""
LATE_NS = 300_000_000
"""A velocity of this age or less is the present one: LOCAL_POSITION_NED may come at 4 Hz."""
LONGEST_UNMEASURED_NS = 500_000_000
"""With an older velocity the speed is not known."""
GAIN_M_S2 = 3.0
"""A vehicle whose velocity is late may have accelerated so much since: MPC_ACC_HOR of PX4, more than WPNAV_ACCEL."""
SLOPE_NS = 250_000_000
"""The acceleration is taken over this time."""


class Action(StrEnum):
    """What should follow. SLOW: ask for a lower speed."""

    PASS = "pass"
    SLOW = "slow"
    STOP = "stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """speed_m_s: of the vehicle as measured, None: not known; predicted_m_s: that it has when a limit could work. allowed_m_s:
    greatest speed for which the braking distance fits for another limit_ahead_s. room_m: free distance from the vehicle's middle. obstacle: an obstacle ends it, else it is only not
    seen farther. sees: the newest frame shows anything of the path. obstacle_stop: the braking distance does not fit before an
    obstacle, whatever is seen free; firm_stop: before one that the newest frame and another frame show with many pixels.
    cause: as text, for people."""

    action: Action
    speed_m_s: float | None
    predicted_m_s: float
    allowed_m_s: float
    room_m: float
    obstacle: bool
    sees: bool
    cause: str
    obstacle_stop: bool = False
    firm_stop: bool = False


class PathAssessor:
    """`take` each sight, `verdict` at any instant after."""

    def __init__(self, guard: GuardParams, braking: Braking, clear_share: float) -> None:
        """clear_share: of the corridor's rays that must be seen free."""
        self._guard, self._braking, self._clear_share = guard, braking, clear_share
        self._sights: deque[PathSight] = deque(maxlen=64)

    def take(self, sight: PathSight) -> None:
        """A new sight of the path."""
        self._sights.append(sight)

    def verdict(self, now_ns: int) -> Verdict | None:
        """None before the first sight, and while no velocity is known that is not older than HOLD_NS."""
        newest = self._sights[-1] if self._sights else None
        if newest is None or newest.speed_m_s is None:
            return None
        age_ns = now_ns - (newest.t_ns if newest.velocity_ns is None else newest.velocity_ns)
        if age_ns > HOLD_NS:
            return None
        measured = age_ns <= LONGEST_UNMEASURED_NS
        speed_m_s = newest.speed_m_s + GAIN_M_S2 * max(0, age_ns - LATE_NS) / NS
        way_m = speed_m_s * max(0, now_ns - newest.t_ns) / NS
        obstacle_m = self._obstacle_m(newest) - way_m
        obstacle_stop = self._must_stop_before(obstacle_m, speed_m_s)
        firm = self._must_stop_before(newest.obstacle_m - way_m, speed_m_s) and self._shown_before(newest.obstacle_m, 1)
        free_m = min(self._free_m(newest, now_ns), self._ahead_free_m(newest) - way_m)
        fresh = newest.exposed_ns is not None and now_ns - newest.exposed_ns <= STALE_NS
        shows = newest.free_m > 0.0 or math.isfinite(min(newest.obstacle_m, newest.weak_obstacle_m))
        room_m = max(0.0, min(obstacle_m, free_m))
        by_obstacle = obstacle_m <= free_m
        return Verdict(
            action=Action.STOP if obstacle_stop else self._action(speed_m_s, obstacle_m, free_m),
            speed_m_s=newest.speed_m_s if measured else None,
            predicted_m_s=self._predicted_m_s(speed_m_s),
            allowed_m_s=self._braking.speed_m_s(room_m, self._guard.limit_ahead_s),
            room_m=room_m,
            obstacle=by_obstacle,
            sees=fresh and shows and not newest.cause,
            cause=self._cause(newest, obstacle_m, free_m),
            obstacle_stop=obstacle_stop,
            firm_stop=firm,
        )

    def _must_stop_before(self, obstacle_m: float, speed_m_s: float) -> bool:
        needed_m = self._braking.needed_m(self._predicted_m_s(speed_m_s, STOP_PREDICT_S))
        return speed_m_s > LEAST_MOVING_M_S and needed_m > obstacle_m

    def _action(self, speed_m_s: float, obstacle_m: float, free_m: float) -> Action:
        braking, guard = self._braking, self._guard
        needed_m = braking.needed_m(self._predicted_m_s(speed_m_s, STOP_PREDICT_S))
        if self._coming_m_s(speed_m_s) > guard.blind_speed_m_s and needed_m > free_m:
            return Action.STOP
        ahead_m = braking.needed_m(self._predicted_m_s(speed_m_s), guard.limit_ahead_s)
        return Action.SLOW if ahead_m > min(obstacle_m, free_m) else Action.PASS

    def _predicted_m_s(self, speed_m_s: float, ahead_s: float = PREDICT_S) -> float:
        """speed_m_s and what the vehicle gains in ahead_s, if it accelerates on as measured."""
        return speed_m_s + max(0.0, self._gain_m_s2()) * ahead_s

    def _coming_m_s(self, speed_m_s: float) -> float:
        """speed_m_s less what a vehicle that gets slower loses until a stop command acts. It brakes already, as in a turn on the
        spot before the next leg, when the camera has left its course."""
        late = speed_m_s > (self._sights[-1].speed_m_s or 0.0)
        return speed_m_s if late else speed_m_s + min(0.0, self._gain_m_s2()) * STOP_PREDICT_S

    def _gain_m_s2(self) -> float:
        """Measured rate of the speed; 0: not known."""
        newest = self._sights[-1]
        newest_m_s = newest.speed_m_s or 0.0
        for sight in reversed(self._sights):
            age_ns = newest.t_ns - sight.t_ns
            if age_ns >= SLOPE_NS and sight.speed_m_s is not None:
                return (newest_m_s - sight.speed_m_s) * NS / age_ns if age_ns <= 2 * SLOPE_NS else 0.0
        return 0.0

    def _free_m(self, newest: PathSight, now_ns: int) -> float:
        """The farthest of what the sights of the last keep_free_s saw free, less the way since: of each ray, and of all together."""
        if now_ns - newest.t_ns > STALE_NS:  # the obstacle output does not decide any more
            return 0.0
        keep_ns = self._guard.keep_free_s * NS
        best_m = newest.free_m - _way_m(newest, newest, now_ns)
        rays_m = []
        for sight in self._sights:
            if sight is newest or (newest.t_ns - sight.t_ns <= keep_ns and _same_course(sight, newest)):
                way_m, reach_m = _way_m(sight, newest, now_ns), _reach_m(sight, newest, self._guard.side_m)
                best_m = max(best_m, min(sight.free_m, reach_m) - way_m)
                rays_m += [] if sight.rays_free_m is None else [np.minimum(sight.rays_free_m, reach_m) - way_m]
        if len(rays_m) > 1:
            best_m = max(best_m, common_free_m(np.max(rays_m, axis=0), self._clear_share))
        return max(0.0, best_m)

    def _ahead_free_m(self, newest: PathSight) -> float:
        """Seen free along the course that follows, each ray by the newest frame or the one before: a mismatch or a hole ends it in
        one."""
        older = [s.exposed_ns for s in self._sights if s.exposed_ns != newest.exposed_ns and s.exposed_ns is not None]
        if newest.exposed_ns is None or not older or newest.exposed_ns - older[-1] > FRAME_BEFORE_NS:
            return newest.ahead_free_m
        counted = [s for s in self._sights if s is newest or s.exposed_ns == older[-1]]
        rays_m = [
            np.minimum(s.ahead_rays_m, _reach_m(s, newest, self._guard.side_m))
            for s in counted
            if s.ahead_rays_m is not None
        ]
        together_m = common_free_m(np.max(rays_m, axis=0), self._clear_share) if len(rays_m) > 1 else 0.0
        return max(together_m, *(s.ahead_free_m for s in counted))

    def _obstacle_m(self, newest: PathSight) -> float:
        """The nearest obstacle in the newest sight, counted at its instant."""
        counted_m = min(newest.obstacle_m, self._remembered_m(newest))
        weak_m = newest.weak_obstacle_m
        if math.isfinite(weak_m) and self._shown_before(weak_m, 1 if weak_m >= NEAR_M else 2):
            return min(counted_m, weak_m)
        return counted_m

    def _remembered_m(self, newest: PathSight) -> float:
        """The nearest remembered obstacle. One just before the camera that frames have shown with few pixels alone counts as they do: the
        memory of the obstacle output keeps what one frame shows."""
        at_m = newest.remembered_m
        if at_m >= NEAR_M or self._frames_at(at_m, REMEMBERED_NS, weak=False):
            return at_m
        return math.inf if len(self._frames_at(at_m, REMEMBERED_NS, weak=True)) in (1, 2) else at_m

    def _shown_before(self, at_m: float, frames: int) -> bool:
        """Whether so many frames before the newest sight showed an obstacle at this place of the newest sight."""
        found = self._frames_at(at_m, CONFIRM_NS, weak=False) | self._frames_at(at_m, CONFIRM_NS, weak=True)
        return len(found - {self._sights[-1].frame_of(at_m)}) >= frames

    def _frames_at(self, at_m: float, within_ns: int, weak: bool) -> set[Frame]:
        """The frames of this time that showed an obstacle at this place of the newest sight. weak: with few pixels, else with many."""
        newest, found = self._sights[-1], set()
        slack_m = PLACE_M + PLACE_SHARE * at_m
        for sight in self._sights:
            before_m = sight.weak_obstacle_m if weak else sight.obstacle_m
            if newest.t_ns - sight.t_ns > within_ns or not math.isfinite(before_m):
                continue
            if abs(before_m - _way_m(sight, newest, newest.t_ns) - at_m) <= slack_m:
                found.add(sight.frame_of(before_m))
        return found

    def _cause(self, newest: PathSight, obstacle_m: float, free_m: float) -> str:
        if newest.cause and free_m <= 0.0:
            return newest.cause
        if obstacle_m <= free_m:
            return f"obstacle {obstacle_m:.1f} m ahead"
        return f"seen free for {free_m:.1f} m only"


def _same_course(a: PathSight, b: PathSight) -> bool:
    if a.course_rad is None or b.course_rad is None:
        return False
    return abs(math.remainder(a.course_rad - b.course_rad, math.tau)) <= SAME_COURSE_RAD


def _reach_m(sight: PathSight, newest: PathSight, side_m: float) -> float:
    """Distance to which the corridor of a sight lies within side_m beside, above or below that of the newest one."""
    if sight is newest or sight.course_rad is None or newest.course_rad is None:
        return math.inf
    beside_m = 0.0
    if sight.position_ned_m is not None and newest.position_ned_m is not None:
        north_m, east_m, down_m = (b - a for a, b in zip(sight.position_ned_m, newest.position_ned_m, strict=True))
        cos, sin = math.cos(newest.course_rad), math.sin(newest.course_rad)
        beside_m = math.hypot(cos * east_m - sin * north_m, down_m - newest.slope * (cos * north_m + sin * east_m))
    apart = math.hypot(math.sin(sight.course_rad - newest.course_rad), sight.slope - newest.slope)
    return max(0.0, side_m - beside_m) / max(apart, 1e-6)


def _way_m(sight: PathSight, newest: PathSight, now_ns: int) -> float:
    """Way from the place of a sight to the place at now_ns: by position, else by the greatest speed since."""
    speed_m_s = newest.speed_m_s or 0.0
    since_s = max(0, now_ns - newest.t_ns) / NS
    if sight is newest:
        return speed_m_s * since_s
    since_sight_s = (newest.t_ns - sight.t_ns) / NS
    if sight.position_ned_m is not None and newest.position_ned_m is not None:
        # not less than by speed: the estimate of the position may have jumped back
        slowest_m_s = min(speed_m_s, speed_m_s if sight.speed_m_s is None else sight.speed_m_s)
        moved_m = max(math.dist(sight.position_ned_m[:2], newest.position_ned_m[:2]), slowest_m_s * since_sight_s)
    else:
        moved_m = max(speed_m_s, sight.speed_m_s or 0.0) * since_sight_s
    return moved_m + speed_m_s * since_s

"""Verdict on the path: may the vehicle continue at its speed, must it slow down, or must it stop?

Input: a `PathSight` per decision of the obstacle output. Output: a `Verdict` at any instant.

Free space belongs to the world, not to a frame: space that an earlier frame showed free is still free a moment later,
nearer by the distance flown, unless a newer frame shows an obstacle in it. It counts for `KEEP_FREE_NS` from the
exposure of the frame and along nearly the same course, ray by ray, because holes of the depth image are at other places
in each frame. A frame that shows less, but no obstacle, therefore does not stop the vehicle. Obstacles count at once.
Those with weak support count when a second frame shows them at the same place."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams
from .braking import LIMIT_AHEAD_S, Braking
from .kept_space import Kept, Tolerance, grid_of, kept_free_m, reach_m
from .kept_views import KEEP_FREE_NS
from .path_sight import LEAST_SPEED_M_S, PathSight
from .turn import SLOWEST_M_S, WIDEST_RAD
from .velocity_hold import HOLD_NS

NS = 1_000_000_000
BLIND_SPEED_M_S = 0.7
"""For a slower vehicle unseen space is no reason to stop; an obstacle is."""
SAME_COURSE_RAD = math.radians(3.0)
STALE_NS = 400_000_000
"""An older exposure shows nothing of the path."""
FRAME_BEFORE_NS = 150_000_000
"""An older frame does not complete the newest one along the course that follows in a turn."""
CONFIRM_NS = 500_000_000
PLACE_M, PLACE_SHARE = 0.15, 0.1
"""Two frames show the same obstacle if its places differ by at most PLACE_M and PLACE_SHARE of the distance."""
NEAR_M = 2.5
"""A nearer obstacle with weak support must be shown by two more frames: it was not there in the frames in which it
was farther away."""
LIMIT_STEP_M_S = 0.5
PREDICT_S = 0.6
"""Time until a speed limit has an effect: link and limited jerk. An accelerating vehicle is faster by then."""
STOP_PREDICT_S = 0.4
"""Time after a stop command for which the speed changes as measured, until the limited jerk has ended it."""
GAINS_S, GROWTH, MOST_GAINED_M_S = 0.5, 1.5, 2.0
"""After Hold, PX4 gains 1.5 m/s from a steady 3 m/s2 (GAINS_S). While the acceleration grows, as at the beginning of a leg,
it has already commanded more than is measured, by GROWTH times the growth over SLOPE_NS: from 1.1 m/s it gains 1.4 to
2.1 m/s. No mission gains more than MOST_GAINED_M_S."""
LATE_NS = 300_000_000
"""A velocity of at most this age counts as the present one: LOCAL_POSITION_NED may be sent at 4 Hz."""
LONGEST_UNMEASURED_NS = 500_000_000
"""With an older velocity the speed is not known."""
GAIN_M_S2 = 3.0
"""Acceleration assumed since a late velocity: MPC_ACC_HOR of PX4, which is greater than WPNAV_ACCEL."""
SLOPE_NS = 250_000_000
"""Time over which the acceleration is measured."""


class Action(StrEnum):
    """What the vehicle should do. SLOW: fly at a lower speed."""

    PASS = "pass"
    SLOW = "slow"
    STOP = "stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on the path at an instant."""

    action: Action  # what the vehicle should do
    speed_m_s: float | None  # measured speed; None: not known
    predicted_m_s: float  # speed when a limit would have an effect
    allowed_m_s: float  # greatest speed for which the braking distance fits for another LIMIT_AHEAD_S
    room_m: float  # free distance from the vehicle's middle
    obstacle: bool  # an obstacle limits it; otherwise the path is not seen beyond
    sees: bool  # the newest frame shows something of the path
    cause: str  # reason, as text
    obstacle_stop: bool = False  # the braking distance does not fit before an obstacle, whatever space is free
    # it does not fit before an obstacle that the newest frame and another one show with many pixels
    firm_stop: bool = False
    course_rad: float | None = None  # direction of the path, clockwise from north; None: not known
    camera_fails: bool = False  # a camera gives no usable frame, or the frames are late


class PathAssessor:
    """Collects sights of the path by `take`; `verdict` may be called at any instant after."""

    def __init__(self, guard: GuardParams, braking: Braking, avoid: AvoidParams) -> None:
        self._guard, self._braking, self._clear_share = guard, braking, avoid.clear_share
        self._grid = grid_of(avoid, guard)
        self._tolerance = Tolerance(guard.side_m, guard.side_m)
        self._sights: deque[PathSight] = deque(maxlen=32)

    def take(self, sight: PathSight) -> None:
        """Adds a new sight of the path."""
        self._sights.append(sight)

    def verdict(self, now_ns: int) -> Verdict | None:
        """Returns the verdict; None before the first sight, and if the newest velocity is older than HOLD_NS."""
        newest = self._sights[-1] if self._sights else None
        if newest is None or newest.speed_m_s is None:
            return None
        age_ns = now_ns - _velocity_ns(newest)
        if age_ns > HOLD_NS:
            return None
        measured = age_ns <= LONGEST_UNMEASURED_NS
        speed_m_s = newest.speed_m_s + GAIN_M_S2 * max(0, age_ns - LATE_NS) / NS
        way_m = _way_m(newest, newest, now_ns, speed_m_s)
        obstacle_m = self._obstacle_m(newest) - way_m
        obstacle_stop = self._must_stop_before(obstacle_m, speed_m_s)
        firm = self._must_stop_before(newest.obstacle_m - way_m, speed_m_s)
        firm = firm and self._shown_before(newest.obstacle_m, 1, weak=False)
        free_m = self._free_m(newest, way_m, now_ns, speed_m_s)
        free_m = min(free_m, self._follows_free_m(newest, way_m, now_ns, speed_m_s))
        if not measured and newest.speed_m_s < LEAST_SPEED_M_S:  # the present direction of flight is not known
            free_m = 0.0
        fresh = newest.exposed_ns is not None and now_ns - newest.exposed_ns <= STALE_NS
        shows = newest.free_m > 0.0 or math.isfinite(min(newest.obstacle_m, newest.weak_obstacle_m))
        room_m = max(0.0, min(obstacle_m, free_m))
        by_obstacle = obstacle_m <= free_m
        return Verdict(
            action=Action.STOP if obstacle_stop else self._action(speed_m_s, obstacle_m, free_m),
            speed_m_s=newest.speed_m_s if measured else None,
            predicted_m_s=self._predicted_m_s(speed_m_s),
            allowed_m_s=self._braking.speed_m_s(room_m, LIMIT_AHEAD_S),
            room_m=room_m,
            obstacle=by_obstacle,
            sees=fresh and shows and not newest.cause,
            cause=self._cause(newest, obstacle_m, free_m),
            obstacle_stop=obstacle_stop,
            firm_stop=firm,
            course_rad=newest.course_rad,
            camera_fails=newest.camera_fails or not fresh,
        )

    def _must_stop_before(self, obstacle_m: float, speed_m_s: float) -> bool:
        """True if the braking distance does not fit before an obstacle at this distance."""
        needed_m = self._braking.needed_m(self._highest_m_s(speed_m_s))
        return speed_m_s > SLOWEST_M_S and needed_m > obstacle_m

    def _action(self, speed_m_s: float, obstacle_m: float, free_m: float) -> Action:
        """Returns the action for these distances to an obstacle and to the end of the free space."""
        braking = self._braking
        needed_m = braking.needed_m(self._highest_m_s(speed_m_s))
        if self._coming_m_s(speed_m_s) > BLIND_SPEED_M_S and needed_m > free_m:
            return Action.STOP
        ahead_m = braking.needed_m(self._predicted_m_s(speed_m_s), LIMIT_AHEAD_S)
        return Action.SLOW if ahead_m > min(obstacle_m, free_m) else Action.PASS

    def _predicted_m_s(self, speed_m_s: float) -> float:
        """Returns the speed in PREDICT_S, if the vehicle continues to accelerate as measured."""
        return speed_m_s + max(0.0, self._gains_m_s2()[0]) * PREDICT_S

    def _highest_m_s(self, speed_m_s: float) -> float:
        """Returns the speed that the vehicle reaches after a stop command."""
        gain_m_s2, before_m_s2 = self._gains_m_s2()
        growth_m_s2 = max(0.0, min(gain_m_s2 - before_m_s2, gain_m_s2))  # at a steady speed it is noise
        gained_m_s = min(MOST_GAINED_M_S, GAINS_S * (gain_m_s2 + GROWTH * growth_m_s2))
        return speed_m_s + max(0.0, gained_m_s, STOP_PREDICT_S * gain_m_s2)

    def _coming_m_s(self, speed_m_s: float) -> float:
        """Returns the speed when a stop command would act, for a vehicle that already brakes.

        A vehicle brakes for example before it turns on the spot for the next leg, when the camera does not look along
        the course any more."""
        late = speed_m_s > (self._sights[-1].speed_m_s or 0.0)
        loses_m_s2 = min(max(0.0, -self._gains_m_s2()[0]), self._guard.deceleration_m_s2)
        return speed_m_s if late else speed_m_s - loses_m_s2 * STOP_PREDICT_S

    def _gains_m_s2(self) -> tuple[float, float]:
        """Returns the measured rate of the speed over the last SLOPE_NS, 0 if it is not known, and over the SLOPE_NS
        before, the same if it is not known.

        By the stamps of the velocities, which several decisions may share."""
        newest = self._sights[-1]
        before = self._sight_before(newest)
        if before is None:
            return 0.0, 0.0
        earlier = self._sight_before(before)
        gain_m_s2 = _slope_m_s2(before, newest)
        return gain_m_s2, gain_m_s2 if earlier is None else _slope_m_s2(earlier, before)

    def _sight_before(self, sight: PathSight) -> PathSight | None:
        """Returns the newest sight with a velocity older by SLOPE_NS than that of another one; None: there is none, or
        it is older by more than twice that."""
        for older in reversed(self._sights):
            age_ns = _velocity_ns(sight) - _velocity_ns(older)
            if age_ns >= SLOPE_NS and older.speed_m_s is not None:
                return older if age_ns <= 2 * SLOPE_NS else None
        return None

    def _free_m(self, newest: PathSight, way_m: float, now_ns: int, speed_m_s: float) -> float:
        """Returns the distance to which the path is free by the frames exposed in the last KEEP_FREE_NS, less the
        distance flown since. way_m: that since the newest sight.

        It is the greatest of the distances of single sights, and of the rays of all sights together."""
        if now_ns - newest.t_ns > STALE_NS:  # the obstacle output has stopped
            return 0.0
        since_ns = now_ns - KEEP_FREE_NS
        best_m = newest.free_m - way_m
        older = []
        for sight in self._sights:
            kept = sight is not newest and sight.exposed_ns is not None and sight.exposed_ns >= since_ns
            if kept and _same_course(sight, newest):
                older.append(Kept(sight, _way_m(sight, newest, now_ns, speed_m_s)))
                best_m = max(best_m, min(sight.free_m, reach_m(sight, newest, self._tolerance)) - older[-1].way_m)
        return max(0.0, best_m, kept_free_m(Kept(newest, way_m), older, self._grid, self._clear_share, since_ns))

    def _follows_free_m(self, newest: PathSight, way_m: float, now_ns: int, speed_m_s: float) -> float:
        """Returns the distance to which a turn does not limit the free space of the present course.

        Where both courses are at most side_m apart, what is free along the present one counts for the next one, too, as
        for older sights. The noise of a measured velocity turns the course by less than that within the braking distance."""
        beside_m = math.inf
        if newest.ahead_rad != 0.0:
            beside_m = self._guard.side_m / math.tan(min(abs(newest.ahead_rad), WIDEST_RAD))
        return max(beside_m - way_m, self._ahead_free_m(newest, way_m, now_ns, speed_m_s))

    def _ahead_free_m(self, newest: PathSight, way_m: float, now_ns: int, speed_m_s: float) -> float:
        """Returns the distance to which the course that follows in a turn is free.

        By the newest frame, or by the one before as far as it shows the same course: a mismatch or a hole limits only
        one frame."""
        here_m = newest.ahead_free_m - way_m
        older = [s.exposed_ns for s in self._sights if s.exposed_ns != newest.exposed_ns and s.exposed_ns is not None]
        if newest.exposed_ns is None or not older or newest.exposed_ns - older[-1] > FRAME_BEFORE_NS:
            return here_m
        before_m = [
            min(s.ahead_free_m, reach_m(s, newest, self._tolerance, ahead=True)) - _way_m(s, newest, now_ns, speed_m_s)
            for s in self._sights
            if s is not newest and s.exposed_ns == older[-1] and math.isfinite(s.ahead_free_m)
        ]
        return max([here_m, *before_m])

    def _obstacle_m(self, newest: PathSight) -> float:
        """Returns the distance of the nearest obstacle that counts, at the instant of the newest sight."""
        counted_m = min(newest.obstacle_m, newest.remembered_m)
        weak_m = newest.weak_obstacle_m
        if math.isfinite(weak_m) and self._shown_before(weak_m, 1 if weak_m >= NEAR_M else 2):
            return min(counted_m, weak_m)
        return counted_m

    def _shown_before(self, at_m: float, frames: int, weak: bool = True) -> bool:
        """True if this number of frames before the newest sight showed an obstacle at this place. weak: those with weak
        support count."""
        newest, found = self._sights[-1], set()
        slack_m = PLACE_M + PLACE_SHARE * at_m
        now_m = at_m - _way_m(newest, newest, newest.t_ns)
        own = newest.frame_of(at_m)
        for sight in self._sights:
            if newest.t_ns - sight.t_ns > CONFIRM_NS:
                continue
            way_m = _way_m(sight, newest, newest.t_ns)
            for before_m in (sight.obstacle_m, sight.weak_obstacle_m if weak else math.inf):
                if abs(before_m - way_m - now_m) <= slack_m:
                    found.add(sight.frame_of(before_m))
        return len(found - {own}) >= frames

    def _cause(self, newest: PathSight, obstacle_m: float, free_m: float) -> str:
        """Returns the reason of the verdict, as text."""
        if newest.cause and free_m <= 0.0:
            return newest.cause
        if obstacle_m <= free_m:
            return f"obstacle {obstacle_m:.1f} m ahead"
        return f"seen free for {free_m:.1f} m only"


def _velocity_ns(sight: PathSight) -> int:
    """Returns the stamp of the velocity of a sight."""
    return sight.t_ns if sight.velocity_ns is None else sight.velocity_ns


def _shown_ns(sight: PathSight) -> int:
    """Returns the instant at whose place of the vehicle the distances of a sight begin."""
    return sight.t_ns if sight.shown_ns is None else sight.shown_ns


def _slope_m_s2(before: PathSight, after: PathSight) -> float:
    """Returns the rate of the speed between two sights."""
    gained_m_s = (after.speed_m_s or 0.0) - (before.speed_m_s or 0.0)
    return gained_m_s * NS / (_velocity_ns(after) - _velocity_ns(before))


def _same_course(a: PathSight, b: PathSight) -> bool:
    """True if two sights have nearly the same course."""
    if a.course_rad is None or b.course_rad is None:
        return False
    return abs(math.remainder(a.course_rad - b.course_rad, math.tau)) <= SAME_COURSE_RAD


def _way_m(sight: PathSight, newest: PathSight, now_ns: int, fastest_m_s: float | None = None) -> float:
    """Returns the distance flown to the place at now_ns, from the place at which the distances of a sight begin.

    By position if it is known, otherwise by the greatest speed since. fastest_m_s: speed that the vehicle may have
    now; None: that of the newest sight."""
    speed_m_s = newest.speed_m_s or 0.0
    from_ns = _shown_ns(newest) if sight is newest else newest.t_ns
    since_m = max(0, now_ns - from_ns) / NS * (speed_m_s if fastest_m_s is None else fastest_m_s)
    if sight is newest:
        return since_m
    since_sight_s = (newest.t_ns - _shown_ns(sight)) / NS
    before_m_s = speed_m_s if sight.speed_m_s is None else sight.speed_m_s
    if fastest_m_s is not None and fastest_m_s > speed_m_s:  # the velocity is late, and so is the position
        moved_m = fastest_m_s * since_sight_s
    elif sight.position_ned_m is not None and newest.position_ned_m is not None:
        # not less than by speed: the estimate of the position may have jumped back
        by_position_m = math.dist(sight.position_ned_m[:2], newest.position_ned_m[:2])
        moved_m = max(by_position_m, min(speed_m_s, before_m_s) * since_sight_s)
    else:
        moved_m = max(speed_m_s, before_m_s) * since_sight_s
    return moved_m + since_m

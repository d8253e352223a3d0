"""Model of ArduCopter's GUIDED mode with velocity targets before a wall, in one dimension, for closed-loop tests.

Simple avoidance changes the velocity target itself, in place, and limits the rate of the change to AVOID_ACCEL_MAX, counted from
the velocity that avoidance last gave; after 0.2 s in which it changed nothing it counts from the target. Inside of AVOID_MARGIN
it sets the target to zero; as long as the target is zero there is nothing to change. The next target that arrives, after more
than those 0.2 s, is therefore lowered from its full value at AVOID_ACCEL_MAX: the vehicle creeps on, by a little with each
target. LOITER is not concerned: there the velocity is computed again from the stick in each step.

Targets that climb or descend: the margin is laid along the velocity, so that only its horizontal part is kept from the wall. With
AVOID_BEHAVE = 1 a wall counts only if the vehicle would reach it before it could stop. LOITER is not concerned either: there the
velocity is passed on without its vertical part (AC_Loiter::calc_desired_velocity).

Sources: AC_Avoid.cpp (adjust_velocity, adjust_velocity_proximity, limit_velocity_3D, limit_accel, calc_backup_velocity_2D,
get_stopping_distance) and mode_guided.cpp of ArduCopter 4.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_S = 1.0 / 400.0
TIMEOUT_S = 0.2
"""AC_AVOID_ACCEL_TIMEOUT_MS."""
AVOID_ACCEL_M_S2 = 1.0
"""AC_AVOID_ACCEL_CMSS_MAX."""
BACKUP_SHARE = 0.4
"""Of the acceleration, for the speed of backing away."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedParams:
    """Parameters of ArduCopter in SI units, as delivered but for margin and backup speed."""

    margin_m: float = 3.0
    backup_speed_m_s: float = 0.75
    backup_deadzone_m: float = 0.1
    accel_max_m_s2: float = 3.0
    position_gain: float = 1.0
    acceleration_m_s2: float = 2.5
    stops: bool = False  # AVOID_BEHAVE is 1


def sqrt_speed_m_s(distance_m: float, gain: float, acceleration: float) -> float:
    """Speed from which the vehicle stops within a distance: proportional near, by the acceleration farther away."""
    linear_m = acceleration / gain**2
    if distance_m <= 0.0:
        return 0.0
    if distance_m < linear_m:
        return gain * distance_m
    return math.sqrt(2.0 * acceleration * (distance_m - 0.5 * linear_m))


def stopping_distance_m(speed_m_s: float, gain: float, acceleration: float) -> float:
    """Distance within which the vehicle stops."""
    if speed_m_s < acceleration / gain:
        return speed_m_s / gain
    return 0.5 * acceleration / gain**2 + 0.5 * speed_m_s**2 / acceleration


Velocity = tuple[float, float]
"""In m/s, towards the wall and up."""


@dataclass(slots=True)
class GuidedVehicle:
    """`target` as the companion or the ground station sends it, `step` at 400 Hz."""

    params: GuidedParams
    distance_m: float  # to the wall, as received
    speed_m_s: float = 0.0
    moves_wall: bool = False  # the wall keeps its distance, as the artificial one
    _target: Velocity = (0.0, 0.0)
    _desired: float = 0.0
    _previous: Velocity = (0.0, 0.0)
    _limited_s: float = -1e9
    _now_s: float = 0.0

    def target(self, speed_m_s: float, climb_m_s: float = 0.0) -> None:
        """A velocity target, towards the wall and up or down."""
        self._target = speed_m_s, climb_m_s

    def step(self) -> None:
        """One step of avoidance, of the position controller and of the vehicle."""
        p = self.params
        self._now_s += STEP_S
        self._target = self._adjusted(self._target)
        change = p.acceleration_m_s2 * STEP_S
        self._desired += max(-change, min(change, self._target[0] - self._desired))
        self.speed_m_s += (self._desired - self.speed_m_s) * STEP_S / 0.2
        if not self.moves_wall:
            self.distance_m -= self.speed_m_s * STEP_S

    def _limited(self, wanted: Velocity) -> Velocity:
        """What a target is limited to; one that is within the margin ends the climb, too."""
        p, (towards, climb) = self.params, wanted
        speed = math.hypot(towards, climb)
        if towards <= 0.0:
            return wanted
        if p.stops:
            ahead_m = 0.02 + p.margin_m + stopping_distance_m(speed, p.position_gain, AVOID_ACCEL_M_S2)
            if ahead_m * towards / speed < self.distance_m:
                return wanted
            if self.distance_m <= p.margin_m:
                return 0.0, 0.0
        room_m = self.distance_m - p.margin_m * towards / speed
        return min(towards, sqrt_speed_m_s(room_m, p.position_gain, AVOID_ACCEL_M_S2)), climb

    def _adjusted(self, wanted: Velocity) -> Velocity:
        p, room_m = self.params, self.distance_m - self.params.margin_m
        towards, climb = self._limited(wanted)
        if p.backup_speed_m_s > 0.0 and -room_m > p.backup_deadzone_m:
            back = sqrt_speed_m_s(-room_m, p.position_gain, BACKUP_SHARE * AVOID_ACCEL_M_S2)
            towards = min(towards, -min(back, p.backup_speed_m_s))
        safe = towards, climb
        if safe == wanted:
            return safe
        if p.accel_max_m_s2 > 0.0:
            safe = self._slowly(wanted, safe)
        if safe != wanted:
            self._limited_s = self._now_s
        return safe

    def _slowly(self, wanted: Velocity, safe: Velocity) -> Velocity:
        """The limit after AVOID_ACCEL_MAX, which counts for the whole change, also of the climb (limit_accel)."""
        if self._now_s - self._limited_s > TIMEOUT_S:
            self._previous = wanted
        (x, z), most = self._previous, self.params.accel_max_m_s2 * STEP_S
        change = math.hypot(safe[0] - x, safe[1] - z)
        if change > most:
            safe = x + (safe[0] - x) * most / change, z + (safe[1] - z) * most / change
        self._previous = safe
        return safe


def approach(
    params: GuidedParams, target_m_s: float, interval_s: float, seconds: float = 60.0, climb_m_s: float = 0.0
) -> tuple[float, float]:
    """(least distance, distance at the end) of a vehicle 15 m from a wall that gets the same target again and again."""
    vehicle = GuidedVehicle(params, 15.0)
    least_m, next_s = vehicle.distance_m, 0.0
    for step in range(round(seconds / STEP_S)):
        if step * STEP_S >= next_s:
            next_s += interval_s
            vehicle.target(target_m_s, climb_m_s)
        vehicle.step()
        least_m = min(least_m, vehicle.distance_m)
        if vehicle.distance_m <= 0.0:
            return vehicle.distance_m, vehicle.distance_m
    return least_m, vehicle.distance_m


def speed_at_the_artificial_wall_m_s(
    params: GuidedParams, target_m_s: tuple[float, float], inside_m: float, hz: float = 10.0
) -> float:
    """Greatest horizontal speed after 5 s, of a vehicle that gets the same target (towards the wall, up) again and again before a
    wall that keeps its distance. inside_m: how much nearer than the margin that is."""
    vehicle = GuidedVehicle(params, params.margin_m - inside_m, moves_wall=True)
    fastest, next_s = 0.0, 0.0
    for step in range(round(10.0 / STEP_S)):
        if step * STEP_S >= next_s:
            next_s += 1.0 / hz
            vehicle.target(*target_m_s)
        vehicle.step()
        if step * STEP_S > 5.0:
            fastest = max(fastest, vehicle.speed_m_s)
    return fastest

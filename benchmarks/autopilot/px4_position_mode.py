"""Models of PX4's Position mode with collision prevention, horizontal motion only, for closed-loop tests.

`VelocityPositionMode`: PX4 up to v1.15 with MPC_POS_MODE 0 or 3. The stick is a velocity, which collision prevention limits.
`AccelerationPositionMode`: PX4 v1.16 with MPC_POS_MODE 4. The stick is an acceleration against drag; collision prevention
changes the acceleration. The stick is what remains after MPC_XY_MAN_EXPO. Without data it sets the acceleration to zero, so
that the vehicle coasts until drag has stopped it. An obstacle nearer than CP_DIST scales the stick by a negative factor: the
vehicle flies backwards, the faster the harder the stick pushes forward.

All vectors are (x forward, y right) in the level frame with the vehicle's heading, which `turn` changes. Parameters have PX4's
default values. Sources: CollisionPrevention.cpp, FlightTaskManualPosition.cpp and StickAccelerationXY.cpp of PX4 v1.14.3 and
v1.16.0; trajectory/TrajMath.hpp for the speed from a braking distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.simulation.firmware_models.px4 import UNKNOWN, Px4Reader

Vector = NDArray[np.float64]
NS = 1_000_000_000
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4Params:
    """Parameters of PX4 with their default values, in SI units; names as in PX4."""

    cp_delay_s: float = 0.4
    cp_guide_ang_deg: float = 30.0
    mpc_vel_manual_m_s: float = 10.0
    mpc_acc_hor_m_s2: float = 3.0
    mpc_jerk_max_m_s3: float = 8.0
    mpc_xy_p: float = 0.95
    mpc_xy_vel_p_acc: float = 1.8
    mpc_tiltmax_air_deg: float = 45.0
    # the bin of a direction is the nearest one instead of the one below (v1.16 exists in both forms)
    round_index: bool = False
    # the same for the direction across the nearest obstacle alone, as in the development version of 2026
    round_across: bool = False

    @property
    def most_acceleration_m_s2(self) -> float:
        """At the largest tilt."""
        return GRAVITY_M_S2 * math.tan(math.radians(self.mpc_tiltmax_air_deg))


def speed_from_distance_m_s(jerk: float, acceleration: float, distance_m: float) -> float:
    """Largest speed from which the vehicle stops within a distance, with limited acceleration and jerk."""
    b = 4.0 * acceleration**2 / jerk
    return max(0.0, 0.5 * (-b + math.sqrt(b * b + 8.0 * acceleration * distance_m)))


def drag_m_s2(velocity: Vector, boost: float, p: Px4Params) -> Vector:
    """Acceleration that v1.16 subtracts in Position mode, for the velocity setpoint. boost: 1 while the stick is held, grows to
    the larger of 2 and sqrt(MPC_VEL_MANUAL) while it is released. Below 1 m/s it falls with the root of the speed, the more
    so the longer the stick is released."""
    speed = float(np.hypot(*velocity))
    released = min(1.0, max(0.0, boost - 1.0))
    mixed = released * math.sqrt(speed) + (1.0 - released) * speed if speed < 1.0 else speed
    out: Vector = boost * 2.0 * p.mpc_acc_hor_m_s2 / p.mpc_vel_manual_m_s * mixed * velocity / max(speed, 1e-9)
    return out


def direction_deg(v: Vector) -> float:
    """Angle of a vector clockwise from the nose, 0 to 360 degrees."""
    return math.degrees(math.atan2(v[1], v[0])) % 360.0


@dataclass(slots=True, eq=False)
class CollisionMap:
    """What collision prevention knows at one instant."""

    reader: Px4Reader
    params: Px4Params
    now_ns: int
    cm: Vector = field(init=False)  # (N,) value of each bin
    axes: Vector = field(init=False)  # (N, 2) unit vectors

    def __post_init__(self) -> None:
        self.cm = np.array(self.reader.bins_cm(self.now_ns), float)
        angle = np.radians(np.arange(len(self.cm)) * self.reader.bin_deg)
        self.axes = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def index(self, v: Vector, rounds: bool) -> int:
        """Bin of a direction. rounds: the nearest one instead of the one below."""
        return math.floor(direction_deg(v) / self.reader.bin_deg + (0.5 if rounds else 0.0)) % len(self.cm)

    def guided(self, direction: Vector) -> tuple[Vector, int]:
        """(direction, bin) after the guidance of CP_GUIDE_ANG: the bin nearby with the least cost of turning and of near
        obstacles."""
        own, count = self.index(direction, self.params.round_index), len(self.cm)
        reach = math.floor(self.params.cp_guide_ang_deg / self.reader.bin_deg)
        keep_cm = 100.0 * self.reader.cp_dist_m
        best, best_cost = own, 9999.0
        for step in range(-reach, reach + 1):
            i = (own + step) % count
            three = self.cm[[(i - 1) % count, i, (i + 1) % count]]
            mean = np.where(three == UNKNOWN, keep_cm, three).mean()
            cost = 0.5 * keep_cm * abs(step) - mean - self.cm[i]
            if cost < best_cost and self.cm[i] != UNKNOWN:
                best, best_cost = i, cost
        return (direction, own) if best == own else (self.axes[best], best)

    def stop_distances_m(self, velocity: Vector) -> tuple[NDArray[np.intp], Vector]:
        """(M,) bins with an obstacle or clear, (M,) distance within which the vehicle must stop towards each, metres."""
        bins = np.flatnonzero((self.cm > self.reader.min_cm) & (self.cm < UNKNOWN))
        speed = np.maximum(0.0, self.axes[bins] @ velocity)
        age_s = (self.now_ns - np.array(self.reader.updated_ns)[bins]) / NS
        in_range = self.cm[bins] < np.array(self.reader.ranges_cm)[bins]
        delay_m = speed * (self.params.cp_delay_s + np.where(in_range, age_s, 0.0))
        room_m: Vector = np.maximum(0.0, self.cm[bins] / 100.0 - self.reader.keep_m - delay_m)
        return bins, room_m


@dataclass(slots=True, eq=False)
class VelocityPositionMode:
    """PX4 up to v1.15, MPC_POS_MODE 0. `step` flies; position_m and velocity_m_s are the state of the vehicle."""

    reader: Px4Reader
    params: Px4Params = field(default_factory=Px4Params)
    position_m: Vector = field(default_factory=lambda: np.zeros(2))
    velocity_m_s: Vector = field(default_factory=lambda: np.zeros(2))
    _acceleration: Vector = field(default_factory=lambda: np.zeros(2))

    def turn(self, angle_rad: float) -> None:
        """Turns the heading clockwise: the state is given in the axes of the new heading, about the same origin."""
        self.position_m, self.velocity_m_s, self._acceleration = (
            _turned(v, angle_rad) for v in (self.position_m, self.velocity_m_s, self._acceleration)
        )

    def step(self, stick: Vector, dt_s: float, now_ns: int) -> None:
        """stick: (2,) forward and right, length 0 to 1."""
        setpoint = self._limited(self.params.mpc_vel_manual_m_s * stick, now_ns)
        wanted = self.params.mpc_xy_vel_p_acc * (setpoint - self.velocity_m_s)
        _fly(self, shortened(wanted, 5.0), dt_s)  # MPC_ACC_HOR_MAX

    def _limited(self, setpoint: Vector, now_ns: int) -> Vector:
        length = float(np.hypot(*setpoint))
        if not self.reader.has_data(now_ns) or length < 1e-3:
            return np.zeros(2)
        here = CollisionMap(self.reader, self.params, now_ns)
        direction, own = here.guided(setpoint / length)
        if not self.reader.feasible(own, now_ns):
            return np.zeros(2)
        speed = length
        bins, room_m = here.stop_distances_m(self.velocity_m_s)
        for i, distance_m in zip(bins, room_m, strict=True):
            along = float(here.axes[i] @ direction)
            if along > 0.01:
                p = self.params
                smooth = speed_from_distance_m_s(p.mpc_jerk_max_m_s3, p.mpc_acc_hor_m_s2, float(distance_m))
                speed = min(speed, min(p.mpc_xy_p * float(distance_m), smooth) / along)
        out: Vector = direction * speed
        return out


@dataclass(slots=True, eq=False)
class AccelerationPositionMode:
    """PX4 v1.16, MPC_POS_MODE 4. `step` flies; position_m and velocity_m_s are the state of the vehicle."""

    reader: Px4Reader
    params: Px4Params = field(default_factory=Px4Params)
    position_m: Vector = field(default_factory=lambda: np.zeros(2))
    velocity_m_s: Vector = field(default_factory=lambda: np.zeros(2))
    _acceleration: Vector = field(default_factory=lambda: np.zeros(2))
    _velocity_setpoint: Vector = field(default_factory=lambda: np.zeros(2))
    _slewed: Vector = field(default_factory=lambda: np.zeros(2))
    _boost: float = 1.0

    def turn(self, angle_rad: float) -> None:
        """Turns the heading clockwise: the state is given in the axes of the new heading, about the same origin."""
        self.position_m, self.velocity_m_s, self._acceleration = (
            _turned(v, angle_rad) for v in (self.position_m, self.velocity_m_s, self._acceleration)
        )
        self._velocity_setpoint, self._slewed = (_turned(v, angle_rad) for v in (self._velocity_setpoint, self._slewed))

    def step(self, stick: Vector, dt_s: float, now_ns: int) -> None:
        """stick: (2,) forward and right, length 0 to 1."""
        p = self.params
        wanted = self._modified(2.0 * p.mpc_acc_hor_m_s2 * stick, now_ns)
        drag = self._drag(stick, dt_s)
        still = float(np.hypot(*self._velocity_setpoint)) < float(np.hypot(*drag)) * dt_s
        turned_over = bool((np.sign(wanted) != np.sign(self._slewed)).any())
        if still and (turned_over or float(np.hypot(*wanted)) < 1e-3):
            drag, self._velocity_setpoint = np.zeros(2), np.zeros(2)
        self._slewed = self._slewed + shortened(wanted - drag - self._slewed, p.mpc_jerk_max_m_s3 * dt_s)
        acceleration = shortened(self._slewed, p.most_acceleration_m_s2)
        self._velocity_setpoint = self._velocity_setpoint + acceleration * dt_s
        feedback = p.mpc_xy_vel_p_acc * (self._velocity_setpoint - self.velocity_m_s)
        _fly(self, shortened(acceleration + feedback, p.most_acceleration_m_s2), dt_s)

    def _drag(self, stick: Vector, dt_s: float) -> Vector:
        p = self.params
        released = float(np.hypot(*stick)) < 1e-3
        target = max(2.0, math.sqrt(p.mpc_vel_manual_m_s)) if released else 1.0
        self._boost += (target - self._boost) * dt_s / (0.8 + dt_s)
        return drag_m_s2(self._velocity_setpoint, self._boost, p)

    def _modified(self, setpoint: Vector, now_ns: int) -> Vector:
        length = float(np.hypot(*setpoint))
        if not self.reader.has_data(now_ns):
            return np.zeros(2)
        if length < 1e-3:
            return setpoint
        here = CollisionMap(self.reader, self.params, now_ns)
        direction, own = here.guided(setpoint / length)
        out = np.zeros(2)
        if self.reader.feasible(own, now_ns):
            out = self._constrained(here, direction) * length
        return out + self._speed_compensation(here)

    def _constrained(self, here: CollisionMap, direction: Vector) -> Vector:
        """The part of the direction towards the nearest bin and the part across it, each scaled by its own distance. No data
        across counts as 655 m."""
        nearest = int(np.argmin(here.cm))
        towards = here.axes[nearest]
        if float(direction @ towards) <= 0.0:
            return direction
        normal = towards * float(direction @ towards)
        across = direction - normal
        rounds = self.params.round_index or self.params.round_across
        across_m = here.cm[here.index(across, rounds)] / 100.0 if float(np.hypot(*across)) > 1e-7 else 0.0
        out: Vector = across * self._scale(across_m) + normal * self._scale(here.cm[nearest] / 100.0)
        return out

    def _scale(self, distance_m: float) -> float:
        p, room_m = self.params, distance_m - self.reader.keep_m
        if room_m > 0.0:
            room_m = (room_m / max(self.reader.keep_m, p.mpc_vel_manual_m_s / p.mpc_xy_p)) ** 2
        return min(room_m, 1.0)

    def _speed_compensation(self, here: CollisionMap) -> Vector:
        p = self.params
        bins, room_m = here.stop_distances_m(self._velocity_setpoint)
        least, axis = 0.0, np.zeros(2)
        for i, distance_m in zip(bins, room_m, strict=True):
            speed = max(0.0, float(here.axes[i] @ self._velocity_setpoint))
            most = speed_from_distance_m_s(p.mpc_jerk_max_m_s3, p.mpc_acc_hor_m_s2, float(distance_m))
            if p.mpc_xy_vel_p_acc * (most - speed) < least:
                least, axis = p.mpc_xy_vel_p_acc * (most - speed), here.axes[i]
        out: Vector = least * axis
        return out


PositionMode = VelocityPositionMode | AccelerationPositionMode
ATTITUDE_LAG_S = 0.15
"""Time constant from a commanded acceleration to the vehicle's."""


def _fly(vehicle: PositionMode, wanted: Vector, dt_s: float) -> None:
    vehicle._acceleration = vehicle._acceleration + (wanted - vehicle._acceleration) * dt_s / (ATTITUDE_LAG_S + dt_s)
    vehicle.velocity_m_s = vehicle.velocity_m_s + vehicle._acceleration * dt_s
    vehicle.position_m = vehicle.position_m + vehicle.velocity_m_s * dt_s


def _turned(v: Vector, angle_rad: float) -> Vector:
    """A vector in axes that are turned clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * v[0] + s * v[1], c * v[1] - s * v[0]])


def shortened(v: Vector, most: float) -> Vector:
    """A vector in its direction, of at most this length."""
    length = float(np.hypot(*v))
    out: Vector = v * min(1.0, most / max(length, 1e-9))
    return out


def position_mode(version: tuple[int, int], cp_dist_m: float, params: Px4Params | None = None) -> PositionMode:
    """Position mode of a PX4 version (major, minor) in the parameter MPC_POS_MODE that brakes in it."""
    if version >= (1, 16):
        return AccelerationPositionMode(Px4Reader(5, cp_dist_m), params or Px4Params())
    return VelocityPositionMode(Px4Reader(10, cp_dist_m), params or Px4Params())

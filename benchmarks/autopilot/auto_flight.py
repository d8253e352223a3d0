"""Models of the modes in which an autopilot flies by itself, for closed-loop tests: mission, guided and stop modes.

`Px4AutoFlight`: Mission, Return, Offboard with velocity setpoints, Hold. The trajectory is limited in acceleration and jerk
(MPC_ACC_HOR, MPC_JERK_AUTO), Hold stops along it (Navigator: preproject_stop_point).
`CopterAutoFlight`: AUTO, RTL, GUIDED, BRAKE, LOITER. AUTO is limited by WPNAV_ACCEL (2.5 m/s2) and one jerk of 2 m/s3:
ArduCopter begins and ends legs with WPNAV_JERK (1 m/s3), which is slower, and follows a change of speed with PSC_JERK_XY (5 m/s3),
which is faster (AC_WPNav::advance_wp_target_along_track). BRAKE is limited by BRAKE_MODE_DECEL_RATE, the lean angle and
PSC_JERK_XY, LOITER by LOIT_BRK_ACCEL after LOIT_BRK_DELAY.

Both answer MAV_CMD_DO_SET_MODE, DO_REPOSITION and DO_CHANGE_SPEED as the sources do (see drivers.mavlink.commands). The vehicle is
a point with the lag of its attitude; horizontal motion only, the height is that of the mission. Without `wind` the air is still.
Positions in ned, metres.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.commands import (
    CHANGE_MODE_FLAG,
    COPTER_BRAKE,
    COPTER_LOITER,
    DO_CHANGE_SPEED,
    DO_REPOSITION,
    DO_SET_MODE,
    PX4_AUTO,
    PX4_AUTO_LOITER,
    px4_mode_number,
)
from drivers.simulation.flight_path import VehicleState, body_rates

from .px4_position_mode import ATTITUDE_LAG_S, GRAVITY_M_S2, shortened, speed_from_distance_m_s
from .wind import Wind, WindPush

Vector = NDArray[np.float64]
DRAG_PER_S = 0.15
"""Deceleration by the air for each m/s of airspeed, 1/s, assumed: the vehicle leans forward by 4.4 degrees at 5 m/s. It changes
the attitude, not the way to rest, since the controllers compensate it."""
PX4_MISSION, PX4_RETURN = px4_mode_number(PX4_AUTO, 4), px4_mode_number(PX4_AUTO, 5)
PX4_HOLD, PX4_OFFBOARD = px4_mode_number(PX4_AUTO, PX4_AUTO_LOITER), px4_mode_number(6, 0)
COPTER_AUTO, COPTER_GUIDED, COPTER_RTL = 3, 4, 6
ACCEPTED, DENIED, FAILED = 0, 2, 4
"""MAV_RESULT."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Of the horizontal motion, SI units."""

    acceleration_m_s2: float
    jerk_m_s3: float
    delay_s: float = 0.0  # before a stop mode begins to brake


class Yaw(StrEnum):
    """Heading in the modes in which the autopilot flies by itself. FIRST: to the next waypoint before it flies there (PX4
    MPC_YAW_MODE 4). WAYPOINT: to the next waypoint while it flies (0). PATH: along the velocity (3; ArduCopter WP_YAW_BEHAVIOR 1
    and 3). FIXED: unchanged (5; 0)."""

    FIRST = "first"
    WAYPOINT = "waypoint"
    PATH = "path"
    FIXED = "fixed"


@dataclass(slots=True, eq=False)
class AutoFlight(ABC):
    """`command` with each COMMAND_LONG, `step` flies."""

    # (N, 2), flown in order. acceptance_m: the next waypoint counts from this distance on, and the vehicle flies
    # through the corner; 0: it stops at each
    waypoints_m: Vector
    height_m: float
    cruise_m_s: float
    mode: int
    position_m: Vector = field(default_factory=lambda: np.zeros(2))
    velocity_m_s: Vector = field(default_factory=lambda: np.zeros(2))
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = math.radians(60.0)
    yaw: Yaw = Yaw.FIRST  # see Yaw
    acceptance_m: float = 0.0
    velocity_target_m_s: Vector = field(default_factory=lambda: np.zeros(2))  # (2,) of Offboard or GUIDED
    ignores_commands: bool = False  # commands are not received
    stubborn: bool = False  # they are acknowledged and have no effect
    next_waypoint: int = 0
    wind: Wind | None = None
    _push: WindPush | None = None
    _speed_m_s: float = field(init=False)
    _wanted_acceleration: Vector = field(default_factory=lambda: np.zeros(2))
    _acceleration: Vector = field(default_factory=lambda: np.zeros(2))
    _mode_s: float = 0.0
    _turn_rad_s: float = 0.0
    _lean_rad: tuple[float, float] = (0.0, 0.0)
    _lean_rates_rad_s: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        self._speed_m_s = self.cruise_m_s
        self._lean_rad = self._lean()

    # ---- of one autopilot --------------------------------------------------------------------------------------------

    @abstractmethod
    def _mission_modes(self) -> tuple[int, ...]: ...

    @abstractmethod
    def _guided_mode(self) -> int: ...

    @abstractmethod
    def _limits(self) -> Limits: ...

    @abstractmethod
    def _set_mode(self, message: Any) -> int: ...

    @abstractmethod
    def _reposition(self, message: Any) -> int: ...

    @abstractmethod
    def _change_speed(self, speed_m_s: float) -> int: ...

    # ---- in ---------------------------------------------------------------------------------------------------------

    def command(self, message: Any) -> int | None:
        """MAV_RESULT of a COMMAND_LONG; None: no answer, since it is not received or not one of these."""
        if self.ignores_commands:
            return None
        if message.command == DO_SET_MODE:
            return ACCEPTED if self.stubborn else self._set_mode(message)
        if message.command == DO_REPOSITION:
            return ACCEPTED if self.stubborn else self._reposition(message)
        if message.command == DO_CHANGE_SPEED:
            return ACCEPTED if self.stubborn else self._change_speed(float(message.param2))
        return None

    def mission_speed(self, speed_m_s: float) -> None:
        """A speed item of the mission (MAV_CMD_DO_CHANGE_SPEED) is reached: its speed replaces the one commanded last."""
        if self.mode in self._mission_modes():
            self._speed_m_s = speed_m_s

    def enter(self, mode: int) -> None:
        """Changes the mode, as by the pilot."""
        if mode != self.mode:
            self.mode, self._mode_s = mode, 0.0
            self._speed_m_s = self.cruise_m_s

    # ---- motion -----------------------------------------------------------------------------------------------------

    @property
    def finished(self) -> bool:
        """Whether the last waypoint was reached."""
        return self.next_waypoint >= len(self.waypoints_m)

    def step(self, dt_s: float) -> None:
        """Flies for a short time, 20 ms or less."""
        self._mode_s += dt_s
        limits, target = self._limits(), self._velocity_target()
        wanted = np.zeros(2)
        if target is not None:
            wanted = _towards(self.velocity_m_s, target, limits)
        elif self._mode_s >= limits.delay_s:
            wanted = _towards(self.velocity_m_s, np.zeros(2), limits)
        change = wanted - self._wanted_acceleration
        most = limits.jerk_m_s3 * dt_s
        self._wanted_acceleration = self._wanted_acceleration + shortened(change, most)
        self._acceleration += (self._wanted_acceleration - self._acceleration) * dt_s / (ATTITUDE_LAG_S + dt_s)
        self.velocity_m_s = self.velocity_m_s + (self._acceleration + self._pushed_m_s2(dt_s)) * dt_s
        self.position_m = self.position_m + self.velocity_m_s * dt_s
        self._turn(dt_s)
        before, self._lean_rad = self._lean_rad, self._lean()
        self._lean_rates_rad_s = (
            (self._lean_rad[0] - before[0]) / dt_s,
            (self._lean_rad[1] - before[1]) / dt_s,
        )

    def _pushed_m_s2(self, dt_s: float) -> Vector:
        """(2,) by the wind."""
        if self.wind is None:
            return np.zeros(2)
        if self._push is None:
            self._push = WindPush(self.wind, DRAG_PER_S)
        return self._push.step(dt_s)

    def _velocity_target(self) -> Vector | None:
        """(2,) m/s; None: the vehicle brakes."""
        if self.mode == self._guided_mode():
            return self.velocity_target_m_s
        if self.mode not in self._mission_modes() or self.finished:
            return None
        to_go = self.waypoints_m[self.next_waypoint] - self.position_m
        distance_m = float(np.hypot(*to_go))
        corner_m_s = self._corner_speed_m_s()
        if distance_m < self.acceptance_m and corner_m_s > 0.0:
            self.next_waypoint += 1
            return self._velocity_target()
        if distance_m < 0.3 and float(np.hypot(*self.velocity_m_s)) < 0.5:
            self.next_waypoint += 1
            return np.zeros(2)
        if self.yaw is Yaw.FIRST and abs(self._yaw_error()) > math.radians(10.0) and distance_m > 1.0:
            return np.zeros(2)
        limits = self._limits()
        # margin for the lag of the attitude
        speed = speed_from_distance_m_s(limits.jerk_m_s3, 0.8 * limits.acceleration_m_s2, 0.8 * distance_m)
        speed = max(corner_m_s, min(speed, 1.5 * distance_m))
        out: Vector = to_go / max(distance_m, 1e-6) * min(self._speed_m_s, speed)
        return out

    def _corner_speed_m_s(self) -> float:
        """Speed at which the vehicle flies through the next waypoint; 0: it stops there. After PX4's computeMaxSpeedInWaypoint:
        sqrt(a d tan(alpha / 2)) with half of the acceleration (MPC_XY_TRAJ_P), the acceptance radius d and the angle alpha between
        the legs. ArduCopter's own corners are not modelled; theirs pass within WPNAV_RADIUS, too."""
        if self.acceptance_m <= 0.0 or self.next_waypoint + 1 >= len(self.waypoints_m):
            return 0.0
        before = self.waypoints_m[self.next_waypoint - 1] if self.next_waypoint else np.zeros(2)
        here, after = self.waypoints_m[self.next_waypoint], self.waypoints_m[self.next_waypoint + 1]
        back, on = before - here, after - here
        cos = float(back @ on) / max(float(np.hypot(*back)) * float(np.hypot(*on)), 1e-9)
        half = 0.5 * math.acos(max(-1.0, min(1.0, cos)))
        lateral_m_s2 = 0.5 * self._limits().acceleration_m_s2
        return math.sqrt(lateral_m_s2 * self.acceptance_m * min(math.tan(half), 100.0))

    def _yaw_error(self) -> float:
        """From the heading to the direction that it should have, radians."""
        if self.yaw is Yaw.FIXED:
            return 0.0
        if self.yaw is Yaw.PATH and self.mode in self._mission_modes():
            wanted = self.velocity_m_s
        elif self.mode == self._guided_mode():
            wanted = self.velocity_target_m_s
        elif self.mode in self._mission_modes() and not self.finished:
            wanted = self.waypoints_m[self.next_waypoint] - self.position_m
        else:
            return 0.0
        if float(np.hypot(*wanted)) < 0.5:
            return 0.0
        return math.remainder(math.atan2(wanted[1], wanted[0]) - self.heading_rad, math.tau)

    def _turn(self, dt_s: float) -> None:
        wanted = max(-self.yaw_rate_rad_s, min(self.yaw_rate_rad_s, 2.0 * self._yaw_error()))
        self._turn_rad_s += (wanted - self._turn_rad_s) * dt_s / (0.2 + dt_s)
        self.heading_rad = math.remainder(self.heading_rad + self._turn_rad_s * dt_s, math.tau)

    @property
    def speed_m_s(self) -> float:
        """Horizontal."""
        return float(np.hypot(*self.velocity_m_s))

    def state(self) -> VehicleState:
        """Position, velocity, attitude and the body rates of the step flown last."""
        euler = (*self._lean(), self.heading_rad)
        x, y = self.position_m
        return VehicleState(
            position_ned_m=(float(x), float(y), -self.height_m),
            velocity_ned_m_s=(float(self.velocity_m_s[0]), float(self.velocity_m_s[1]), 0.0),
            euler_rad=euler,
            rates_frd_rad_s=body_rates(euler, (*self._lean_rates_rad_s, self._turn_rad_s)),
        )

    def _lean(self) -> tuple[float, float]:
        """Roll and pitch in rad, at which the thrust bears the weight, accelerates the vehicle and holds it against the air:
        tan(pitch) = -forward / g, tan(roll) = right / g * cos(pitch), from R = Rz Ry Rx."""
        air_m_s = np.zeros(2) if self._push is None else self._push.compensated_m_s
        lean = (self._acceleration + DRAG_PER_S * (self.velocity_m_s - air_m_s)) / GRAVITY_M_S2
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        forward, right = c * lean[0] + s * lean[1], c * lean[1] - s * lean[0]
        pitch = -math.atan(forward)
        return math.atan(right * math.cos(pitch)), pitch


class Px4AutoFlight(AutoFlight):
    """PX4 with default parameters."""

    def enter(self, mode: int) -> None:
        """From Offboard the trajectory of Hold begins with the velocity setpoint and without acceleration
        (FlightTaskAuto::activate). The vehicle is given that velocity if it is slower: its way to rest is then not too short."""
        if self.mode == PX4_OFFBOARD and mode == PX4_HOLD:
            self._wanted_acceleration, self._acceleration = np.zeros(2), np.zeros(2)
            if float(np.hypot(*self.velocity_target_m_s)) > self.speed_m_s:
                self.velocity_m_s = self.velocity_target_m_s.copy()
        super().enter(mode)

    def _mission_modes(self) -> tuple[int, ...]:
        return PX4_MISSION, PX4_RETURN

    def _guided_mode(self) -> int:
        return PX4_OFFBOARD

    def _limits(self) -> Limits:
        if self.mode == PX4_OFFBOARD:  # the setpoint is not smoothed; MPC_ACC_HOR_MAX
            return Limits(acceleration_m_s2=5.0, jerk_m_s3=20.0)
        return Limits(acceleration_m_s2=3.0, jerk_m_s3=4.0)

    def _set_mode(self, message: Any) -> int:
        if not int(message.param1) & 1:
            return DENIED
        self.enter(px4_mode_number(int(message.param2), int(message.param3)))
        return ACCEPTED

    def _reposition(self, message: Any) -> int:
        if int(message.param2) & CHANGE_MODE_FLAG:
            self.enter(PX4_HOLD)
        return ACCEPTED

    def _change_speed(self, speed_m_s: float) -> int:
        """Accepted in every mode; without effect in Offboard. Not above 0: the default speed."""
        self._speed_m_s = speed_m_s if speed_m_s > 0.0 else self.cruise_m_s
        return ACCEPTED


class CopterAutoFlight(AutoFlight):
    """ArduCopter with default parameters."""

    def _mission_modes(self) -> tuple[int, ...]:
        return COPTER_AUTO, COPTER_RTL

    def _guided_mode(self) -> int:
        return COPTER_GUIDED

    def _limits(self) -> Limits:
        if self.mode == COPTER_BRAKE:  # BRAKE_MODE_DECEL_RATE is 7.5; ANGLE_MAX of 30 degrees gives less
            return Limits(acceleration_m_s2=5.0, jerk_m_s3=5.0)
        if self.mode == COPTER_LOITER:
            return Limits(acceleration_m_s2=2.5, jerk_m_s3=5.0, delay_s=1.0)
        if self.mode == COPTER_GUIDED:
            return Limits(acceleration_m_s2=2.5, jerk_m_s3=5.0)
        return Limits(acceleration_m_s2=2.5, jerk_m_s3=2.0)

    def _set_mode(self, message: Any) -> int:
        if not int(message.param1) & 1:
            return DENIED
        self.enter(int(message.param2))
        return ACCEPTED

    def _reposition(self, message: Any) -> int:
        """Coordinates are needed; GUIDED to a place is not modelled."""
        return DENIED

    def _change_speed(self, speed_m_s: float) -> int:
        if speed_m_s <= 0.0:
            return DENIED
        if self.mode not in (COPTER_AUTO, COPTER_RTL, COPTER_GUIDED):
            return FAILED
        self._speed_m_s = speed_m_s
        return ACCEPTED


def _towards(velocity: Vector, target: Vector, limits: Limits) -> Vector:
    """Acceleration that brings the velocity to the target without passing it, with limited jerk."""
    gap = target - velocity
    size = float(np.hypot(*gap))
    most = min(limits.acceleration_m_s2, 2.0 * size, math.sqrt(1.2 * limits.jerk_m_s3 * size))
    out: Vector = gap / max(size, 1e-9) * most
    return out

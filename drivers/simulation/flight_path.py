"""A smooth path through waypoints whose position, attitude and rates are known at every instant."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from core.frames import quaternion_from_euler, rotation_from_euler

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]


def body_rates(euler_rad: Triple, euler_rates_rad_s: Triple) -> Triple:
    """Body rates p, q, r in frd (rad/s) of roll, pitch, yaw and their derivatives (R = Rz Ry Rx)."""
    roll, pitch, _ = euler_rad
    d_roll, d_pitch, d_yaw = euler_rates_rad_s
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return (d_roll - d_yaw * sp, d_pitch * cr + d_yaw * sr * cp, -d_pitch * sr + d_yaw * cr * cp)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VehicleState:
    """The vehicle at one instant: ned metres and m/s, angles of R_ned_frd = Rz(yaw) Ry(pitch) Rx(roll), body
    rates."""

    position_ned_m: Triple
    velocity_ned_m_s: Triple
    euler_rad: Triple
    rates_frd_rad_s: Triple

    @property
    def R_ned_frd(self) -> Floats:
        """(3, 3) float64."""
        return rotation_from_euler(*self.euler_rad)

    @property
    def q_ned_frd_wxyz(self) -> tuple[float, float, float, float]:
        """Unit quaternion."""
        return quaternion_from_euler(*self.euler_rad)


class FlightPath:
    """Cubic splines through waypoints, at rest at both ends, with an optional swaying of the attitude.

    Before the first and after the last waypoint the vehicle hovers there (and goes on swaying)."""

    def __init__(
        self, waypoints: list[list[float]], *, sway_rad: Triple = (0.0, 0.0, 0.0), sway_hz: float = 0.7
    ) -> None:
        """waypoints: rows of t (s, increasing), x, y, z (ned, m), roll, pitch, yaw (rad; yaw not wrapped).

        sway_rad: amplitude of a sine added to roll, pitch and yaw, each a third of a period apart."""
        table = np.array(waypoints, dtype=np.float64)
        if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] != 7 or not np.all(np.isfinite(table)):
            raise ValueError("flight path: expected two or more finite rows of t, x, y, z, roll, pitch, yaw")
        if not np.all(np.diff(table[:, 0]) > 0.0):
            raise ValueError("flight path: the times of the waypoints must increase")
        spline = CubicSpline(table[:, 0], table[:, 1:], bc_type="clamped")
        # per piece and quantity, highest power first, as plain numbers: see `_value`
        self._pieces = spline.c.transpose(1, 2, 0).tolist()
        self._slopes = spline.derivative().c.transpose(1, 2, 0).tolist()
        self._begin_s: list[float] = table[:, 0].tolist()
        self._sway_rad, self._sway_rad_s = sway_rad, 2.0 * math.pi * sway_hz

    @property
    def duration_s(self) -> float:
        """Time of the last waypoint."""
        return self._begin_s[-1]

    def at(self, t_s: float) -> VehicleState:
        """The vehicle t_s after the start of the flight."""
        inside = min(max(t_s, self._begin_s[0]), self.duration_s)
        piece = min(bisect_right(self._begin_s, inside), len(self._pieces)) - 1
        since_s = inside - self._begin_s[piece]
        value = [_value(powers, since_s) for powers in self._pieces[piece]]
        slope = [_value(powers, since_s) for powers in self._slopes[piece]] if inside == t_s else [0.0] * 6
        angles, turn = value[3:], slope[3:]
        for i, sway_rad in enumerate(self._sway_rad):
            phase = self._sway_rad_s * t_s + 2.0 * math.pi / 3.0 * i
            angles[i] += sway_rad * math.sin(phase)
            turn[i] += sway_rad * self._sway_rad_s * math.cos(phase)
        return VehicleState(
            position_ned_m=_triple(value),
            velocity_ned_m_s=_triple(slope),
            euler_rad=_triple(angles),
            rates_frd_rad_s=body_rates(_triple(angles), _triple(turn)),
        )


def _value(powers: list[float], since_s: float) -> float:
    """A polynomial, highest power first, summed as scipy does, whose call for one instant takes several times as long."""
    total, power = 0.0, 1.0
    for factor in reversed(powers):
        total += factor * power
        power *= since_s
    return total


def _triple(a: list[float]) -> Triple:
    return a[0], a[1], a[2]

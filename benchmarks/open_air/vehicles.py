"""Autopilot models with a place and a heading, as the closed loops over open ground fly them.

Positions and velocities are (north, east). The stick is the wanted velocity in m/s, forward and right of the heading; the height
is not part of the models."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.autopilot.px4_position_mode import PositionMode, Px4Params, position_mode
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader

MARGIN_M = 3.0
"""CP_DIST and AVOID_MARGIN."""
PRX_FILT_HZ = 1.0
"""The lower of the values of docs/how-to/connect-ardupilot.md: the slower one."""
ACCELERATION_M_S2 = 2.5
AUTOPILOTS = ("PX4", "PX4 1.16", "ArduPilot")
Vector = NDArray[np.float64]


def rotated(v: Vector, angle_rad: float) -> Vector:
    """A vector (2,) turned clockwise, from axes with a heading to those of north and east."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])


class Vehicle(Protocol):
    """A vehicle with an autopilot that gets OBSTACLE_DISTANCE."""

    heading_rad: float

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message."""

    def step(self, stick_m_s: Vector, turn_rad: float, dt_s: float, now_ns: int) -> tuple[Vector, Vector]:
        """(position in m, velocity in m/s) after a step in which the heading turns clockwise by turn_rad."""


@dataclass(slots=True)
class Px4Vehicle:
    """PX4 in Position mode."""

    mode: PositionMode = field(default_factory=lambda: position_mode((1, 15), MARGIN_M))
    heading_rad: float = 0.0

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message."""
        self.mode.reader.read(message, now_ns)

    def step(self, stick_m_s: Vector, turn_rad: float, dt_s: float, now_ns: int) -> tuple[Vector, Vector]:
        """(position in m, velocity in m/s) after a step in which the heading turns clockwise by turn_rad."""
        self.heading_rad += turn_rad
        self.mode.turn(turn_rad)
        self.mode.step(np.asarray(stick_m_s) / self.mode.params.mpc_vel_manual_m_s, dt_s, now_ns)
        return rotated(self.mode.position_m, self.heading_rad), rotated(self.mode.velocity_m_s, self.heading_rad)


@dataclass(slots=True)
class CopterVehicle:
    """ArduCopter in LOITER: its velocity follows what simple avoidance allows. It stands until the first message, without which
    it does not arm, and flies on when messages stop."""

    reader: ArduPilotReader = field(default_factory=lambda: ArduPilotReader(margin_m=MARGIN_M, filter_hz=PRX_FILT_HZ))
    heading_rad: float = 0.0
    position_m: Vector = field(default_factory=lambda: np.zeros(2))
    velocity_m_s: Vector = field(default_factory=lambda: np.zeros(2))
    _armed: bool = False

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message."""
        self._armed = True
        self.reader.read(message, now_ns)

    def step(self, stick_m_s: Vector, turn_rad: float, dt_s: float, now_ns: int) -> tuple[Vector, Vector]:
        """(position in m, velocity in m/s) after a step in which the heading turns clockwise by turn_rad."""
        self.heading_rad += turn_rad
        allowed = np.zeros(2)
        if self._armed:
            allowed = np.array(self.reader.velocity_m_s((float(stick_m_s[0]), float(stick_m_s[1])), now_ns))
        change = rotated(allowed, self.heading_rad) - self.velocity_m_s
        slows = float(change @ self.velocity_m_s) < 0.0
        most = ACCELERATION_M_S2 * dt_s * (1.5 if slows else 1.0)
        self.velocity_m_s = self.velocity_m_s + change * min(1.0, most / max(float(np.hypot(*change)), 1e-9))
        self.position_m = self.position_m + self.velocity_m_s * dt_s
        return self.position_m, self.velocity_m_s


def vehicle_of(autopilot: str, guide_ang_deg: float = 30.0) -> Vehicle:
    """A vehicle by the name of its autopilot. guide_ang_deg: CP_GUIDE_ANG. Raises ValueError for a name that does not exist."""
    if autopilot not in AUTOPILOTS:
        raise ValueError(f"no autopilot {autopilot!r}; there are: {', '.join(AUTOPILOTS)}")
    if autopilot == "ArduPilot":
        return CopterVehicle()
    version = (1, 16) if autopilot.endswith("1.16") else (1, 15)
    return Px4Vehicle(position_mode(version, MARGIN_M, Px4Params(cp_guide_ang_deg=guide_ang_deg)))

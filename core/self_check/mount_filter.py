"""Separates the error of the mount from the slope of the terrain by a Kalman filter, as the vehicle turns.

State: delta (3), the small rotation in frd from the configured to the true mount, and terrain (2), the inclination of
the ground to the north and east. The apparent slope in the level axes of a heading is, to first order,

    s = terrain rotated into these axes + (omega_y, -omega_x),   omega = R_level_frd delta

Delta turns with the vehicle and the terrain does not. At one heading only their sum is known, as the covariance
shows. The terrain is a random walk. A measurement that fits badly increases the uncertainty of the terrain, not of
the mount."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

N = 5
DELTA_SD_RAD = math.radians(10.0)
YAW_SD_RAD = math.radians(3.0)
"""Prior of the yaw of the mount, which affects a slope only while the vehicle is tilted."""
TERRAIN_SD_RAD = math.radians(10.0)
DELTA_WALK_RAD = math.radians(0.02)
"""Per square root of a second. A mount is fixed, but may come loose."""
SLOPE_SD_RAD = math.radians(0.5)
"""Noise of one measured slope: the ground is not quite plane, and the attitude has an error."""
FORGOTTEN_SD_RAD = 100.0
"""Standard deviation of a forgotten terrain: of nothing known. With that of a new terrain each gap of the attitude, four times a second
at 4 Hz, would estimate the mount from the expectation that terrain is level; with a half turn some hundred gaps would."""
WALLS_SD_RAD = math.radians(2.0)
"""Noise of the terrain's slope as the walls show it."""
GATE = 9.0
"""Squared innovation over its variance above which the terrain has changed."""
MOUNT_JUMP_RAD = math.radians(0.2)
"""Uncertainty of the mount added by each such change: it may have been the mount that moved."""
MAX_DT_S = 60.0
"""Longest time for which the mount may come loose between two frames. The terrain changes in any time."""
_UPPER = np.triu_indices(N)


@dataclass(frozen=True, slots=True)
class FilterState:
    """State of the filter.

    Attributes:
        mean: (delta x, y, z, terrain north, east), rad.
        covariance: upper triangle row by row, 15 numbers."""

    mean: tuple[float, ...] = (0.0,) * N
    covariance: tuple[float, ...] = tuple(
        float(v)
        for v in np.diag([DELTA_SD_RAD**2, DELTA_SD_RAD**2, YAW_SD_RAD**2, TERRAIN_SD_RAD**2, TERRAIN_SD_RAD**2])[
            _UPPER
        ]
    )


class MountFilter:
    """The filter with its state unpacked: `predict`, `slope`, `walls`, then `state`."""

    def __init__(self, state: FilterState) -> None:
        self.mean: Floats = np.array(state.mean)
        self.P: Floats = np.zeros((N, N))
        self.P[_UPPER] = state.covariance
        self.P = self.P + np.triu(self.P, 1).T

    def state(self) -> FilterState:
        """Returns the state from which the next frame continues."""
        return FilterState(tuple(self.mean.tolist()), tuple(self.P[_UPPER].tolist()))

    def error(self) -> tuple[float, float]:
        """Returns the size of the error in roll and pitch, rad, and its standard deviation in its direction, rad."""
        size = math.hypot(self.mean[0], self.mean[1])
        return size, sd_along(self.P[:2, :2], self.mean[:2] / size) if size > 0.0 else 0.0

    def predict(self, dt_s: float, terrain_walk_rad: float) -> None:
        """Adds the process noise of a time step."""
        dt = max(dt_s, 0.0)
        walk = [DELTA_WALK_RAD, DELTA_WALK_RAD, DELTA_WALK_RAD, terrain_walk_rad, terrain_walk_rad]
        for i, rate in enumerate(walk):
            limit = (DELTA_SD_RAD, DELTA_SD_RAD, YAW_SD_RAD, TERRAIN_SD_RAD, TERRAIN_SD_RAD)[i]
            passed = min(dt, MAX_DT_S) if i < 3 else dt
            self.P[i, i] += min(rate * rate * passed, max(0.0, limit * limit - self.P[i, i]))

    def forget_terrain(self) -> None:
        """Forgets the terrain's slope: after a jump of the heading, north and east are other directions, and the vehicle has not
        turned. What is known of the mount stays."""
        self.mean[3:] = 0.0
        self.P[3:, :] = self.P[:, 3:] = 0.0
        self.P[3, 3] = self.P[4, 4] = FORGOTTEN_SD_RAD**2

    def slope(self, rows: Floats, slope: tuple[float, float], sd_rad: float = 0.0) -> None:
        """Adds the apparent slope of the ground.

        Args:
            rows: (2, 5) of `slope_rows`.
            slope: along x and y, rad.
            sd_rad: standard deviation of its fit."""
        noise = SLOPE_SD_RAD**2 + sd_rad**2
        for h, value in zip(rows, slope, strict=True):
            innovation = value - float(h @ self.mean)
            variance = float(h @ self.P @ h) + noise
            if innovation * innovation > GATE * variance:
                excess = innovation * innovation - variance
                self.P[3, 3] += excess
                self.P[4, 4] += excess
                for i in range(3):
                    self.P[i, i] += MOUNT_JUMP_RAD**2
            self._update(h, value, noise)

    def walls(self, h: Floats, terrain_rad: float) -> None:
        """Adds the slope of the terrain in one direction as the walls show it. h: (5,) its row, 0 for delta."""
        innovation = terrain_rad - float(h @ self.mean)
        variance = float(h @ self.P @ h) + WALLS_SD_RAD**2
        if innovation * innovation > GATE * variance:
            for i in range(N):  # the mount has moved, or its estimate was wrong
                self.P[i, i] += innovation * innovation
        self._update(h, terrain_rad, WALLS_SD_RAD**2)

    def _update(self, h: Floats, value: float, variance: float) -> None:
        Ph = self.P @ h
        gain = Ph / (float(h @ Ph) + variance)
        self.mean = self.mean + gain * (value - float(h @ self.mean))
        P = self.P - np.outer(gain, Ph)
        self.P = 0.5 * (P + P.T)


def sd_along(P: Floats, direction: Floats) -> float:
    """Returns the standard deviation along a direction. P: covariance."""
    return math.sqrt(max(0.0, float(direction @ P @ direction)))


def slope_rows(R_level_frd: Floats, heading_rad: float) -> Floats:
    """Returns the derivative (2, 5) of the apparent slope along x and y of the level axes by the state. heading_rad:
    of these axes."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([[*R_level_frd[1], c, s], [*(-R_level_frd[0]), -s, c]])

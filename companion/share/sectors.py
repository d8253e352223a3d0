"""Distances to the obstacles of neighbours in the sectors of OBSTACLE_DISTANCE: they can only make a distance smaller."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.sharing.obstacles import SharedObstacles

SECTORS = 72
STEP_M = 0.2
MOST_STEPS = 400
Floats = NDArray[np.float64]


def sector_distances_m(
    obstacles: SharedObstacles,
    place_m: tuple[float, float, float],
    heading_rad: float,
    band_m: tuple[float, float],
    range_m: float,
) -> Floats:
    """(72,) horizontal distance from the vehicle's middle to the nearest obstacle in each sector, inf: none within range_m.
    place_m, heading_rad: of the vehicle in ned; band_m: height above and below it. Margins are taken off, and widen an obstacle
    sideways."""
    out = np.full(SECTORS, np.inf)
    up, down = place_m[2] - band_m[0], place_m[2] + band_m[1]
    p, m = obstacles.planes.astype(np.float64), obstacles.margin_m.astype(np.float64)
    for k in np.flatnonzero((p[:, 4] - m <= down) & (p[:, 5] + m >= up)):
        _add(
            out,
            _samples(p[k, 0:2], p[k, 2:4]) - np.array(place_m[:2]),
            float(m[k]) + 0.5 * STEP_M,
            heading_rad,
            range_m,
        )
    for mover in obstacles.movers:
        (x, y, z), (hx, hy, hz) = mover.centre_m, mover.half_size_m
        if z - hz - mover.margin_m <= down and z + hz + mover.margin_m >= up:
            middle = np.array([[x - place_m[0], y - place_m[1]]])
            _add(out, middle, math.hypot(hx, hy) + mover.margin_m, heading_rad, range_m)
    return out


def _samples(a: Floats, b: Floats) -> Floats:
    """(S, 2) points along a plane."""
    count = min(MOST_STEPS, 1 + math.ceil(math.hypot(*(b - a)) / STEP_M))
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


def _add(out: Floats, points: Floats, radius_m: float, heading_rad: float, range_m: float) -> None:
    """Discs of a radius around points."""
    distance_m = np.hypot(points[:, 0], points[:, 1])
    near = distance_m - radius_m <= range_m
    for (x, y), d in zip(points[near].tolist(), distance_m[near].tolist(), strict=True):
        left = max(0.0, d - radius_m)
        half = math.pi if d <= radius_m else math.asin(radius_m / d)
        middle = math.atan2(y, x) - heading_rad
        width = math.tau / SECTORS
        first, last = math.floor((middle - half) / width + 0.5), math.floor((middle + half) / width + 0.5)
        rows = np.arange(first, min(last, first + SECTORS - 1) + 1) % SECTORS
        out[rows] = np.minimum(out[rows], left)

"""A random field of boxes and poles, a random flight in the middle of it, and the true distances around the vehicle.

The distances are computed from points on the outlines of the solids, and share no code with the obstacle output."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulation.flight_path import FlightPath, VehicleState
from drivers.simulation.movers import moved
from drivers.simulation.scenes import Scene, SceneBuilder

SECTORS = 72
STEP_DEG = 360.0 / SECTORS
HEIGHT_M = 2.5
ROAM_M = 2.5
"""The flight stays within this distance of the origin; the solids stand beyond NEAREST_M."""
NEAREST_M, FARTHEST_M = 4.0, 12.5
RING, RING_HEIGHT_M = 16, 9.0
"""Number of walls around the field, and their height."""
LEG_S = 2.5
POINT_M = 0.03
"""Distance between two points of an outline."""
DEEP_M = 0.75
"""Distance of the points inside of the solids from their sides."""

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A pole that crosses the field again and again. outline_m: (N, 2) points at the beginning of each period."""

    outline_m: Points
    velocity_m_s: tuple[float, float]
    period_s: float

    def outline_at(self, t_s: float) -> Points:
        """The points at an instant of the flight."""
        return self.outline_m + np.array(self.velocity_m_s) * (t_s % self.period_s)


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """scene: to be rendered; outline_m: (N, 2) points north and east on the sides of its solids, all of which reach over the
    height band of the vehicle; deep_m: (M, 2) points in them, and behind the ring, at least DEEP_M behind the sides; path: of the
    vehicle; mover: beside them; None: nothing moves."""

    scene: Scene
    outline_m: Points
    deep_m: Points
    path: FlightPath
    mover: Mover | None = None

    def scene_at(self, t_s: float) -> Scene:
        """The scene at an instant of the flight."""
        return self.scene if self.mover is None else moved(self.scene, t_s % self.mover.period_s)

    def outline_at(self, t_s: float) -> Points:
        """The points at an instant of the flight."""
        return self.outline_m if self.mover is None else np.concatenate([self.outline_m, self.mover.outline_at(t_s)])

    def nearest_m(self, state: VehicleState, half_deg: float, t_s: float) -> NDArray[np.float64]:
        """Returns the true distance, (72,), from the middle of the vehicle to the nearest point within `half_deg` of the middle of
        each sector; inf: none."""
        north, east = (self.outline_at(t_s) - np.array(state.position_ned_m[:2])).T
        bearing_deg = np.degrees(np.arctan2(east, north) - state.euler_rad[2])
        sector = np.round(bearing_deg / STEP_DEG)
        inside = np.abs(bearing_deg - STEP_DEG * sector) <= half_deg
        out = np.full(SECTORS, np.inf)
        np.minimum.at(out, sector[inside].astype(int) % SECTORS, np.hypot(north, east)[inside])
        return out


def random_field(seed: int, duration_s: float) -> Field:
    """The field of a seed, always the same."""
    rng = np.random.default_rng([4, seed])
    builder = SceneBuilder(f"field {seed}")
    builder.ground()
    solids = [_solid(builder, rng) for _ in range(int(rng.integers(2, 8)))]
    ring_m = float(rng.uniform(14.5, 16.5))
    outlines = [outline for outline, _ in solids]
    outlines += [_wall(builder, ring_m, math.tau * i / RING) for i in range(RING)]
    deep_m = np.concatenate([deep for _, deep in solids] + [_behind_ring(ring_m)])
    mover = _mover(builder, np.random.default_rng([8, seed]), ring_m) if seed % 4 in (1, 2) else None
    return Field(builder.build(), np.concatenate(outlines), deep_m, _path(rng, duration_s), mover)


def _mover(builder: SceneBuilder, rng: np.random.Generator, ring_m: float) -> Mover:
    """Adds a pole that leaves the ring, passes the middle and enters the ring again."""
    heading, speed_m_s, radius_m = rng.uniform(-math.pi, math.pi), rng.uniform(0.8, 1.5), rng.uniform(0.25, 0.5)
    aside_m = rng.uniform(ROAM_M + 1.2, 8.0) * rng.choice([-1.0, 1.0])
    c, s = math.cos(heading), math.sin(heading)
    x, y = -ring_m * c - aside_m * s, -ring_m * s + aside_m * c
    builder.velocity_m_s = (speed_m_s * c, speed_m_s * s, 0.0)
    builder.pole("mover", x, y, 2.0 * radius_m, 5.0)
    builder.velocity_m_s = (0.0, 0.0, 0.0)
    angle = np.arange(0.0, math.tau, POINT_M / radius_m)
    outline_m = np.column_stack([x + radius_m * np.cos(angle), y + radius_m * np.sin(angle)])
    return Mover(outline_m, (speed_m_s * c, speed_m_s * s), 2.0 * ring_m / speed_m_s)


def _wall(builder: SceneBuilder, ring_m: float, bearing: float) -> Points:
    """Adds one wall of the ring around everything, without which stereo would measure nothing; returns its inner side."""
    length_m, thick_m = 2.0 * ring_m * math.tan(math.pi / RING) + 0.4, 0.3
    c, s = math.cos(bearing), math.sin(bearing)
    middle_m = ring_m + 0.5 * thick_m
    builder.box("ring", middle_m * c, middle_m * s, thick_m, length_m, RING_HEIGHT_M, bearing)
    along = np.arange(-0.5 * length_m, 0.5 * length_m, POINT_M)
    return np.column_stack([ring_m * c - along * s, ring_m * s + along * c])


def _behind_ring(ring_m: float) -> Points:
    """Returns points behind the ring, whose corners are farther away than its middles, and whose walls overlap by 0.4 m."""
    bearing = np.arange(0.0, math.tau, math.radians(2.0))
    range_m = ring_m / math.cos(math.pi / RING) + 0.05 + DEEP_M
    return range_m * np.column_stack([np.cos(bearing), np.sin(bearing)])


def _solid(builder: SceneBuilder, rng: np.random.Generator) -> tuple[Points, Points]:
    """Adds a box or a pole; returns its outline, and points deep in it."""
    bearing, range_m = rng.uniform(-math.pi, math.pi), rng.uniform(NEAREST_M + 1.0, FARTHEST_M)
    height_m = float(rng.uniform(4.5, 7.0))
    if rng.random() < 0.3:
        radius_m = float(rng.uniform(0.3, 0.8))
        x, y = (range_m + radius_m) * math.cos(bearing), (range_m + radius_m) * math.sin(bearing)
        builder.pole("pole", x, y, 2.0 * radius_m, height_m)
        angle = np.arange(0.0, math.tau, POINT_M / radius_m)
        outline_m = np.column_stack([x + radius_m * np.cos(angle), y + radius_m * np.sin(angle)])
        return outline_m, np.array([[x, y]] if radius_m >= DEEP_M else np.zeros((0, 2)))
    length_m, width_m, yaw = (
        float(rng.uniform(0.7, 5.0)),
        float(rng.uniform(0.7, 3.0)),
        float(rng.uniform(0.0, math.pi)),
    )
    range_m += 0.5 * math.hypot(length_m, width_m)
    x, y = range_m * math.cos(bearing), range_m * math.sin(bearing)
    builder.box("box", x, y, length_m, width_m, height_m, yaw)
    along = np.arange(-0.5 * length_m, 0.5 * length_m, POINT_M)
    across = np.arange(-0.5 * width_m, 0.5 * width_m, POINT_M)
    sides = [np.column_stack([along, np.full(len(along), side * 0.5 * width_m)]) for side in (-1, 1)]
    sides += [np.column_stack([np.full(len(across), side * 0.5 * length_m), across]) for side in (-1, 1)]
    R = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    deep = [np.arange(DEEP_M, size_m - DEEP_M, 0.25) - 0.5 * size_m for size_m in (length_m, width_m)]
    deep_m = np.stack(np.meshgrid(*deep), axis=-1).reshape(-1, 2)
    return np.concatenate(sides) @ R + [x, y], deep_m @ R + [x, y]


def _path(rng: np.random.Generator, duration_s: float) -> FlightPath:
    """Hovers for four seconds, then flies from place to place with turns of up to 60 degrees a second or so."""
    rows, yaw = [[0.0, 0.0, 0.0, -HEIGHT_M, 0.0, 0.0, 0.0], [4.0, 0.0, 0.0, -HEIGHT_M, 0.0, 0.0, 0.0]], 0.0
    while rows[-1][0] < duration_s:
        bearing, far_m = rng.uniform(-math.pi, math.pi), ROAM_M * math.sqrt(rng.random())
        yaw += rng.uniform(-1.2, 1.2) if rng.random() < 0.7 else 0.0
        roll, pitch = rng.uniform(-0.07, 0.07, 2)
        place = [far_m * math.cos(bearing), far_m * math.sin(bearing), -HEIGHT_M]
        rows.append([rows[-1][0] + LEG_S, *place, roll, pitch, yaw])
    return FlightPath(rows, sway_rad=(0.01, 0.01, 0.01))

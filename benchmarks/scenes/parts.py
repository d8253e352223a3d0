"""Parts of several scenes: positions along a facade, leaves, branches, stems, wires, rubble.

All in ned as in drivers.simulation.scenes: x north, y east, metres, heights above z = 0 and positive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulation.scenes import SceneBuilder

Floats = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Line:
    """A line on the ground from (x, y) with a heading; `behind` is to its left seen from above, where a wall
    on it has its body and the camera is not."""

    x: float
    y: float
    yaw: float

    def at(self, along: float, behind: float = 0.0) -> tuple[float, float]:
        """The point `along` the line and `behind` it."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + along * c + behind * s, self.y + along * s - behind * c

    def box(
        self,
        b: SceneBuilder,
        name: str,
        span: tuple[float, float],
        behind: tuple[float, float],
        height: float,
        base: float = 0.0,
    ) -> None:
        """A box over span = (from, to) along the line and behind = (from, to)."""
        x, y = self.at(sum(span) / 2, sum(behind) / 2)
        b.box(name, x, y, span[1] - span[0], behind[1] - behind[0], height, self.yaw, base)


def across(distance: float, half_width: float, skew_rad: float, shift: float = 0.0) -> Line:
    """The start of a line across the view from left to right, 2 half_width long, its middle at a distance
    ahead and `shift` to the right, turned clockwise by skew."""
    yaw = math.pi / 2 + skew_rad
    return Line(distance - half_width * math.cos(yaw), shift - half_width * math.sin(yaw), yaw)


def begin(name: str, structured: bool = False) -> SceneBuilder:
    """A scene with its ground."""
    s = SceneBuilder(name, structured=structured)
    s.ground()
    return s


def spread(rng: np.random.Generator, count: int, near: float, far: float, apart: float) -> list[tuple[float, float]]:
    """Places in the view between two distances, at least `apart` from each other."""
    found: list[tuple[float, float]] = []
    for _ in range(200 * count):
        x = rng.uniform(near, far)
        y = rng.uniform(-0.65, 0.65) * x
        if len(found) < count and all(math.hypot(x - p, y - q) >= apart for p, q in found):
            found.append((x, y))
    return found


def leaves(
    b: SceneBuilder, name: str, at: Floats, rng: np.random.Generator, low: float = 0.06, high: float = 0.14
) -> None:
    """Round leaves of `low`..`high` radius at points (L, 3) in ned, turned at random."""
    normals, sizes = rng.standard_normal((len(at), 3)), rng.uniform(low, high, len(at))
    for p, n, r in zip(at.tolist(), normals.tolist(), sizes.tolist(), strict=True):
        b.disc(name, (p[0], p[1], p[2]), (n[0], n[1], n[2]), r)


def ball(count: int, rng: np.random.Generator) -> Floats:
    """(count, 3) points in the unit ball, most of them near its surface, as leaves are."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return np.asarray(direction * np.cbrt(rng.uniform(0.2, 1.0, (count, 1))))


def bush(
    b: SceneBuilder, name: str, x: float, y: float, height: float, radius: float, rng: np.random.Generator
) -> None:
    """Leaves in an ellipsoid that stands on the ground."""
    count = int(110 * height * radius + 60)
    points = np.array([x, y, -0.52 * height]) + ball(count, rng) * [radius, radius, 0.48 * height]
    leaves(b, name, points, rng, 0.05, 0.11)


def hedge(
    b: SceneBuilder,
    name: str,
    line: Line,
    span: tuple[float, float],
    height: float,
    depth: float,
    rng: np.random.Generator,
) -> None:
    """Leaves in a long upright box over span = (from, to) along a line."""
    length = span[1] - span[0]
    count = int(75 * length * height)
    along, behind = rng.uniform(*span, count), depth * rng.beta(0.7, 1.0, count)
    xy = np.array([line.at(s, d) for s, d in zip(along, behind, strict=True)])
    leaves(b, name, np.column_stack([xy, -rng.uniform(0.05, height, count)]), rng, 0.06, 0.12)


def conifer(
    b: SceneBuilder, name: str, x: float, y: float, height: float, radius: float, rng: np.random.Generator
) -> None:
    """A trunk in a cone of leaves that begins knee-high."""
    b.cylinder(name, (x, y, 0.0), (x, y, -0.9 * height), 0.03 * height)
    count = int(95 * height * radius)
    up = 1.0 - np.sqrt(rng.uniform(0.0, 1.0, count))
    out, turn = radius * (1.0 - up) * np.sqrt(rng.uniform(0.3, 1.0, count)), rng.uniform(0.0, 2 * math.pi, count)
    z = -(0.4 + up * (height - 0.4))
    leaves(b, name, np.column_stack([x + out * np.cos(turn), y + out * np.sin(turn), z]), rng)


def bare_tree(b: SceneBuilder, name: str, x: float, y: float, height: float, rng: np.random.Generator) -> None:
    """A tree without leaves: a trunk that forks three times."""
    trunk = 0.35 * height
    b.cylinder(name, (x, y, 0.0), (x, y, -trunk), 0.025 * height)
    _fork(b, name, np.array([x, y, -trunk]), np.array([0.0, 0.0, -1.0]), 0.33 * height, 0.016 * height, 3, rng)


def _fork(
    b: SceneBuilder,
    name: str,
    at: Floats,
    heading: Floats,
    length: float,
    radius: float,
    more: int,
    rng: np.random.Generator,
) -> None:
    for _ in range(3):
        way = heading + rng.normal(0.0, 0.45, 3)
        way /= np.linalg.norm(way)
        end = at + length * rng.uniform(0.7, 1.1) * way
        if end[2] > -0.5:  # branches do not reach into the ground
            continue
        b.cylinder(name, (at[0], at[1], at[2]), (end[0], end[1], end[2]), radius)
        if more > 1:
            _fork(b, name, end, way, 0.62 * length, 0.6 * radius, more - 1, rng)


def reeds(b: SceneBuilder, name: str, x: float, y: float, radius: float, stems: int, rng: np.random.Generator) -> None:
    """Thin stems of 0.8 to 1.9 m that lean a little."""
    for _ in range(stems):
        turn, out = rng.uniform(0.0, 2 * math.pi), radius * math.sqrt(rng.uniform())
        foot = np.array([x + out * math.cos(turn), y + out * math.sin(turn), 0.0])
        lean = rng.normal(0.0, 0.12, 2)
        height = rng.uniform(0.8, 1.9)
        top = foot + np.array([lean[0] * height, lean[1] * height, -height])
        b.cylinder(name, (foot[0], foot[1], 0.0), (top[0], top[1], top[2]), rng.uniform(0.008, 0.02))


def chunk(b: SceneBuilder, name: str, centre: Point, size: float, rng: np.random.Generator) -> None:
    """A broken piece: a slab or lump of about `size`, lying as it fell."""
    half = size / 2 * np.array([1.0, rng.uniform(0.5, 0.9), rng.uniform(0.25, 0.6)])
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half
    corners *= rng.uniform(0.75, 1.0, (8, 3))
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    b.convex(name, corners @ turn + np.array(centre))


def hanging_wire(b: SceneBuilder, name: str, a: Point, c: Point, sag: float, radius: float, pieces: int = 8) -> None:
    """A wire between two points (ned) that hangs through by `sag`."""
    share = np.linspace(0.0, 1.0, pieces + 1)
    points = np.array(a) + share[:, None] * (np.array(c) - np.array(a))
    points[:, 2] += 4.0 * sag * share * (1.0 - share)
    for p, q in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
        b.cylinder(name, (p[0], p[1], p[2]), (q[0], q[1], q[2]), radius)

"""Random missions past walls, poles, trees and wires, and the clearance of a place from the solids of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulation.ray_caster import CONVEX, CYLINDER, DISC
from drivers.simulation.scenes import Scene, SceneBuilder

Vector = NDArray[np.float64]
OBSTACLES = ("wall", "pole", "tree", "wire")


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """waypoints_m: (N, 2) north and east, from (0, 0). autopilot: PX4 or ArduPilot. guided: velocity setpoints along the first
    leg instead of a mission; the second leg is not flown. blocked: an obstacle stands in the way that is flown."""

    number: int
    scene: Scene
    waypoints_m: Vector
    height_m: float
    speed_m_s: float
    autopilot: str
    guided: bool
    blocked: bool
    kinds: tuple[str, ...]


def random_mission(number: int) -> Mission:
    """The mission of a number, always the same: two legs, an obstacle in the way of seven in ten, others beside it."""
    rng = np.random.default_rng([26, number])
    length_m, turn = rng.uniform(15.0, 35.0), rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 2.0)
    first = np.array([length_m, 0.0])
    second = first + rng.uniform(10.0, 20.0) * np.array([math.cos(turn), math.sin(turn)])
    waypoints = np.array([first, second])
    height_m = float(rng.uniform(1.8, 4.0))
    b = SceneBuilder(f"mission {number}")
    b.ground()
    kinds = []
    blocked, at_second = bool(rng.random() < 0.7), False
    if blocked:
        at_second = on_second = bool(rng.random() < 0.35)
        a, e = (first, second) if on_second else (np.zeros(2), first)
        along = float(rng.uniform(6.0, max(6.5, math.dist(a, e) - 1.0)))
        aside = float(rng.uniform(-0.3, 0.3))
        kind = str(rng.choice(OBSTACLES))
        add_obstacle(b, kind, a, e, along, aside, height_m, rng)
        kinds.append(kind)
    for _ in range(int(rng.integers(1, 5))):
        on_second = rng.random() < 0.4
        a, e = (first, second) if on_second else (np.zeros(2), first)
        aside = float(rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 5.0))
        kind = str(rng.choice(OBSTACLES[1:3]))
        add_obstacle(b, kind, a, e, float(rng.uniform(3.0, math.dist(a, e))), aside, height_m, rng)
        kinds.append(kind)
    speed_m_s, autopilot = float(rng.uniform(1.0, 8.0)), str(rng.choice(["PX4", "ArduPilot"]))
    guided = bool(rng.random() < 0.2)
    return Mission(
        number=number,
        scene=b.build(),
        waypoints_m=waypoints,
        height_m=height_m,
        speed_m_s=speed_m_s,
        autopilot=autopilot,
        guided=guided,
        blocked=blocked and not (guided and at_second),
        kinds=tuple(kinds),
    )


def add_obstacle(
    b: SceneBuilder,
    kind: str,
    a: Vector,
    e: Vector,
    along_m: float,
    aside_m: float,
    height_m: float,
    rng: np.random.Generator,
) -> None:
    """Adds an obstacle at a distance along the leg a -> e and aside of it."""
    u = (e - a) / math.dist(a, e)
    v = np.array([-u[1], u[0]])
    x, y = (float(c) for c in a + along_m * u + aside_m * v)
    yaw = math.atan2(u[1], u[0])
    if kind == "wall":
        turn = float(rng.uniform(-0.5, 0.5))
        b.box("wall", x, y, 0.3, float(rng.uniform(3.0, 12.0)), height_m + float(rng.uniform(0.3, 3.0)), yaw + turn)
    elif kind == "pole":
        b.pole("pole", x, y, float(rng.uniform(0.08, 0.25)), height_m + float(rng.uniform(0.5, 3.0)))
    elif kind == "tree":
        b.tree("tree", x, y, height_m * float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.8, 1.5)), 250, rng)
    else:
        z, half = -height_m + float(rng.uniform(-0.25, 0.25)), 12.0
        skew = float(rng.uniform(-0.4, 0.4))
        w = math.cos(skew) * v + math.sin(skew) * u
        ends = [(float(x + s * half * w[0]), float(y + s * half * w[1]), z) for s in (-1.0, 1.0)]
        b.cylinder("wire", ends[0], ends[1], 0.5 * float(rng.uniform(0.01, 0.03)))


def clearance_m(scene: Scene, place_m: Vector) -> float:
    """Distance from a place (3,) in ned to the nearest solid other than the ground, never more than the true one: a convex body
    counts by its half-spaces, a cylinder with round ends. inf: there is none."""
    nearest = math.inf
    for kind, row in zip(scene.kinds, scene.rows, strict=True):
        if kind == CONVEX:
            first, count = int(row[0]), int(row[1])
            planes = scene.halfspaces[first : first + count]
            nearest = min(nearest, float((planes[:, :3] @ place_m - planes[:, 3]).max()))
        elif kind == CYLINDER:
            a, along = row[:3], row[3:6] - row[:3]
            share = float(np.clip((place_m - a) @ along / (along @ along), 0.0, 1.0))
            nearest = min(nearest, math.dist(place_m, a + share * along) - float(row[6]))
    discs = scene.rows[scene.kinds == DISC]
    if len(discs):
        to = place_m - discs[:, :3]
        off = (to * discs[:, 3:6]).sum(axis=1)
        beside = np.sqrt(np.maximum(0.0, (to**2).sum(axis=1) - off**2))
        nearest = min(nearest, float(np.hypot(off, np.maximum(0.0, beside - discs[:, 6])).min()))
    return nearest


def way_to_obstacle_m(scene: Scene, place_m: Vector, direction: Vector, half_width_m: float, longest_m: float) -> float:
    """Distance along a direction (2,) at which the clearance of the path falls below half_width_m; inf: not within longest_m."""
    ahead = np.array([direction[0], direction[1], 0.0])
    done_m = 0.0
    while done_m <= longest_m:
        free_m = clearance_m(scene, place_m + done_m * ahead) - half_width_m
        if free_m <= 0.0:
            return done_m
        done_m += max(free_m, 0.05)
    return math.inf

"""Simulated flights for the merged world: scenes, ways around, along and past them, and the places it is then judged from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.cases import CAMERA, EXACT, Condition
from benchmarks.paper.shapes import DISTANCE_M, SHAPES, shape_scene
from core.frames import R_CAMFRD_OPTICAL, horizontal_heading_rad, rotation_from_euler, rotation_level_cam_optical
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import measure
from drivers.simulation.source import Rendered, camera_info, look

Floats = NDArray[np.float64]
Pose = tuple[float, float, float, float, float]
"""x, y, z (ned, m), heading, pitch (rad) of the camera."""
CONDITION = CAMERA
"""Noise and a camera's faults."""
WIDTH = 320
HZ = 5.0
"""Frames a second of flight: what the world makes of time."""
BLOCK_M = (14.0, 9.0, 6.0)
_STEP_M = 0.4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Flight:
    """way: the poses of its frames; judged: poses that the flight does not contain; inside: whether points (M, 3) lie
    in the solid that was flown around, None: there is none."""

    name: str
    scene: Scene
    way: tuple[Pose, ...]
    judged: tuple[Pose, ...]
    inside: Callable[[Floats], NDArray[np.bool_]] | None = None
    around: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y and half the width of the object that was flown around."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Errors of the pose. position_m, attitude_deg: standard deviation from frame to frame; drift: metres per metre
    flown, in a direction of the seed."""

    name: str
    position_m: float = 0.0
    attitude_deg: float = 0.0
    drift: float = 0.0


TRUE, NOISY, DRIFTING = Estimate("true pose"), Estimate("pose noise", 0.05, 0.3), Estimate("drift", 0.05, 0.3, 0.01)
ESTIMATES = (TRUE, NOISY, DRIFTING)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Seen:
    """One frame of a flight. R_level_optical, heading_rad, place_m: as reported by the autopilot; drift_m: total drift,
    without noise."""

    rendered: Rendered
    R_level_optical: Floats
    heading_rad: float
    place_m: Floats
    drift_m: Floats
    t_ns: int


def flights(seed: int) -> tuple[Flight, ...]:
    """All flights; the seed varies their objects."""
    return (_block(seed), _alley(seed), _trees(seed), *(_shape(name, seed) for name in SHAPES))


def frame(scene: Scene, pose: Pose, condition: Condition, seed: int, number: int) -> Rendered:
    """What the camera delivers at a pose."""
    x, y, z, heading, pitch = pose
    info = camera_info(WIDTH, WIDTH * 3 // 4, ke_per_m=condition.configured_ke_per_m)
    R = rotation_from_euler(0.0, pitch, heading) @ R_CAMFRD_OPTICAL
    at = np.array([x, y, z])
    truth = look(scene, info, R, at)
    depth = measure(truth.depth_m, info, condition.sensor(WIDTH), seed, number)
    return Rendered(scene, info, depth, R, rotation_level_cam_optical(R), at, truth)


def flown(flight: Flight, estimate: Estimate, seed: int, rendered: list[Rendered]) -> Iterator[Seen]:
    """The frames of a flight with the reported poses. Equal seeds give equal errors."""
    rng = np.random.Generator(np.random.PCG64([seed, 7]))
    away = rng.uniform(0.0, math.tau)
    path_m, before = 0.0, np.array(flight.way[0][:3])
    for k, r in enumerate(rendered):
        path_m += float(np.linalg.norm(r.position_ned_m - before))
        before = r.position_ned_m
        drift = estimate.drift * path_m * np.array([math.cos(away), math.sin(away), 0.0])
        noise = rng.normal(0.0, 1.0, 6)
        tilt = rotation_from_euler(*(math.radians(estimate.attitude_deg) * noise[:3]))
        R = tilt @ r.R_ned_optical
        yield Seen(
            rendered=r,
            R_level_optical=rotation_level_cam_optical(R),
            heading_rad=horizontal_heading_rad(R),
            place_m=r.position_ned_m + drift + estimate.position_m * noise[3:],
            drift_m=drift,
            t_ns=round((k + 1) * 1e9 / HZ),
        )


def renderings(flight: Flight, condition: Condition, seed: int) -> list[Rendered]:
    """All frames of a flight; they do not depend on the reported poses."""
    return [frame(flight.scene, pose, condition, seed, k) for k, pose in enumerate(flight.way)]


def judged(flight: Flight, seed: int) -> list[Rendered]:
    """Exact views from the places that the flight is judged from."""
    return [frame(flight.scene, pose, EXACT, seed, 0) for pose in flight.judged]


def _along(corners: list[tuple[float, float]], z: float, turn: float, pitch: float = 0.0) -> list[Pose]:
    """Poses a step apart along straight lines, looking `turn` to the right of the way."""
    poses = []
    for (ax, ay), (bx, by) in pairwise(corners):
        length = math.hypot(bx - ax, by - ay)
        heading = math.atan2(by - ay, bx - ax) + turn
        for k in range(math.ceil(length / _STEP_M)):
            s = k * _STEP_M / length
            poses.append((ax + s * (bx - ax), ay + s * (by - ay), z, heading, pitch))
    return poses


def _circle(x: float, y: float, radius: float, z: float, count: int, begin: float = 0.0) -> list[Pose]:
    """Poses on a circle, all looking at its middle."""
    turns = [begin + math.tau * k / count for k in range(count)]
    return [(x - radius * math.cos(t), y - radius * math.sin(t), z, t, 0.0) for t in turns]


def _block(seed: int) -> Flight:
    """Around a building on a rectangle, looking half ahead, half at it."""
    rng = np.random.Generator(np.random.PCG64([seed, 11]))
    length, width, height = (float(v * rng.uniform(0.9, 1.1)) for v in BLOCK_M)
    s = SceneBuilder("block")
    s.ground()
    s.box("block", 0.0, 0.0, length, width, height, 0.0)
    x, y = length / 2 + 7.0, width / 2 + 7.0
    corners = [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y), (x, -y)]
    way = _along(corners, -2.5, math.radians(50.0))

    def within(p: Floats) -> NDArray[np.bool_]:
        half = np.array([length / 2, width / 2])
        return np.asarray((np.abs(p[:, :2]) <= half).all(axis=1) & (p[:, 2] <= 0.0) & (p[:, 2] >= -height))

    return Flight(
        name="block",
        scene=s.build(),
        way=tuple(way),
        judged=tuple(_circle(0.0, 0.0, 15.0, -3.5, 8, 0.3)),
        inside=within,
        around=(0.0, 0.0, length / 2),
    )


def _alley(seed: int) -> Flight:
    """Through an alley, and back the same way turned around."""
    there = _along([(-1.0, 0.0), (13.0, 0.1)], -1.8, 0.0)
    back = [(x, y, z, heading + math.pi, pitch) for x, y, z, heading, pitch in reversed(there)]
    looks = [
        (1.0, 0.4, -2.3, 0.25, 0.0),
        (4.0, -0.5, -1.4, -0.3, 0.0),
        (8.0, 0.3, -2.4, 0.15, 0.05),
        (9.0, 0.0, -1.5, 2.9, 0.0),
    ]
    return Flight(name="alley", scene=make_scene("alley", seed), way=tuple(there + back), judged=tuple(looks))


def _trees(seed: int) -> Flight:
    """Past trees, weaving between them."""
    there = _along([(-2.0, 0.0), (5.0, 0.6), (12.0, -2.0), (18.0, -2.0)], -2.0, 0.15)
    back = _along([(18.0, 3.0), (-2.0, 0.5)], -2.3, -0.15)
    looks = [
        (0.0, -1.5, -2.5, 0.0, 0.0),
        (2.0, 2.5, -1.8, 0.1, 0.0),
        (20.0, 0.5, -2.2, 3.1, 0.0),
        (8.0, -2.0, -2.0, 0.6, 0.0),
    ]
    return Flight(name="trees", scene=make_scene("trees", seed), way=tuple(there + back), judged=tuple(looks))


def _shape(name: str, seed: int) -> Flight:
    """Around one of the shapes of Fig. 15."""
    scene = shape_scene(name, seed)
    low, high = scene.corners[1:].reshape(-1, 3).min(axis=0), scene.corners[1:].reshape(-1, 3).max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def within(p: Floats) -> NDArray[np.bool_]:
        off = p - middle
        if name == "sphere":
            return np.asarray(np.linalg.norm(off, axis=1) <= half[0])
        tall = np.abs(off[:, 2]) <= half[2]
        if name == "cylinder":
            return np.asarray(tall & (np.hypot(off[:, 0], off[:, 1]) <= half[0]))
        return np.asarray((p @ scene.halfspaces[:, :3].T <= scene.halfspaces[:, 3] + 1e-9).all(axis=1))

    return Flight(
        name=name,
        scene=scene,
        way=tuple(_circle(DISTANCE_M, 0.0, 7.0, -2.0, 72) + _circle(DISTANCE_M, 0.0, 7.0, -2.0, 24)),
        judged=tuple(_circle(DISTANCE_M, 0.0, 5.5, -2.6, 6, 0.4)),
        inside=within,
        around=(DISTANCE_M, 0.0, float(half[:2].max())),
    )

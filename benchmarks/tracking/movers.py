"""Moving obstacles: when they are declared, and the errors of velocity and place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from core.tracking.tracker import Tracker
from drivers.simulation.flights import FlightPlan
from drivers.simulation.scenes import Scene, SceneBuilder

from .sequences import HZ, NS, Pose, along, drifting, exposures, hovering, tracking_frame, true_pose

AFTER_S = 1.0
"""Errors count from this time after the whole mover is in the image."""
INSIDE_PX = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One mover. kind: "person" or "car"; x_m, y_m: at the start; velocity: x, y, m/s; flying: the camera flies at 1 m/s."""

    name: str
    kind: str
    x_m: float
    y_m: float
    velocity: tuple[float, float]
    flying: bool = False


CASES = (
    Case(name="person across at 3 m", kind="person", x_m=3.0, y_m=-2.0, velocity=(0.0, 1.5)),
    Case(name="person across at 6 m", kind="person", x_m=6.0, y_m=-3.0, velocity=(0.0, 1.5)),
    Case(name="person across at 10 m", kind="person", x_m=10.0, y_m=-3.5, velocity=(0.0, 1.5)),
    Case(name="person at an angle, from 8 m", kind="person", x_m=8.0, y_m=-2.0, velocity=(-1.06, 1.06)),
    Case(name="person away from 3 m", kind="person", x_m=3.0, y_m=0.3, velocity=(1.5, 0.0)),
    Case(name="person towards, from 10 m", kind="person", x_m=10.0, y_m=0.5, velocity=(-1.5, 0.0)),
    Case(
        name="person across at 6 m, camera at 1 m/s", kind="person", x_m=8.0, y_m=-3.0, velocity=(0.0, 1.5), flying=True
    ),
    Case(name="car across at 12 m", kind="car", x_m=12.0, y_m=-14.0, velocity=(0.0, 8.0)),
    Case(name="car towards, from 19 m", kind="car", x_m=19.0, y_m=2.0, velocity=(-8.0, 0.0)),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Results of one mover. declared_s: after the whole mover is in the image, nan: never; velocity_m_s and place_m: mean
    and greatest errors from AFTER_S on; share: of these frames that have it as moving; others: false movers."""

    declared_s: float
    velocity_m_s: tuple[float, float]
    place_m: tuple[float, float]
    share: float
    frames: int
    others: int


def plan_of(case: Case) -> FlightPlan:
    """The mover before a wall on an open ground with two lamps."""
    s = SceneBuilder("mover")
    s.ground()
    s.wall("wall", (18.0, -16.0), (18.0, 16.0), 5.0)
    s.pole("lamp", 7.0, 4.5, 0.14, 5.5)
    s.pole("lamp", 14.0, -6.0, 0.14, 5.5)
    s.velocity_m_s = (*case.velocity, 0.0)
    if case.kind == "person":
        s.person("mover", case.x_m, case.y_m)
    else:
        s.box("mover", case.x_m, case.y_m, 4.2, 1.8, 1.45, math.atan2(case.velocity[1], case.velocity[0]))
    scene = s.build()
    return along(scene, 1.0, 4.0, 0.0) if case.flying else hovering(scene)


def run(case: Case, ke_per_m: float, frames: int = 40) -> Found:
    """Tracks one mover with a true pose. The true place is the middle of the box of its visible
    surface points."""
    plan, tracker = plan_of(case), Tracker()
    label = plan.scene.names.index("mover")
    whole_ns = declared_ns = None
    speed, place, late, others = [], [], 0, 0
    for e in exposures(plan, frames, ke_per_m):
        s = tracker.observe(tracking_frame(e, true_pose))
        mask = e.truth.label(plan.scene) == label
        columns = np.flatnonzero(mask.any(axis=0))
        whole = len(columns) > 3 and columns[0] >= 16 + INSIDE_PX and columns[-1] < e.info.intrinsics.width - INSIDE_PX
        if not whole:
            if whole_ns is not None:
                break  # it left the image
            continue
        whole_ns = e.t_ns if whole_ns is None else whole_ns
        k, z = e.info.intrinsics, e.truth.depth_m[mask]
        v, u = np.nonzero(mask)
        rays = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
        points = rays @ e.R_ned_optical.T + e.position_m
        at = 0.5 * (points.min(axis=0) + points.max(axis=0))
        near = [o for o in s.objects if math.hypot(o.centre_m[0] - at[0], o.centre_m[1] - at[1]) < 2.5]
        others += len(s.objects) - len(near)
        if near and declared_ns is None:
            declared_ns = e.t_ns
        if (e.t_ns - whole_ns) / NS < AFTER_S - 0.5 / HZ:
            continue
        late += 1
        if near:
            o = min(near, key=lambda o: math.hypot(o.centre_m[0] - at[0], o.centre_m[1] - at[1]))
            speed.append(math.hypot(o.velocity_m_s[0] - case.velocity[0], o.velocity_m_s[1] - case.velocity[1]))
            place.append(math.hypot(o.centre_m[0] - at[0], o.centre_m[1] - at[1]))
    declared = math.nan if declared_ns is None or whole_ns is None else (declared_ns - whole_ns) / NS
    return Found(
        declared_s=declared,
        velocity_m_s=_both(speed),
        place_m=_both(place),
        share=len(speed) / late if late else math.nan,
        frames=late,
        others=others,
    )


FALSE_POSES: dict[str, Pose] = {"true": true_pose, "drift 1 %": drifting(0.01)}


def false_movers(scene: Scene, ke_per_m: float, seconds: float) -> dict[str, int]:
    """Moving obstacles declared in a flight at 1 m/s through a static scene, for each of FALSE_POSES."""
    trackers = {name: Tracker() for name in FALSE_POSES}
    found: dict[str, set[int]] = {name: set() for name in FALSE_POSES}
    for e in exposures(along(scene, 1.0, seconds), round(seconds * HZ), ke_per_m, seed=2):
        for name, pose in FALSE_POSES.items():
            found[name] |= {o.id for o in trackers[name].observe(tracking_frame(e, pose)).objects}
    return {name: len(ids) for name, ids in found.items()}


def _both(values: list[float]) -> tuple[float, float]:
    return (float(np.mean(values)), float(np.max(values))) if values else (math.nan, math.nan)

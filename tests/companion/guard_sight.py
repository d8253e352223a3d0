"""Surroundings and sights of a path, for tests of the guard."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from companion.autopilot.obstacle_memory import Here, Remembered, nothing_remembered
from companion.autopilot.polar_histogram import Recall
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.assessment import Action, PathAssessor
from companion.guard.braking import braking_of
from companion.guard.path_sight import PathSight, path_sight
from companion.pipeline.transform import LevelTransform
from core.types import FrameModel

from .sector_models import model

NS = 1_000_000_000
MS = 1_000_000
AVOID = AvoidParams(radius_m=0.4)
GUARD = GuardParams(enabled=True, horizon_m=20.0)
T_NS = 50 * NS
HERE = Here(0.0, (0.0, 0.0, -3.0), 1)


def plane(x: float, y0: float, y1: float, top: float = -2.0, bottom: float = 2.0) -> tuple[float, ...]:
    """Across the way, at x, from y0 to y1."""
    return (x, y0, x, y1, top, bottom)


def seen(
    found: FrameModel | None,
    velocity: tuple[float, float, float] = (5.0, 0.0, 0.0),
    heading: float = 0.0,
    recalled: Remembered | None = None,
    weak_px: float = 0.0,
    turn_deg_s: float = 0.0,
    recall: Recall | None = None,
    moved: bool = True,
    blind: dict[str, str] | None = None,
) -> PathSight:
    views = () if found is None else (View(found, LevelTransform(0.0, (0.0, 0.0, 0.0))),)
    s = Surroundings(
        t_ns=T_NS,
        views=views,
        weak_px=(weak_px,) * len(views),
        exposed_ns=T_NS - 50 * MS if views else None,
        recall=recall,
        recalled=recalled or nothing_remembered(),
        blind=blind or ({} if views else {"front": "no frame yet"}),
        here=replace(HERE, heading_rad=heading),
        velocity_ned_m_s=velocity,
        moved=moved,
    )
    return path_sight(s, AVOID, GUARD, math.radians(turn_deg_s))


def at(range_m: float, bearing_deg: float) -> FrameModel:
    """A pole."""
    x, y = range_m * math.cos(math.radians(bearing_deg)), range_m * math.sin(math.radians(bearing_deg))
    return model((x, y - 0.05, x, y + 0.05, -2.0, 2.0), free_to_m=20.0)


BRAKING = braking_of(GUARD, AVOID)
SIGHT = PathSight(
    t_ns=T_NS,
    exposed_ns=T_NS - 50 * MS,
    speed_m_s=5.0,
    course_rad=0.0,
    free_m=20.0,
    obstacle_m=math.inf,
    weak_obstacle_m=math.inf,
    position_ned_m=(0.0, 0.0, -3.0),
)


def later(ms: int, **changes: Any) -> PathSight:
    """A sight so much later, at 5 m/s."""
    at = replace(SIGHT, t_ns=T_NS + ms * MS, exposed_ns=T_NS + (ms - 50) * MS, position_ned_m=(0.005 * ms, 0.0, -3.0))
    return replace(at, **changes)


def action(*sights: PathSight, after_ms: int = 0) -> Action:
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    for sight in sights:
        assessor.take(sight)
    verdict = assessor.verdict(sights[-1].t_ns + after_ms * MS)
    assert verdict is not None
    return verdict.action

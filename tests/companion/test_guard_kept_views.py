"""Free space of the frames of a moment ago, along the present path."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.autopilot.obstacle_memory import Here
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.guard.kept_views import KeptViews
from companion.guard.path_sight import PathSight, common_free_m, path_sight
from companion.pipeline.transform import LevelTransform
from core.types import FrameModel

from .test_guard_path import AVOID, GUARD, HERE, MS, NS, T_NS, model, nothing_remembered

KEEP_NS = NS // 4
FAR = model(free_to_m=20.0)
NEAR = model(free_to_m=4.0)


def decision(
    found: FrameModel, ms: int, here: Here = HERE, velocity: tuple[float, float, float] = (2.0, 0.0, 0.0)
) -> Surroundings:
    """A decision with a frame of its own, of a camera at the vehicle's middle."""
    return Surroundings(
        t_ns=T_NS + ms * MS,
        views=(View(found, LevelTransform(0.0, (0.0, 0.0, 0.0))),),
        weak_px=(0.0,),
        exposed_ns=T_NS + (ms - 50) * MS,
        recall=None,
        recalled=nothing_remembered(),
        blind={},
        here=here,
        velocity_ned_m_s=velocity,
        frames=(("front", T_NS + (ms - 50) * MS),),
    )


def after(first: Surroundings, second: Surroundings) -> PathSight:
    """The sight of a decision after another one."""
    kept = KeptViews(KEEP_NS)
    kept.take(first)
    return path_sight(second, AVOID, GUARD, 0.0, kept.before(second))


def kept_m(sight: PathSight) -> float:
    """0: nothing was kept."""
    return max((common_free_m(kept.free_m, 1.0) for kept in sight.kept_rays), default=0.0)


def test_what_an_earlier_frame_saw_counts_from_the_present_place() -> None:
    """The earlier frame saw 20 m from where the vehicle was 1.5 m before."""
    moved = replace(HERE, position_ned_m=(1.5, 0.0, -3.0))
    sight = after(decision(FAR, 0), decision(NEAR, 100, moved))
    assert sight.free_m < 4.1
    assert kept_m(sight) == pytest.approx(18.5, abs=0.3)


def test_a_course_that_the_noise_turns_keeps_what_was_seen() -> None:
    """6 degrees: the corridor of the earlier frame leaves the present one within 3 m, but its view does not."""
    turned = math.radians(6.0)
    now = decision(NEAR, 100, velocity=(2.0 * math.cos(turned), 2.0 * math.sin(turned), 0.0))
    assert kept_m(after(decision(FAR, 0), now)) > 15.0


def test_a_turned_vehicle_compares_places_in_ned() -> None:
    """A view of 70 degrees to the north does not show what is in the east."""
    narrow = model(free_to_m=20.0, view_deg=70.0)
    east = replace(HERE, heading_rad=math.radians(90.0))
    assert kept_m(after(decision(narrow, 0), decision(NEAR, 100, east, velocity=(0.0, 2.0, 0.0)))) == 0.0
    assert kept_m(after(decision(narrow, 0), decision(NEAR, 100, east, velocity=(2.0, 0.0, 0.0)))) > 15.0


@pytest.mark.parametrize(
    ("then", "now"),
    [
        (replace(HERE, position_ned_m=None), HERE),
        (HERE, replace(HERE, position_ned_m=None)),
        (HERE, replace(HERE, section=2)),
        (HERE, replace(HERE, heading_section=1)),
    ],
)
def test_places_that_cannot_be_compared_do_not_count(then: Here, now: Here) -> None:
    assert after(decision(FAR, 0, then), decision(NEAR, 100, now)).kept_rays == ()


def test_the_same_frame_and_invalid_ones_do_not_count() -> None:
    same = replace(decision(FAR, 100), frames=decision(NEAR, 0).frames)
    assert after(decision(FAR, 0), same).kept_rays == ()
    assert kept_m(after(decision(replace(FAR, valid=False), 0), decision(NEAR, 100))) == 0.0


@pytest.mark.parametrize("old_ms", [50, 120, 240])
def test_a_frame_counts_from_its_exposure(old_ms: int) -> None:
    """It may be old at the decision that uses it."""
    first = replace(decision(FAR, 0), frames=(("front", T_NS - old_ms * MS),))
    assert kept_m(after(first, decision(NEAR, 250 - old_ms))) > 15.0
    assert after(first, decision(NEAR, 251 - old_ms)).kept_rays == ()


@pytest.mark.parametrize(("now_ms", "free"), [(60, True), (180, True), (201, False)])
def test_each_camera_counts_from_its_own_exposure(now_ms: int, free: bool) -> None:
    """The frame of the camera that looks along the path is 50 ms old at the decision, that of the other one 150 ms."""
    first = decision(FAR, 0)
    away = replace(first.views[0], model=model(free_to_m=0.0))
    two = replace(
        first,
        views=(away, first.views[0]),
        weak_px=(0.0, 0.0),
        exposed_ns=T_NS - 150 * MS,
        frames=(("back", T_NS - 150 * MS), ("front", T_NS - 50 * MS)),
    )
    assert (kept_m(after(two, decision(NEAR, now_ms))) > 15.0) is free


def test_each_ray_counts_by_the_frame_that_shows_most_of_it() -> None:
    kept = KeptViews(KEEP_NS)
    for ms, found in ((0, NEAR), (80, FAR), (160, NEAR)):
        kept.take(decision(found, ms))
    now = decision(NEAR, 200)
    assert kept_m(path_sight(now, AVOID, GUARD, 0.0, kept.before(now))) > 15.0
    assert len(list(kept.before(now))) == 3

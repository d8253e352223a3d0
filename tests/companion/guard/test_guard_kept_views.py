"""Free space of the frames of a moment ago, along the present path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.obstacle_memory import Here
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.guard.corridor import Path, common_free_m, samples_of
from companion.guard.kept_views import KEEP_FREE_NS, KeptViews, measured_free
from companion.guard.path_sight import PathSight, path_sight
from companion.pipeline.transform import LevelTransform
from core.types import FrameModel

from ..guard_sight import AVOID, GUARD, HERE, MS, T_NS, model, nothing_remembered

KEEP_MS = KEEP_FREE_NS // MS
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
    kept = KeptViews()
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
    assert kept_m(after(first, decision(NEAR, KEEP_MS - old_ms))) > 15.0
    assert after(first, decision(NEAR, KEEP_MS + 1 - old_ms)).kept_rays == ()


@pytest.mark.parametrize(("now_ms", "free"), [(60, True), (180, True), (KEEP_MS - 50, True), (KEEP_MS - 49, False)])
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
    kept = KeptViews()
    for ms, found in ((0, NEAR), (80, FAR), (160, NEAR)):
        kept.take(decision(found, ms))
    now = decision(NEAR, 200)
    assert kept_m(path_sight(now, AVOID, GUARD, 0.0, kept.before(now))) > 15.0
    assert len(list(kept.before(now))) == 3


def random_model(rng: np.random.Generator) -> FrameModel:
    """A view of 110 degrees to a random side, of random free ranges."""
    found = model(free_to_m=20.0, view_deg=110.0)
    shape = found.free.free_to_m.shape
    free = replace(
        found.free,
        azimuth_edges_rad=found.free.azimuth_edges_rad + np.float32(rng.choice([0.0, 1.0, -1.0])),
        free_from_m=rng.uniform(0.0, 1.2, shape).astype(np.float32),
        free_to_m=np.where(rng.random(shape) < 0.2, 0.0, rng.uniform(2.0, 20.0, shape)).astype(np.float32),
    )
    return replace(found, free=free, valid=bool(rng.random() < 0.9))


@pytest.mark.parametrize("seed", range(8))
def test_views_combined_one_after_another_give_the_rays_of_all_together(seed: int) -> None:
    """The rays of each decision, with its views down to each age, are those that the views together give."""
    rng, kept, exposures = np.random.default_rng(seed), KeptViews(), list[int]()
    decisions = []
    for k in range(4):
        at = replace(HERE, heading_rad=0.1 * k, position_ned_m=(0.3 * k, 0.02 * k, -3.0 - 0.05 * k))
        views = tuple(View(random_model(rng), LevelTransform(0.0, tuple(rng.normal(0.0, 0.1, 3)))) for _ in range(4))
        frames = tuple((f"c{i}", T_NS + 60 * k * MS - int(rng.integers(0, 200)) * MS) for i in range(4))
        decisions.append(replace(decision(FAR, 60 * k, at), views=views, weak_px=(0.0,) * 4, frames=frames))
        kept.take(decisions[-1])
    climb = (2.0, 0.3, -0.4)
    now = decision(NEAR, 200, replace(HERE, heading_rad=0.4, position_ned_m=(1.0, 0.1, -3.1)), climb)
    found = path_sight(now, AVOID, GUARD, 0.0, kept.before(now)).kept_rays
    expected = []
    for old in decisions:
        for exposed_ns in sorted((t_ns for _, t_ns in old.frames), reverse=True):
            if now.t_ns - exposed_ns <= KEEP_FREE_NS:
                exposures.append(exposed_ns)
                expected.append(rays_together(old, now, exposed_ns))
    assert [rays.exposed_ns for rays in found] == exposures
    assert any(rays.any() for rays in expected)
    for rays, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(rays.free_m, wanted)


def rays_together(old: Surroundings, now: Surroundings, since_ns: int) -> np.ndarray:
    """The rays of the corridor of a decision by all views of an older one that were exposed since then, together."""
    young = [k for k, (_, t_ns) in enumerate(old.frames) if t_ns >= since_ns]
    part = replace(old, views=tuple(old.views[k] for k in young), frames=tuple(old.frames[k] for k in young))
    assert now.here is not None
    assert old.here is not None
    c, s = math.cos(old.here.heading_rad), math.sin(old.here.heading_rad)
    north, east, down = np.subtract(now.here.position_ned_m, old.here.position_ned_m).tolist()
    shift, turn = (c * north + s * east, c * east - s * north, down), now.here.heading_rad - old.here.heading_rad
    ct, st = math.cos(turn), math.sin(turn)

    def free(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, y = ct * x - st * y + shift[0], st * x + ct * y + shift[1]
        return np.any([measured_free(view, x, y, z + shift[2]) for view in part.views], axis=0)

    velocity = now.velocity_ned_m_s
    assert velocity is not None
    angle = math.atan2(velocity[1], velocity[0]) - now.here.heading_rad
    slope = velocity[2] / math.hypot(velocity[0], velocity[1])
    samples = samples_of(Path(math.cos(angle), math.sin(angle), slope), AVOID, GUARD)
    return samples.rays_m(samples.found(free))

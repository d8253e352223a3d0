"""Obstacles that have left the view: remembered where they stand, and forgotten when seen through."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.obstacle_memory import Here, ObstacleMemory
from companion.autopilot.polar_histogram import scan
from companion.autopilot.view_free import View

from ..failsafe_views import AVOID, MS, NS, front_seen
from ..sector_models import HERE, model, wall_at


def test_a_near_obstacle_that_leaves_the_view_is_remembered_where_it_stands() -> None:
    """A pole 3 m ahead; the vehicle flies 2 m forward and turns right by 90 degrees, and no camera observes it any more."""
    memory = ObstacleMemory(AVOID)
    first = front_seen(wall_at(0.0, 3.0))
    assert np.isinf(memory.recall(first, [], Here(0.0, (10.0, 5.0, -3.0), 1), NS).distance_m).all()
    nothing = scan([], AVOID)
    then = memory.recall(nothing, [], Here(math.pi / 2, (12.0, 5.0, -3.0), 1), 2 * NS).distance_m
    assert np.flatnonzero(np.isfinite(then)).tolist() == [54]  # 1 m to the left
    assert then[54] == pytest.approx(0.7, abs=0.05)
    late_ns = NS + round(AVOID.remember_s * NS)
    for t_ns, kept in ((late_ns - MS, True), (late_ns + MS, False)):
        left = memory.recall(nothing, [], Here(math.pi / 2, (12.0, 5.0, -3.0), 1), t_ns)
        assert bool(np.isfinite(left.distance_m[54])) is kept


def test_without_a_position_the_turn_is_taken_into_account() -> None:
    memory = ObstacleMemory(AVOID)
    memory.recall(front_seen(wall_at(0.0, 3.0)), [], Here(0.1), NS)
    then = memory.recall(scan([], AVOID), [], Here(0.1 + math.radians(30.0)), 2 * NS).distance_m
    assert np.flatnonzero(np.isfinite(then)).tolist() == [66]


def test_what_is_seen_through_is_forgotten() -> None:
    memory = ObstacleMemory(AVOID)
    memory.recall(front_seen(wall_at(0.0, 3.0)), [], Here(0.0), NS)
    clear = View(model(free_to_m=13.0, view_deg=72.0), HERE, t_ns=2 * NS)
    memory.recall(scan([clear], AVOID), [clear], Here(0.0), 2 * NS)
    clear = replace(clear, t_ns=2 * NS + NS // 12)
    assert np.isinf(memory.recall(scan([clear], AVOID), [clear], Here(0.0), 2 * NS).distance_m).all()
    assert np.isinf(memory.recall(scan([], AVOID), [], Here(0.0), 2 * NS).distance_m).all()


def test_one_frame_that_does_not_find_an_obstacle_removes_nothing() -> None:
    """A thin obstacle is not found in every frame, and a frame may be used by several decisions."""
    memory = ObstacleMemory(AVOID)
    pole = View(model(wall_at(0.0, 3.0)), HERE, t_ns=NS)
    clear = View(model(free_to_m=13.0, view_deg=72.0), HERE)
    memory.recall(scan([pole], AVOID), [pole], Here(0.0), NS)
    for frame_ns in (NS + 1, NS + 1):
        lost = replace(clear, t_ns=frame_ns)
        assert np.isfinite(memory.recall(scan([lost], AVOID), [lost], Here(0.0), frame_ns).distance_m[0])
    hidden = View(model(free_to_m=2.0, view_deg=72.0), HERE, t_ns=NS + 2)
    memory.recall(scan([hidden], AVOID), [hidden], Here(0.0), NS + 2)
    lost = replace(clear, t_ns=NS + 3)
    assert np.isfinite(memory.recall(scan([lost], AVOID), [lost], Here(0.0), NS + 3).distance_m[0])


def test_two_cameras_that_see_through_a_place_together_count_by_their_older_frame() -> None:
    """The left one shows the left side of the place, in one frame; the right one the rest, in two frames."""
    memory = ObstacleMemory(AVOID)
    memory.recall(front_seen(wall_at(0.0, 3.0)), [], Here(0.0), NS)
    whole = model(free_to_m=13.0, view_deg=72.0)
    half = replace(whole.free, azimuth_edges_rad=np.linspace(-0.6, 0.0, 37, dtype=np.float32))
    left = View(replace(whole, free=half), HERE, t_ns=2 * NS)
    half = replace(whole.free, azimuth_edges_rad=np.linspace(0.0, 0.6, 37, dtype=np.float32))
    for frame_ns, seen in ((2 * NS, True), (2 * NS + NS // 12, True)):
        views = [left, View(replace(whole, free=half), HERE, t_ns=frame_ns)]
        then = memory.recall(scan(views, AVOID), views, Here(0.0), frame_ns).distance_m
        assert np.isfinite(then[0]) == seen
    views = [replace(left, t_ns=2 * NS + NS // 12), views[1]]
    assert np.isinf(memory.recall(scan(views, AVOID), views, Here(0.0), 2 * NS + NS // 10).distance_m[0])


@pytest.mark.parametrize("newer_first", [True, False])
def test_of_two_cameras_that_both_see_through_a_place_the_newer_frame_counts(newer_first: bool) -> None:
    """In either order: the frame that has counted does not count again after the other camera is blind."""
    memory = ObstacleMemory(AVOID)
    memory.recall(front_seen(wall_at(0.0, 3.0)), [], Here(0.0), NS)
    older, newer = (View(model(free_to_m=13.0, view_deg=72.0), HERE, t_ns=t) for t in (2 * NS, 2 * NS + MS))
    views = [newer, older] if newer_first else [older, newer]
    for seen in (views, [newer], [older], [newer]):
        then = memory.recall(scan(seen, AVOID), seen, Here(0.0), 2 * NS + MS).distance_m
        assert np.isfinite(then[0])
    views = [replace(v, t_ns=v.t_ns + NS // 20) if v is newer else v for v in views]
    assert np.isinf(memory.recall(scan(views, AVOID), views, Here(0.0), 2 * NS + NS // 10).distance_m[0])


@pytest.mark.parametrize("after", [Here(0.0, (40.0, -7.0, -3.0), 2), Here(0.0), Here(0.0, (12.0, 5.0, -3.0), 1)])
@pytest.mark.parametrize("before", [Here(0.0, (10.0, 5.0, -3.0), 1), Here(0.0)])
def test_a_jump_of_the_position_does_not_take_away_what_stands_around(before: Here, after: Here) -> None:
    """The autopilot's estimate jumps, comes or goes; the obstacle beside the vehicle does not."""
    memory = ObstacleMemory(AVOID)
    memory.recall(front_seen(wall_at(0.0, 4.0)), [], before, NS)
    then = memory.recall(scan([], AVOID), [], after, NS + NS // 15).distance_m
    flown_m = 2.0 if before.section == after.section == 1 else 0.0
    assert np.flatnonzero(np.isfinite(then)).tolist() == [0]
    assert then[0] == pytest.approx(4.0 - 0.3 - flown_m, abs=0.01)


@pytest.mark.parametrize("after", [Here(0.0, (40.0, -7.0, -3.0), 2, velocity_ned_m_s=(6.0, 0.0, 0.0)), Here(0.0)])
def test_at_a_jump_the_way_flown_since_the_last_decision_counts(after: Here) -> None:
    """Otherwise an obstacle ahead would be remembered farther away with each jump."""
    memory = ObstacleMemory(AVOID)
    before = Here(0.0, (10.0, 5.0, -3.0), 1, velocity_ned_m_s=(6.0, 0.0, 0.0))
    memory.recall(front_seen(wall_at(0.0, 4.0)), [], before, NS)
    then = memory.recall(scan([], AVOID), [], after, NS + NS // 15).distance_m
    assert then[0] == pytest.approx(4.0 - 0.3 - 0.4, abs=0.01)


@pytest.mark.parametrize("at_deg", [36.3, 36.7, 37.2, -36.3, -37.2])
def test_a_pole_that_just_left_the_view_is_not_seen_through_beside_itself(at_deg: float) -> None:
    """Its sector's middle lies inside of the view, and free; the pole stands outside."""
    memory = ObstacleMemory(AVOID)
    pole = wall_at(at_deg, 4.0, 0.02)
    memory.recall(scan([View(model(pole), HERE)], AVOID), [], Here(0.0), NS)
    clear = View(model(free_to_m=13.0, view_deg=72.0), HERE)
    then = memory.recall(scan([clear], AVOID), [clear], Here(0.0), NS + NS // 15).distance_m
    assert np.isfinite(then).any()

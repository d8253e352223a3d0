"""Without a position: what left the view is remembered where it may be, for a moment, and nothing is free for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.types import FrameModel
from osape_client.query.space import Occupancy
from osape_client.world.level_memory import LevelMemory
from osape_client.world.space import WorldSpace
from tests.core.worlds import NS, blind, seen, wall

AHEAD = np.array([wall(6.0, -2.0, 6.0, 2.0)])
TENTH = NS // 10


def ahead(distance_m: float = 6.0) -> FrameModel:
    """A wall of 4 m right ahead, in level."""
    return seen(np.array([wall(distance_m, -2.0, distance_m, 2.0)]), (0.0, 0.0), 0.0, 0).model


def nothing() -> FrameModel:
    return seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, 0).model


def at(memory: LevelMemory, point: tuple[float, float, float], heading_rad: float, now_ns: int) -> int:
    return int(WorldSpace(memory.snapshot(heading_rad, now_ns)).points([point])[0])


def test_what_left_the_view_is_where_it_was_but_for_the_turn() -> None:
    """The vehicle turns right by 90 degrees and looks at nothing: the wall is on its left then."""
    memory = LevelMemory(speed_m_s=0.0)
    memory.add("front", ahead(), 0.0, 0)
    memory.add("front", nothing(), math.pi / 2, TENTH)
    assert at(memory, (0.0, -6.0, 0.0), math.pi / 2, TENTH) == Occupancy.OCCUPIED
    assert at(memory, (6.0, 0.0, 0.0), math.pi / 2, TENTH) == Occupancy.UNKNOWN
    assert at(memory, (6.0, 0.0, 0.0), 0.0, TENTH) == Occupancy.OCCUPIED


def test_margins_grow_with_the_way_that_may_have_been_flown() -> None:
    memory = LevelMemory(speed_m_s=5.0)
    memory.add("front", ahead(), 0.0, 0)
    own = float(ahead().margin_m[0])
    for tenths in range(10):
        (margin,) = memory.snapshot(0.0, tenths * TENTH).margin_m.tolist()
        assert margin == pytest.approx(own + 0.5 * tenths, abs=1e-6)
    assert at(memory, (4.0, 0.0, 0.0), 0.0, 0) == Occupancy.UNKNOWN
    assert at(memory, (4.0, 0.0, 0.0), 0.0, 5 * TENTH) == Occupancy.OCCUPIED


def test_nothing_is_ever_free_in_it() -> None:
    memory = LevelMemory()
    points = np.random.default_rng(3).uniform(-15, 15, (500, 3))
    for k in range(20):
        memory.add("front", ahead(), 0.1 * k, k * TENTH)
        space = WorldSpace(memory.snapshot(0.1 * k, k * TENTH + 7))
        assert Occupancy.FREE not in space.points(points)
        assert Occupancy.FREE not in space.segments(points[::2], points[1::2], 0.3)


def test_after_the_memory_there_is_nothing() -> None:
    memory = LevelMemory(memory_s=1.0)
    memory.add("front", ahead(), 0.0, 5 * NS)
    assert len(memory.snapshot(0.0, 6 * NS).planes) == 1
    assert len(memory.snapshot(0.0, 6 * NS + 1).planes) == 0
    assert len(LevelMemory().snapshot(0.0, 0).planes) == 0


def test_a_blind_frame_takes_nothing_away_and_neither_does_one_that_comes_late() -> None:
    memory = LevelMemory()
    memory.add("front", ahead(), 0.0, 2 * TENTH)
    memory.add("front", blind(0).model, 0.0, 3 * TENTH)
    memory.add("front", ahead(3.0), 0.0, TENTH)
    picture = memory.snapshot(0.0, 3 * TENTH)
    assert picture.seen_ns.tolist() == [2 * TENTH]
    assert picture.planes[0, 0] == pytest.approx(6.0)


def test_each_camera_has_its_own_memory() -> None:
    memory = LevelMemory(speed_m_s=0.0)
    memory.add("front", ahead(), 0.0, 0)
    memory.add("left", ahead(3.0), 0.0, 0)
    memory.add("front", nothing(), 0.0, TENTH)
    assert sorted(memory.snapshot(0.0, TENTH).planes[:, 0].tolist()) == pytest.approx([3.0, 6.0])


def test_it_is_bounded_at_any_rate() -> None:
    memory, model = LevelMemory(), ahead()
    for k in range(2000):
        memory.add("front", model, 0.0, k * NS // 1000)
    picture = memory.snapshot(0.0, 2 * NS)
    assert 5 <= len(picture.planes) <= 7
    assert picture.seen_ns.max() == 1999 * NS // 1000
    assert picture.seen_ns.min() <= 1.25 * NS  # and it reaches back


def test_a_heading_or_a_plane_that_is_no_number() -> None:
    memory = LevelMemory()
    with pytest.raises(ValueError, match="heading nan of camera front at 7 ns"):
        memory.add("front", ahead(), math.nan, 7)
    with pytest.raises(ValueError, match="heading inf at 9 ns"):
        memory.snapshot(math.inf, 9)
    two = seen(np.array([*AHEAD, wall(9.0, 5.0, 9.0, 9.0)]), (0.0, 0.0), 0.0, 0).model
    planes = two.planes.copy()
    planes[0, 0] = np.nan
    memory.add("front", replace(two, planes=planes), 0.0, 0)
    assert len(memory.snapshot(0.0, 0).planes) == len(two.planes) - 1
    assert len(two.planes) == 2


@pytest.mark.parametrize("memory_s", [0.0, 1.0])
def test_after_a_restart_of_the_clock_new_frames_count_and_old_ones_do_not(memory_s: float) -> None:
    """The stamps are of the computer that sends; it may have been restarted."""
    memory = LevelMemory(memory_s=memory_s)
    memory.add("front", ahead(), 0.0, 500 * NS)
    memory.add("left", ahead(4.0), 0.0, 501 * NS)
    memory.add("front", ahead(3.0), 0.0, 20 * NS)
    picture = memory.snapshot(0.0, 20 * NS)
    assert picture.seen_ns.tolist() == [20 * NS]
    assert picture.planes[0, 0] == pytest.approx(3.0)
    memory.add("front", ahead(5.0), 0.0, 19 * NS)  # late by no more than a second
    assert memory.snapshot(0.0, 20 * NS).seen_ns.tolist() == [20 * NS]

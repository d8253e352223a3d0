"""What the random flights with faults judge of the merged world, and the step of the autopilot's clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.client_queries import world_space
from benchmarks.faults.field import DEEP_M, POINT_M, random_field
from benchmarks.faults.judge import Judge, at_height
from benchmarks.faults.loop import FaultLoop
from benchmarks.faults.switches import NS
from companion.config.avoidance import AvoidParams
from core.world.snapshot import WorldSnapshot
from drivers.mavlink.session_types import PX4

AVOID = AvoidParams(send=True, rays=2, slices=6, step_m=0.5)


@pytest.fixture(scope="module")
def flown() -> tuple[FaultLoop, Judge]:
    """A flight without a fault, in which nothing moves."""
    judge = Judge([], PX4)
    loop = FaultLoop(random_field(4, 20.0), PX4, 4, [], judge.sent, AVOID)
    loop.on_published = judge.published
    loop.fly(2.5)
    assert judge.violations == []
    assert judge.worlds >= 2
    return loop, judge


@pytest.mark.parametrize("seed", range(6))
def test_deep_points_are_behind_a_surface(seed: int) -> None:
    """As seen from the origin."""
    field = random_field(seed, 1.0)
    bearing_rad, range_m = np.arctan2(*field.outline_m.T[::-1]), np.hypot(*field.outline_m.T)
    for north, east in field.deep_m:
        before = np.abs(np.remainder(bearing_rad - np.arctan2(east, north) + np.pi, 2.0 * np.pi) - np.pi) < 0.01
        assert range_m[before].min() < np.hypot(north, east) - DEEP_M + 2.0 * POINT_M


def test_the_judge_notices_free_space_in_a_solid(
    flown: tuple[FaultLoop, Judge], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A place before the vehicle counts as a solid."""
    loop, judge = flown
    place_m = loop.truth().position_ned_m
    ahead_m = [(place_m[0] + 2.0, place_m[1])]
    assert judge._world.free(at_height(np.array(ahead_m))).all()
    monkeypatch.setattr(loop, "field", replace(loop.field, deep_m=np.array(ahead_m)))
    judge._judge_world(loop, loop.flown_ns)
    assert ["points in solids" in v.what for v in judge.violations] == [True]
    judge.violations.clear()


def test_the_judge_notices_a_lost_obstacle(flown: tuple[FaultLoop, Judge]) -> None:
    loop, judge = flown
    judge._judge_world(loop, loop.flown_ns)
    assert judge.violations == []
    judge._world.space = world_space(WorldSnapshot.empty())
    judge._judge_world(loop, loop.flown_ns)
    assert ["are lost" in v.what for v in judge.violations] == [True]
    judge.violations.clear()


def test_the_boot_time_steps_without_a_restart() -> None:
    loop = FaultLoop(random_field(4, 20.0), PX4, 4, [], lambda loop, values: None, AVOID)
    intervals = dict(loop.autopilot._intervals)
    before_ns = loop.autopilot.boot_ns(NS)
    loop.step_clock()
    assert 0.02 * NS < abs(loop.autopilot.boot_ns(NS) - before_ns) < 8.0 * NS
    assert loop.autopilot._intervals == intervals

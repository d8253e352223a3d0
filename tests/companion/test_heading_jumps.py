"""Jumps of the heading estimate: the autopilot resets it in flight, and the vehicle has not turned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.distance_sensor import Overhead
from companion.autopilot.free_space_memory import FreeMemory
from companion.autopilot.obstacle_memory import Here, ObstacleMemory
from companion.autopilot.obstacle_report import ObstacleReportBuilder
from companion.autopilot.polar_histogram import scan
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.sync import SyncParams
from companion.guard.kept_space import Tolerance, reach_m
from companion.pipeline.heading_jumps import HeadingJumps, heading_jump_rad
from companion.pipeline.multi_camera import AllCamerasModelBuilder
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.quaternion import from_rotation_vector, product
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import AttitudeAt, Source, Synchroniser
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, PoseSample

from .made_up import INFO, MS, START_NS, EasyExtractor, frame
from .test_guard_path import SIGHT
from .test_obstacle_sender import AVOID, CAMERA, NS, PX4, Chain
from .test_overhead import AHEAD, BEAM
from .test_sectors import HERE, model, wall_at

JUMP = math.radians(40.0)


def at(t_ms: int, yaw_rad: float, rate: float | None = 0.0, pitch_rad: float = 0.0) -> AttitudeSample:
    q = quaternion_from_euler(0.0, pitch_rad, yaw_rad)
    return AttitudeSample(t_ms * MS, t_ms * MS, q, None if rate is None else (0.0, 0.0, rate))


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.tuples(*[st.floats(-6.0, 6.0)] * 3),
    st.sampled_from([5, 10, 20]),
    st.floats(-3.0, 3.0),
)
def test_a_jump_is_told_from_the_hardest_turn_at_any_attitude(
    start: tuple[float, float, float], rates: tuple[float, float, float], every_ms: int, jump_rad: float
) -> None:
    q = from_rotation_vector(start)
    x, y, z = (r * every_ms / 1000.0 for r in rates)
    turned = product(q, from_rotation_vector((x, y, z)))
    before = AttitudeSample(0, 0, q, rates)
    assert heading_jump_rad(before, AttitudeSample(every_ms * MS, 0, turned, rates)) == 0.0
    reset = product(from_rotation_vector((0.0, 0.0, jump_rad)), turned)
    found = heading_jump_rad(before, AttitudeSample(every_ms * MS, 0, reset, rates))
    if abs(jump_rad) > math.radians(3.0) + 0.041:
        assert found == pytest.approx(jump_rad, abs=1e-6)


@pytest.mark.parametrize("rate", [0.0, None])
def test_jumps_add_up_and_are_told_by_their_stamps(rate: float | None) -> None:
    jumps = HeadingJumps()
    for sample in (at(0, 0.0, rate), at(10, JUMP, rate), at(5, 9.0, rate), at(20, JUMP, rate), at(30, 0.0, rate)):
        jumps.take(sample)
    assert (jumps.number, jumps.turned_rad) == (2, pytest.approx(0.0))
    assert [jumps.newest_ns(t * MS) for t in (9, 10, 29, 30)] == [0, 10 * MS, 10 * MS, 30 * MS]
    assert [jumps.since_rad(t * MS) for t in (0, 10, 30)] == pytest.approx([0.0, -JUMP, 0.0])


def test_in_a_gap_and_at_a_restart_the_heading_may_have_jumped() -> None:
    jumps = HeadingJumps()
    for t_ms in (0, 400, 800, 1400):
        jumps.take(at(t_ms, 0.0))
    assert (jumps.number, jumps.turned_rad) == (1, 0.0)
    jumps.take(at(100, 1.0))
    assert (jumps.number, jumps.turned_rad) == (2, 0.0)
    jumps.take(at(110, 1.0))
    assert jumps.number == 2


def test_no_attitude_is_interpolated_across_a_jump() -> None:
    """A frame between both samples would be placed by a heading that never was."""
    sync = Synchroniser(SyncParams())
    for sample in (at(0, 0.0), at(20, 0.0), at(40, JUMP), at(60, JUMP)):
        sync.add(sample)
    for t_ms, yaw_rad, jump_ns in ((10, 0.0, 0), (28, 0.0, 0), (33, JUMP, 40 * MS), (50, JUMP, 40 * MS)):
        found = sync.attitude_at(t_ms * MS)
        assert isinstance(found, AttitudeAt)
        assert found.q_ned_frd_wxyz == pytest.approx(quaternion_from_euler(0.0, 0.0, yaw_rad))
        assert (found.jump_ns, found.turned_rad) == (jump_ns, pytest.approx(yaw_rad))
    assert found.source is Source.INTERPOLATED


# ---- obstacle output --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("position", [None, (0.0, 0.0, -2.0)])
def test_what_a_frame_from_before_the_jump_shows_stays_where_it_is(position: tuple[float, float, float] | None) -> None:
    """Before, a pole was sent 40 degrees beside its place, and space beside the view was sent as clear."""
    chain = Chain(model(wall_at(10.0, 4.0, 0.4), free_to_m=13.0, view_deg=72.0))
    chain.position = position
    chain.fly(1.0)
    before = chain.report(PX4).values
    assert before is not None
    assert (before[2], before[-2]) == (pytest.approx(370, abs=20), 1201)
    chain.yaw_rad = JUMP
    chain.fly(0.05, frames=False)
    after = chain.report(PX4).values
    assert after is not None
    assert after.tolist() == before.tolist()
    chain.fly(0.2)
    after = chain.report(PX4).values
    assert after is not None
    assert after.tolist() == before.tolist()


def test_a_turn_is_not_a_jump() -> None:
    chain = Chain(model(wall_at(0.0, 4.0, 0.4), free_to_m=13.0, view_deg=72.0))
    chain.fly(1.0)
    for _ in range(5):  # 2 rad/s, reported without rates
        chain.yaw_rad += 0.02
        chain.fly(0.01, frames=False)
    values = chain.report(PX4).values
    assert values is not None
    assert values[70] < 400
    assert values[2] == 1201


def test_space_seen_free_before_a_jump_does_not_count_after_it() -> None:
    seen: list[Surroundings] = []
    chain = Chain(model(free_to_m=13.0, view_deg=72.0))
    chain.builder = ObstacleReportBuilder(AVOID, ("front",), 0.3, observer=seen.append)
    chain.builder.announce(CAMERA)
    chain.position = (0.0, 0.0, -2.0)

    def recalled(angle_rad: float) -> bool:
        """A place above the image."""
        x, y = np.array([2.6 * math.cos(angle_rad)]), np.array([2.6 * math.sin(angle_rad)])
        assert seen[-1].recall is not None
        return bool(seen[-1].recall(x, y, np.array([-1.6]))[0])

    for _ in range(20):
        chain.fly(0.05)
        chain.report(PX4)
    assert recalled(0.0)
    assert not recalled(-JUMP)
    chain.yaw_rad = JUMP
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert not recalled(-JUMP)


def test_the_memory_of_free_space_ends_with_the_estimate_of_the_heading() -> None:
    memory, here = FreeMemory(AvoidParams()), Here(0.0, (0.0, 0.0, -2.0), 1)
    memory.see("front", NS, View(model(free_to_m=13.0, view_deg=72.0), HERE), here)
    place = np.array([4.0]), np.array([0.0]), np.array([0.0])
    assert memory.free((), here, NS, *place)[0]
    assert not memory.free((), replace(here, heading_section=1), NS, *place)[0]


@pytest.mark.parametrize("position", [None, (10.0, -5.0, -2.0)])
def test_a_remembered_obstacle_keeps_its_direction(position: tuple[float, float, float] | None) -> None:
    memory, here = ObstacleMemory(AVOID), Here(0.3, position, None if position is None else 1)
    memory.recall(scan([View(model(wall_at(20.0, 3.0), free_to_m=13.0, view_deg=72.0), HERE)], AVOID), [], here, NS)
    later = replace(here, heading_rad=0.3 + JUMP, turned_rad=JUMP, heading_section=1)
    then = memory.recall(scan([], AVOID), [], later, NS + NS // 15).distance_m
    assert np.flatnonzero(np.isfinite(then)).tolist() == [4]
    assert then[4] == pytest.approx(2.7, abs=0.05)


def test_a_beam_above_keeps_its_direction() -> None:
    known = Overhead(replace(AVOID, upward=True, remember_up_s=5.0))
    known.see(View(model(BEAM), AHEAD), Here(0.0, (100.0, 50.0, -10.0), 1), NS)
    jumped = Here(JUMP, (100.0, 50.0, -10.0), 1, heading_section=1, turned_rad=JUMP)
    assert known.upward_m(jumped, NS) is None
    there = 100.0 + 6.0 * math.cos(JUMP), 50.0 + 6.0 * math.sin(JUMP), -10.0  # straight ahead of it
    assert known.upward_m(replace(jumped, position_ned_m=there), NS) == pytest.approx(2.5)


def test_a_sight_of_the_opposite_direction_does_not_count() -> None:
    """The sine of the angle between them is small too."""
    before = replace(SIGHT, estimate=(1, 0), ahead_rad=math.pi / 2 - 0.01)
    newest = replace(before, ahead_rad=-math.pi / 2)
    assert reach_m(before, newest, Tolerance(0.3, 0.3), ahead=True) == 0.0
    assert reach_m(before, replace(before), Tolerance(0.3, 0.3), ahead=True) > 0.0


@pytest.mark.parametrize(("estimate", "counts"), [((1, 0), True), ((None, 0), True), ((2, 0), False), ((1, 1), False)])
def test_the_guard_compares_sights_of_one_estimate_only(estimate: tuple[int | None, int], counts: bool) -> None:
    before, newest = replace(SIGHT, estimate=(1, 0)), replace(SIGHT, estimate=estimate)
    assert (reach_m(before, newest, Tolerance(0.3, 0.3)) > 0.0) == counts


# ---- several cameras --------------------------------------------------------------------------------------------------


def two_cameras(yaw_rad: float, north_m: float) -> dict[str, PrismsResult]:
    """A frame of each camera, 60 ms apart; between them the heading or the position jumps. Its counter stays."""
    right = replace(INFO, camera="right")
    pipeline = Pipeline((INFO, right), EasyExtractor)
    found = {}
    for k in range(10):
        t_ns = START_NS + k * 20 * MS
        jumped = k >= 6
        q = quaternion_from_euler(0.0, 0.0, 0.2 + yaw_rad * jumped)
        pipeline.handle(AttitudeSample(t_ns, t_ns, q, (0.0, 0.0, 0.0)))
        pipeline.handle(PoseSample(t_ns, t_ns, (north_m * jumped, 0.0, -3.0), (0.0, 0.0, 0.0)))
        camera = {5: "front", 8: "right"}.get(k)
        if camera is not None:
            result = pipeline.handle(frame(7, t_ns, camera=camera))[1]
            assert isinstance(result, PrismsResult)
            found[camera] = result
    return found


@pytest.mark.parametrize(("yaw_rad", "north_m"), [(0.0, 0.0), (JUMP, 0.0), (0.0, 3.0), (JUMP, 3.0)])
def test_results_of_both_sides_of_a_jump_are_not_put_together_in_ned(yaw_rad: float, north_m: float) -> None:
    """Both cameras look the same way and find the same: in one frame it is at one place."""
    builder = AllCamerasModelBuilder(("front", "right"))
    for result in two_cameras(yaw_rad, north_m).values():
        builder.result(result)
    together = builder.model(lambda camera: "")
    assert together.frame == ("level" if yaw_rad or north_m else "ned")
    front, right = (p.model for p in together.parts if isinstance(p, PrismsResult))
    assert front is not None
    assert right is not None
    np.testing.assert_allclose(front.planes, right.planes, atol=1e-4)

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
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_memory import Here, ObstacleMemory
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import scan
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.config.sync import SyncParams
from companion.guard.kept_space import Tolerance, reach_m
from companion.live.world_thread import observation_of
from companion.pipeline.heading_jumps import HeadingJumps, heading_jump_rad
from companion.pipeline.multi_camera import HEADING_LOST, AllCamerasModelBuilder, UnavailableCamera
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.quaternion import from_rotation_vector, product
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import AttitudeAt, Source, Synchroniser
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, PoseSample
from core.world.world import World

from ..guard_sight import SIGHT
from ..report_chain import AVOID, CAMERA, NS, PX4, Chain
from ..sector_models import HERE, model, wall_at
from ..small_recordings import INFO, MS, START_NS, EasyExtractor, flight, frame
from .test_distance_sensor import AHEAD, BEAM

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
    for t_ms in (1000, 1250, 1500, 1751):
        jumps.take(at(t_ms, 0.0))
    assert (jumps.number, jumps.turned_rad) == (1, 0.0)
    assert [jumps.newest_ns(t * MS) for t in (1750, 1751)] == [0, 1751 * MS]
    assert jumps.up_to(1751 * MS) == ((1751 * MS, 0.0),)
    jumps.take(at(100, 1.0))
    assert (jumps.number, jumps.turned_rad) == (2, 0.0)
    assert jumps.newest_ns(100 * MS) == 100 * MS
    jumps.take(at(110, 1.0))
    assert jumps.number == 2


def test_an_attitude_of_before_a_gap_does_not_contain_it() -> None:
    """Results of two cameras are put together only where both are of the same side of the gap."""
    sync = Synchroniser(SyncParams())
    for t_ms in (*range(0, 1001, 20), *range(1400, 1501, 20)):
        sync.add(at(t_ms, 0.0))
    before, after = sync.attitude_at(500 * MS), sync.attitude_at(1450 * MS)
    assert isinstance(before, AttitudeAt)
    assert isinstance(after, AttitudeAt)
    assert (before.gap_ns, after.gap_ns) == (0, 1400 * MS)


def test_after_a_restart_the_jumps_before_it_do_not_count() -> None:
    """Their stamps are later than all of the new clock."""
    jumps = HeadingJumps()
    for sample in (at(5000, 0.0), at(5010, JUMP), at(100, JUMP), at(110, JUMP)):
        jumps.take(sample)
    assert jumps.since_rad(100 * MS) == 0.0
    assert jumps.jump_ns == 100 * MS
    assert jumps.up_to(6000 * MS) == ((100 * MS, 0.0),)


@pytest.mark.parametrize(
    ("every_ms", "jump_deg", "number"), [(20, 9.0, 0), (20, 11.0, 1), (50, 19.0, 0), (50, 21.0, 1)]
)
def test_without_rates_a_turn_faster_than_6_rad_s_is_a_jump(every_ms: int, jump_deg: float, number: int) -> None:
    jumps = HeadingJumps()
    for sample in (at(0, 0.0, None), at(every_ms, math.radians(jump_deg), None)):
        jumps.take(sample)
    assert jumps.number == number


@pytest.mark.parametrize("every_ms", [10, 20, 33, 100, 200, 250])
@pytest.mark.parametrize("turn_rad_s", [0.5, 2.0, 5.0])
def test_without_rates_a_turn_is_not_a_jump(every_ms: int, turn_rad_s: float) -> None:
    """As of frames.csv, TUM poses and .ulg and .bin logs, which hold no rates."""
    jumps = HeadingJumps()
    for t_ms in range(0, 10_000, every_ms):
        jumps.take(at(t_ms, math.remainder(turn_rad_s * t_ms / 1000.0, math.tau), None))
    assert (jumps.number, jumps.turned_rad) == (0, 0.0)


@pytest.mark.parametrize(("every_ms", "jump_deg"), [(20, 3.1), (50, 3.7), (100, 4.5), (200, 8.8), (250, 12.0)])
def test_a_small_jump_is_detected_between_rare_attitudes(every_ms: int, jump_deg: float) -> None:
    """At 10 Hz 14 degrees were not, in a gap of 0.4 s 45 degrees: a wall was then free in the merged world."""
    for turn_rad_s in (0.0, 1.0):
        jumps, turned_rad = HeadingJumps(), turn_rad_s * every_ms / 1000.0
        for k, jumped in ((0, 0.0), (1, 0.0), (2, math.radians(jump_deg)), (3, math.radians(jump_deg))):
            jumps.take(at(k * every_ms, k * turned_rad + jumped, turn_rad_s))
        assert jumps.number == 1
        assert jumps.turned_rad == pytest.approx(math.radians(jump_deg))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("rates", "limit_rad"), [((0.0, 2.0), 0.177), ((2.0, 2.0), 0.077), ((None, 2.0), 0.127)])
def test_the_limit_of_a_turn_grows_with_the_change_of_the_rates(
    rates: tuple[float | None, float], limit_rad: float, sign: float
) -> None:
    """In 0.1 s: 3 degrees, 0.025 rad by 10 rad/s2 and back, and half of the change by the time. One that is not known is
    10 rad/s2. The turn that is expected is by the mean of the rates that are known."""
    known = [rate for rate in rates if rate is not None]
    turned_rad = 0.1 * sum(known) / len(known)
    for jump_rad, jumped in ((limit_rad - 0.001, False), (limit_rad + 0.001, True)):
        before, after = at(60_000, 1.0, rates[0]), at(60_100, 1.0 + turned_rad + sign * jump_rad, rates[1])
        assert heading_jump_rad(before, after) == pytest.approx(sign * jump_rad if jumped else 0.0)


@pytest.mark.parametrize("rate_rad_s", [71.0, 1e6, -1e200])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_rates_that_nothing_flies_with_hide_no_jump(rate_rad_s: float, which: int) -> None:
    """The limit grows with the change of the rates: a single absurd rate hid a jump of 40 degrees."""
    jumps = HeadingJumps()
    for k, yaw_rad in enumerate((0.0, JUMP, JUMP)):
        sample = at(k * 10, yaw_rad, rate_rad_s if k == which else 0.0)
        jumps.take(replace(sample, rates_frd_rad_s=(0.0, rate_rad_s, 0.0)) if k == which else sample)
    assert jumps.number == 1
    assert jumps.turned_rad == pytest.approx(JUMP)


@pytest.mark.parametrize("every_ms", [20, 50, 100, 200])
def test_a_turn_that_begins_and_ends_is_not_a_jump(every_ms: int) -> None:
    """Rates from 0 to 3 rad/s and back within 0.6 s, sampled at any phase of the turn."""
    for phase_ms in range(0, every_ms, 5):
        jumps = HeadingJumps()
        for t_ms in range(phase_ms, 2000, every_ms):
            share = min(max((t_ms - 600) / 600, 0.0), 1.0)
            yaw_rad = 0.9 * (share - math.sin(math.tau * share) / math.tau)
            jumps.take(at(t_ms, yaw_rad, 1.5 * (1.0 - math.cos(math.tau * share))))
        assert jumps.number == 0


@pytest.mark.parametrize(("rad_s", "number"), [(0.05, 0), (0.07, 3), (-0.05, 0), (-0.07, 3)])
def test_small_turns_that_the_rates_do_not_explain_add_up(rad_s: float, number: int) -> None:
    """10 degrees in 3 s begin a section. By which angle the heading is wrong is not known."""
    jumps = HeadingJumps()
    for t_ms in range(0, 9000, 20):
        jumps.take(at(t_ms, rad_s * t_ms / 1000.0))
    assert (jumps.number, jumps.turned_rad) == (number, 0.0)


@pytest.mark.parametrize(
    ("kind", "gap_ms", "sections"),
    [(AttitudeSample, 200, 1), (AttitudeSample, 400, 2), (PoseSample, 800, 1), (PoseSample, 1200, 2)],
)
def test_the_merged_world_begins_a_section_after_a_gap(
    kind: type[AttitudeSample] | type[PoseSample], gap_ms: int, sections: int
) -> None:
    """The estimate may have jumped in it by any angle or distance; what was seen free before may be an obstacle."""
    begin_ns, world, pipeline = START_NS + 500 * MS, World(), Pipeline((INFO,), EasyExtractor)
    for event in flight(20):
        if isinstance(event, kind) and 0 < event.t_ns - begin_ns < gap_ms * MS:
            continue
        for output in pipeline.handle(event):
            observation = observation_of(output) if isinstance(output, PrismsResult) else None
            if observation is not None:
                world.add(observation)
    assert world.section is not None
    assert world.section.number == sections


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


@pytest.mark.parametrize("position", [None, (0.0, 0.0, -2.0)])
def test_a_frame_from_before_a_gap_of_the_attitude_does_not_count(position: tuple[float, float, float] | None) -> None:
    """The heading may have jumped in it. Before, the space ahead was sent as clear by a heading 40 degrees wrong."""
    chain = Chain(model(free_to_m=13.0, view_deg=72.0))
    chain.position = position
    chain.fly(0.97)
    assert chain.ahead() == 1201
    chain.fly(0.03, attitudes=False)
    chain.now_ns += 240 * MS
    chain.yaw_rad = JUMP
    chain.fly(0.01)
    report = chain.report(PX4)
    assert "may have jumped" in report.blind["front"]
    assert report.values is not None
    assert set(report.values) <= {UNKNOWN}
    chain.fly(0.6)
    assert chain.report(PX4).blind == {}
    assert chain.ahead() == 1201


def test_the_heading_is_carried_forward_for_a_short_time_only() -> None:
    """A turn may change meanwhile. The newest frame is still young enough."""
    chain = Chain(model(free_to_m=13.0, view_deg=72.0))
    chain.fly(1.0)
    chain.fly(0.14, frames=False, attitudes=False)
    assert chain.ahead() == 1201
    chain.fly(0.02, frames=False, attitudes=False)
    report = chain.report(PX4)
    assert report.blind["front"] == "the attitude is lost"
    assert report.values is not None
    assert set(report.values) <= {UNKNOWN}


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
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3, observer=seen.append))
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


def test_the_way_to_an_obstacle_seen_before_a_gap_of_the_attitude_was_not_seen() -> None:
    """The direction that was seen may be another one."""
    memory, here = ObstacleMemory(AVOID), Here(0.3, (10.0, -5.0, -2.0), 1)
    memory.recall(scan([View(model(wall_at(20.0, 3.0), free_to_m=13.0, view_deg=72.0), HERE)], AVOID), [], here, NS)
    same = memory.recall(scan([], AVOID), [], here, NS + NS // 15)
    assert np.isfinite(same.way_seen_m[4])
    after = memory.recall(scan([], AVOID), [], replace(here, heading_section=1), NS + NS // 10)
    assert np.isfinite(after.distance_m[4])
    assert np.isinf(after.way_seen_m).all()


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


def two_cameras(yaw_rad: float, north_m: float, silent: range = range(0)) -> dict[str, PrismsResult]:
    """A frame of each camera; between them the heading or the position jumps. Its counter stays.

    silent: steps of 20 ms without an attitude, the frame of the second camera after them."""
    right = replace(INFO, camera="right")
    pipeline = Pipeline((INFO, right), EasyExtractor)
    found = {}
    right_k = max(8, silent.stop + 2)
    for k in range(right_k + 2):
        t_ns = START_NS + k * 20 * MS
        jumped = k >= 6
        q = quaternion_from_euler(0.0, 0.0, 0.2 + yaw_rad * jumped)
        if k not in silent:
            pipeline.handle(AttitudeSample(t_ns, t_ns, q, (0.0, 0.0, 0.0)))
        pipeline.handle(PoseSample(t_ns, t_ns, (north_m * jumped, 0.0, -3.0), (0.0, 0.0, 0.0)))
        camera = {5: "front", right_k: "right"}.get(k)
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


def test_a_camera_whose_frame_is_from_before_a_gap_of_the_attitude_is_blind() -> None:
    """By which angle the heading has jumped in it is not known: in no frame both results can be put together."""
    builder = AllCamerasModelBuilder(("front", "right"))
    for result in two_cameras(JUMP, 0.0, silent=range(6, 20)).values():
        builder.result(result)
    front, right = builder.model(lambda camera: "").parts
    assert isinstance(front, UnavailableCamera)
    assert front.cause_text == HEADING_LOST
    assert isinstance(right, PrismsResult)

"""Jumps of the position estimate, with and without a counter of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from companion.config.sync import SyncParams
from companion.live.world_thread import observation_of
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.position_sections import PositionSections
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import PoseAt, Synchroniser
from core.types import PoseSample
from core.world.world import World

from ..report_chain import AVOID, CLEAR, NS, PX4, Chain
from ..sector_models import model, wall_at
from ..small_recordings import INFO, START_NS, EasyExtractor, flight, frame

Vector = tuple[float, float, float]
MS = NS // 1000


def sample(t_ms: int, position: Vector, velocity: Vector | None = (0.0, 0.0, 0.0), counter: int = 0) -> PoseSample:
    return PoseSample(t_ms * MS, t_ms * MS, position, velocity, counter)


def numbers(*samples: PoseSample) -> list[int]:
    sections = PositionSections()
    out = []
    for one in samples:
        sections.take(one)
        out.append(sections.number)
    return out


@pytest.mark.parametrize("every_ms", [20, 250])
def test_a_flight_with_hard_turns_is_one_section(every_ms: int) -> None:
    at_s = np.arange(0.0, 20.0, every_ms / 1000.0)
    north = [(5.0 * np.sin(t), 3.0 * np.cos(1.3 * t), -2.0) for t in at_s]  # up to 5 m/s2
    speed = [(5.0 * np.cos(t), -3.9 * np.sin(1.3 * t), 0.0) for t in at_s]
    rng = np.random.default_rng(1)
    noisy = [tuple(p + rng.normal(0.0, 0.05, 3)) for p in north]
    flown = [sample(round(1000 * t), p, v) for t, p, v in zip(at_s, noisy, speed, strict=True)]
    assert set(numbers(*flown)) == {1}


@pytest.mark.parametrize("velocity", [(4.0, 0.0, 0.0), None])
@pytest.mark.parametrize("step", [(1.6, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 0.0, 2.0)])
def test_a_step_that_the_velocity_does_not_explain_begins_a_section(step: Vector, velocity: Vector | None) -> None:
    x, y, z = step
    after = sample(33, (0.13 + x, y, z), velocity)
    assert numbers(sample(0, (0.0, 0.0, 0.0), velocity), after) == [1, 2]
    assert numbers(sample(0, (0.0, 0.0, 0.0), velocity), sample(33, (0.13, 0.0, 0.0), velocity)) == [1, 1]


@pytest.mark.parametrize(
    ("velocity", "step_m", "sections"),
    [(4.0, 0.95, 1), (4.0, 1.05, 2), (4.0, -0.95, 1), (4.0, -1.05, 2), (None, 3.4, 1), (None, 3.6, 2), (None, -3.6, 2)],
)
def test_the_limit_of_a_step_grows_with_the_time_between_two_positions(
    velocity: float | None, step_m: float, sections: int
) -> None:
    """0.5 m, and in 0.1 s another 0.5 m, or 3 m without a velocity; long after the autopilot has started."""
    speed = None if velocity is None else (velocity, 0.0, 0.0)
    way_m = 0.0 if velocity is None else 0.1 * velocity
    before, after = (7.0, 0.0, 0.0), (7.0 + way_m + step_m, 0.0, 0.0)
    assert numbers(sample(60_000, before, speed), sample(60_100, after, speed)) == [1, sections]


def test_the_present_section_begins_at_its_first_position() -> None:
    sections = PositionSections()
    assert sections.begins_ns == 0
    for t_ms, north_m in ((60_000, 0.0), (60_100, 0.0), (60_200, 9.0), (60_300, 9.0)):
        sections.take(sample(t_ms, (north_m, 0.0, 0.0)))
    assert sections.begins_ns == 60_200 * MS


def test_a_counted_reset_begins_a_section_and_a_late_position_changes_nothing() -> None:
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(33, (0.0, 0.0, 0.0), counter=1)) == [1, 2]
    late = sample(10, (50.0, 0.0, 0.0))
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(33, (0.0, 0.0, 0.0)), late) == [1, 1, 1]


def test_after_a_gap_a_section_begins() -> None:
    assert numbers(sample(0, (0.0, 0.0, 0.0)), sample(1000, (0.1, 0.0, 0.0)), sample(2001, (0.1, 0.0, 0.0))) == [
        1,
        1,
        2,
    ]


def jumping_chain() -> tuple[Chain, list[Surroundings]]:
    """A hover, then a step of the position by 5 m with the same counter."""
    seen: list[Surroundings] = []
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3, observer=seen.append))
    chain.builder.announce(chain.pipeline.cameras[0])
    chain.position = (0.0, 0.0, -2.0)
    for _ in range(20):
        chain.fly(0.05)
        chain.report(PX4)
    return chain, seen


def recalled(surroundings: Surroundings) -> bool:
    """Whether a place above the image counts as seen free before."""
    assert surroundings.recall is not None
    return bool(surroundings.recall(np.array([2.6]), np.array([0.0]), np.array([-1.6]))[0])


def test_free_space_that_was_remembered_before_a_jump_does_not_count_after_it() -> None:
    chain, seen = jumping_chain()
    assert recalled(seen[-1])
    chain.position = (2.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert not recalled(seen[-1])


def test_a_frame_from_before_a_jump_stays_where_it_was_seen() -> None:
    chain, seen = jumping_chain()
    chain.sees.found = model((8.0, -6.0, 8.0, 6.0, -2.0, 2.0), free_to_m=7.5, view_deg=72.0)
    chain.fly(0.1)
    chain.report(PX4)
    before_m = seen[-1].views[0].model.planes[0, 0]
    chain.position = (-5.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert seen[-1].views[0].model.planes[0, 0] == pytest.approx(before_m, abs=0.3)


def test_a_frame_from_before_a_jump_adds_no_remembered_free_space() -> None:
    """It is not known where the vehicle was at the exposure, in the positions after the jump."""
    chain, seen = jumping_chain()
    chain.fly(0.1)  # a frame that no decision has used yet
    chain.position = (2.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert not recalled(seen[-1])


@pytest.mark.parametrize("every_ms", [33, 250])
def test_small_steps_that_add_up_begin_a_section(every_ms: int) -> None:
    """Each of them is below the limit. Together they displace what was remembered by metres."""
    flown = [sample(k * every_ms, (0.4 * k, 0.0, 0.0)) for k in range(12)]
    assert numbers(*flown)[-1] > 1
    back_and_forth = [sample(k * every_ms, (0.2 * (k % 2), 0.0, 0.0)) for k in range(40)]
    assert set(numbers(*back_and_forth)) == {1}


def test_slow_drift_of_the_estimate_is_no_jump() -> None:
    """0.1 m/s that the velocity does not show."""
    assert set(numbers(*(sample(33 * k, (0.0033 * k, 0.0, 0.0)) for k in range(3000)))) == {1}


def test_the_section_of_a_position_is_told_by_its_stamp() -> None:
    sections = PositionSections()
    for one in (sample(0, (0.0, 0.0, 0.0)), sample(33, (0.0, 0.0, 0.0)), sample(66, (9.0, 0.0, 0.0))):
        sections.take(one)
    assert [sections.at(t_ms * MS).number for t_ms in (0, 65, 66, 90)] == [1, 1, 2, 2]
    assert [sections.at(t_ms * MS).jump_ns for t_ms in (0, 66)] == [0, 66 * MS]


def test_a_restart_of_the_stamps_begins_a_section() -> None:
    assert numbers(sample(5000, (0.0, 0.0, 0.0)), sample(100, (0.0, 0.0, 0.0)), sample(133, (0.0, 0.0, 0.0))) == [
        1,
        2,
        2,
    ]


def test_no_position_is_interpolated_across_a_jump_that_nothing_counts() -> None:
    sync = Synchroniser(SyncParams())
    for one in (sample(0, (0.0, 0.0, 0.0)), sample(40, (4.0, 0.0, 0.0))):
        sync.add(one)
    found = [sync.pose_at(t_ms * MS) for t_ms in (10, 30)]
    assert [p.position_ned_m[0] for p in found if isinstance(p, PoseAt)] == [0.0, 4.0]
    assert [p.section.number for p in found if isinstance(p, PoseAt)] == [1, 2]


def test_a_frame_stamped_after_its_arrival_is_not_placed_by_a_jump_it_did_not_know() -> None:
    """Its pose is of before the jump, its stamp of after it."""
    chain, seen = jumping_chain()
    chain.sees.found = model((8.0, -6.0, 8.0, 6.0, -2.0, 2.0), free_to_m=7.5, view_deg=72.0)
    chain.fly(0.09, frames=False)
    ahead_ns = 40 * 1_000_000
    for output in chain.pipeline.handle(frame(chain.sequence + 1, chain.now_ns + ahead_ns, chain.now_ns)):
        if isinstance(output, PrismsResult):
            chain.builder.result(output)
    chain.position = (-5.0, 0.0, -2.0)
    chain.fly(0.02, frames=False)
    chain.report(PX4)
    assert seen[-1].views[0].model.planes[0, 0] == pytest.approx(8.0, abs=0.3)


def test_small_steps_are_told_from_a_jump() -> None:
    sections = PositionSections()
    for k in range(12):
        sections.take(sample(33 * k, (0.4 * k, 0.0, 0.0)))
    sections.take(sample(3000, (4.4, 0.0, 0.0)))
    assert sections.number > 2
    assert sections.at(3000 * MS).jump_ns == 3000 * MS, "it may have jumped in the gap"
    sections.take(sample(3033, (9.4, 0.0, 0.0)))
    assert sections.at(3033 * MS).jump_ns == 3033 * MS


def test_a_section_that_small_steps_begin_keeps_the_jump_before_it() -> None:
    sections = PositionSections()
    sections.take(sample(0, (-9.0, 0.0, 0.0)))
    for k in range(1, 12):
        sections.take(sample(33 * k, (0.4 * k, 0.0, 0.0)))
    newest = sections.at(33 * 11 * MS)
    assert newest.number > 2
    assert newest.jump_ns == 33 * MS


@pytest.mark.parametrize(("gap_ms", "step_m"), [(900, -4.0), (500, -2.8), (200, -1.4)])
def test_the_merged_world_begins_a_section_after_a_jump_that_a_gap_hides(gap_ms: int, step_m: float) -> None:
    """The step is within the limit for the time of the gap; the position after it shows that the vehicle stands."""
    world, pipeline, end_ns = World(), Pipeline((INFO,), EasyExtractor), START_NS + 1000 * MS
    for event in flight(30):
        if isinstance(event, PoseSample):
            if 0 <= event.t_ns - end_ns < gap_ms * MS:
                continue
            north_m = 0.0 if event.t_ns < end_ns else step_m
            event = replace(event, position_ned_m=(north_m, 0.0, -2.0), velocity_ned_m_s=(0.0, 0.0, 0.0))
        for output in pipeline.handle(event):
            observation = observation_of(output) if isinstance(output, PrismsResult) else None
            if observation is not None:
                world.add(observation)
    assert world.section is not None
    assert world.section.number >= 2


@pytest.mark.parametrize(("north_m", "yaw_rad"), [(0.0, 0.0), (2.0, 0.0), (0.0, 0.7)])
def test_the_merged_world_begins_a_section_where_the_estimate_jumps(north_m: float, yaw_rad: float) -> None:
    """A step of 2 m is within what its own rule allows for the time between two frames."""
    chain = Chain(model(wall_at(0.0, 8.0, 4.0), free_to_m=7.5, view_deg=72.0))
    world, chain.position = World(), (0.0, 0.0, -2.0)

    class IntoWorld(ObstacleReportBuilder):
        def result(self, result: PrismsResult) -> None:
            observation = observation_of(result)
            assert observation is not None
            world.add(observation)

    chain.builder = IntoWorld(AVOID, CameraUse(cameras=("front",), timeout_s=0.3))
    chain.fly(0.5)
    chain.position, chain.yaw_rad = (north_m, 0.0, -2.0), yaw_rad
    chain.fly(0.5)
    assert world.section is not None
    assert world.section.number == (1 if north_m == yaw_rad == 0.0 else 2)

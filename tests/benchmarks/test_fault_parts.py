"""Parts of the random flights with faults: the line, the cameras, the field, and what the judge notices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.faults.field import random_field
from benchmarks.faults.images import OTHER_HZ, ImageSource, cameras_of
from benchmarks.faults.judge import Judge
from benchmarks.faults.line import LINE_NS, AutopilotLine
from benchmarks.faults.loop import FaultLoop
from benchmarks.faults.path import PathClaim, true_room_m
from benchmarks.faults.service import Service
from benchmarks.faults.switches import MS, NS, Fault, Switches, switches_at
from companion.config.avoidance import AvoidParams
from companion.pipeline.results import PrismsResult
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import PX4

AVOID = AvoidParams(send=True, rays=2, slices=6, step_m=0.5)


def line_with(s: Switches, count: int = 40, hz: float = 100.0) -> list[int]:
    """Arrivals of attitudes, in ms."""
    line = AutopilotLine(np.random.default_rng(0))
    packer = dialect.MAVLink(None, 1, 1)
    for k in range(count):
        message = dialect.MAVLink_attitude_message(k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        line.send(bytes(message.pack(packer)), s, round(k / hz * NS))
    return [item.arrival_ns // MS for item in line.take(1000 * NS)]


def test_a_line_without_a_fault_delays_only() -> None:
    assert line_with(Switches()) == [10 * k + LINE_NS // MS for k in range(40)]


def test_copies_arrive_later() -> None:
    arrivals = line_with(Switches(copied_share=1.0, copy_delay_ns=NS))
    assert arrivals == [10 * k + 3 for k in range(40)] + [1000 + 10 * k + 3 for k in range(40)]


def test_a_part_of_the_messages_takes_the_slower_route() -> None:
    arrivals = line_with(Switches(route_delay_ns=NS))
    assert len(arrivals) == 40
    assert 10 < sum(at > 1000 for at in arrivals) < 30


def test_bursts_arrive_together() -> None:
    assert set(line_with(Switches(burst_ns=100 * MS))) == {100, 200, 300, 400}


def test_attitudes_keep_their_least_time_between() -> None:
    assert line_with(Switches(attitude_gap_ns=95 * MS)) == [3, 103, 203, 303]


def test_a_fault_of_one_camera_leaves_the_other_one() -> None:
    faults = [Fault("a", 0, NS, {"covered": 1.0}, camera=0), Fault("b", 0, NS, {"repeats": 1}, camera=1)]
    first, second = (switches_at(faults, 0, number) for number in range(2))
    assert (first.covered, first.repeats) == (1.0, 0)
    assert (second.covered, second.repeats) == (0.0, 1)


def test_the_second_camera_has_its_own_rate() -> None:
    sources = [ImageSource(1, seed) for seed in range(12)]
    assert {s.period_ns for s in sources} == {round(NS / hz) for hz in OTHER_HZ}
    assert ImageSource(0, 3).next_ns == 0 != sources[3].next_ns


def test_few_pixels_are_measured() -> None:
    field, (info,) = random_field(4, 20.0), cameras_of(4)
    whole, few = (
        ImageSource(0, 4).expose(info, field.scene, field.path.at(0.0), Switches(unmeasured_share=share))
        for share in (0.0, 0.9)
    )
    assert whole is not None
    assert few is not None
    assert np.count_nonzero(few.depth_mm) == pytest.approx(0.1 * np.count_nonzero(whole.depth_mm), rel=0.1)


def test_the_mover_stands_where_its_outline_is() -> None:
    field = random_field(5, 20.0)
    assert field.mover is not None
    for t_s in (0.0, 7.0, 7.0 + field.mover.period_s):
        middle_m = field.outline_at(t_s)[-len(field.mover.outline_m) :].mean(axis=0)
        corners_m = field.scene_at(t_s).corners[-1]
        assert corners_m[:, :2].mean(axis=0) == pytest.approx(middle_m, abs=0.02)
    assert not np.allclose(field.outline_at(0.0), field.outline_at(7.0))


def test_a_path_ends_at_the_first_point_in_it() -> None:
    state = random_field(4, 20.0).path.at(0.0)
    outline_m = np.array([[5.0, 0.2], [3.0, 0.5], [0.1, 4.0], [-2.0, 0.0]])
    rooms_m = [true_room_m(outline_m, state, angle, 0.4) for angle in (0.0, math.pi / 2, math.pi, -math.pi / 2)]
    assert rooms_m == pytest.approx([5.0, 4.0, 2.0, math.inf], abs=0.05)
    assert true_room_m(outline_m, state, 0.0, 0.6) == pytest.approx(3.0, abs=0.05)


def loop_and_judge(seed: int) -> tuple[FaultLoop, Judge]:
    judge = Judge([], PX4)
    return FaultLoop(random_field(seed, 20.0), PX4, seed, [], judge.sent, AVOID), judge


@pytest.mark.parametrize(("room_m", "wrong"), [(2.0, False), (30.0, True)])
def test_the_judge_notices_a_path_that_is_free_beyond_a_solid(
    room_m: float, wrong: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, judge = loop_and_judge(4)
    loop.flown_ns = NS
    monkeypatch.setattr(Service, "claim", PathClaim(0.3, room_m))
    judge.sent(loop, [65535] * 72)
    assert any("the path is free" in v.what for v in judge.violations) is wrong


def published(seed: int, flown_s: float) -> tuple[FaultLoop, Judge, PrismsResult]:
    """The newest result of a flight, which is judged no further."""
    loop, judge = loop_and_judge(seed)
    results: list[PrismsResult] = []
    loop.on_published = lambda _, result: results.append(result)
    loop.fly(flown_s)
    return loop, judge, results[-1]


def test_the_judge_notices_free_space_behind_a_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, judge, result = published(4, 3.0)
    judge.published(loop, result)
    assert judge.planner == 1
    assert judge.violations == []
    monkeypatch.setattr("benchmarks.faults.judge.RANGE_M", -3.0)  # places in front of the surfaces
    judge.published(loop, result)
    assert ["are free to a planner" in v.what for v in judge.violations] == [True]


def test_the_judge_notices_a_frame_with_a_wrong_heading() -> None:
    loop, judge, result = published(4, 3.0)
    assert result.transform is not None
    assert result.model is not None
    from core.transformed import turned

    wrong = replace(result, model=turned(result.model, 0.6, (0.0, 0.0, 0.0)))
    judge.published(loop, wrong)
    assert len(judge.violations) == 1


@pytest.mark.parametrize("height", [96, 120])
def test_an_image_of_another_size_differs_from_each_drawn_camera(height: int) -> None:
    """It was cut to 100 rows: an image of 96 rows stayed as it was."""
    field = random_field(1, 5.0)
    camera = replace(cameras_of(1)[0], intrinsics=replace(cameras_of(1)[0].intrinsics, height=height))
    image = ImageSource(0, 1).expose(camera, field.scene, field.path.at(0.0), Switches(other_size=True))
    assert image is not None
    assert image.depth_mm.shape[0] < height

"""What a report of obstacles counts: results, models and cameras that cannot be used, moved obstacles."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN, obstacle_distance_message
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import MOST_WAITING, ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.types import AttitudeSample, CameraMount, PoseSample
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader

from ..report_chain import ARDUPILOT, AVOID, CAMERA, CLEAR, NS, PX4, WALL, Chain, Sees
from ..sector_models import model, wall_at
from ..small_recordings import MS, frame


def test_obstacles_are_moved_by_position_and_turn_to_the_moment_of_sending() -> None:
    """Exposed at a position 8 m from the wall; 0.2 s later, at 5 m/s, it is 1 m nearer, and turned by 20 degrees."""
    chain = Chain(model(wall_at(0.0, 8.0), free_to_m=13.0, view_deg=72.0))
    chain.position, chain.speed = (3.0, 4.0, -2.0), (5.0, 0.0, 0.0)
    chain.fly(1.0)
    exposed = chain.position
    assert chain.ahead() == 770
    chain.turn_rad_s = math.radians(20.0) / 0.2
    chain.fly(0.2, frames=False)
    assert chain.position is not None
    assert chain.position[0] - exposed[0] == pytest.approx(1.0)
    values = chain.report().values
    assert values is not None
    obstacles = np.flatnonzero(values < 1200)
    assert values[68] == pytest.approx(670, abs=2)
    assert set(obstacles) <= {66, 67, 68, 69, 70}


def test_without_a_position_the_turn_alone_is_taken_into_account() -> None:
    chain = Chain(model(wall_at(0.0, 8.0), free_to_m=13.0, view_deg=72.0))
    chain.fly(1.0)
    chain.turn_rad_s = math.radians(-30.0) / 0.2
    chain.fly(0.2, frames=False)
    values = chain.report().values
    assert values is not None
    assert values[6] == pytest.approx(770, abs=2)
    assert values[0] >= 1200


def test_a_camera_that_was_never_described_may_look_anywhere() -> None:
    builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3))
    values = builder.decide(ARDUPILOT, NS).values
    assert values is not None
    assert (values == WALL).all()


def test_beside_a_camera_that_sees_one_that_was_never_described_may_look_anywhere() -> None:
    """ArduPilot takes unknown for clear, and would fly where that camera should look."""
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", "rear"), timeout_s=0.3))
    chain.builder.announce(CAMERA)
    chain.fly(1.0)
    values = chain.report(ARDUPILOT).values
    assert values is not None
    assert sorted(values[0:7]) == [1199] + 6 * [1201]  # the farthest distance, in an empty face between two walls
    assert (values[9:63] == WALL).all()


def test_the_surroundings_are_as_old_as_the_oldest_frame_that_counts() -> None:
    shown: list[Surroundings] = []
    rear = replace(CAMERA, camera="rear", mount=CameraMount(yaw_rad=math.pi))
    pipeline = Pipeline((CAMERA, rear), lambda info: Sees(CLEAR))
    builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", "rear"), timeout_s=0.3, observer=shown.append))
    builder.announce(CAMERA)
    builder.announce(rear)
    for number in range(1, 6):
        now_ns = 10 * NS + number * NS // 10
        samples: list[AttitudeSample | PoseSample] = [
            AttitudeSample(t_ns, t_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) for t_ns in (now_ns - 50 * MS, now_ns)
        ]
        builder.samples(samples)
        for sample in samples:
            pipeline.handle(sample)
        for image in (frame(number, now_ns, now_ns), frame(number, now_ns - 40 * MS, now_ns, "rear")):
            for output in pipeline.handle(image):
                if isinstance(output, PrismsResult):
                    builder.result(output)
        builder.decide(PX4, now_ns)
    assert dict(shown[-1].frames) == {"front": now_ns, "rear": now_ns - 40 * MS}
    assert shown[-1].exposed_ns == now_ns - 40 * MS


def test_frames_of_a_camera_that_was_never_described_make_nothing_clear() -> None:
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3))
    chain.fly(1.0)
    assert chain.ahead(PX4) == UNKNOWN
    assert chain.ahead(ARDUPILOT) == WALL
    assert "intrinsics and mount are unknown" in chain.report().blind["front"]


@pytest.mark.parametrize("blind", ["stop", "unknown", "auto"])
@pytest.mark.parametrize(
    "policy_and_autopilot", [("PX4", Px4Reader), ("autopilot 0", Px4Reader), ("ArduPilot", ArduPilotReader)]
)
def test_what_a_reader_needs_goes_by_the_reader_and_not_by_the_policy(
    blind: str, policy_and_autopilot: tuple[str, type]
) -> None:
    """A pole in an odd sector, and one on the other side of the nose: old PX4 and old ArduPilot must not lose them."""
    kind, reader = policy_and_autopilot
    poles = model(wall_at(5.0, 3.0, 0.02), wall_at(350.0, 8.0, 0.02), free_to_m=13.0, view_deg=72.0)
    chain = Chain(poles, replace(AVOID, blind=blind))
    chain.fly(1.0)
    report = chain.report(AutopilotNow(kind=kind))
    assert report.values is not None
    message = obstacle_distance_message(report.values, 0, AVOID)
    if reader is Px4Reader:
        old = Px4Reader(10)
        old.read(message, NS)
        assert min(old.bins_cm(NS)[:2]) < 300
    else:
        older = ArduPilotReader(one_pass=True)
        older.read(message, NS)
        assert older.faces_m(NS)[0] < 3.0


@pytest.mark.parametrize(
    ("kind", "filled"),
    [("ArduPilot", 1199), ("ArduPilot or PX4", WALL + 1), ("autopilot 8", WALL + 1), ("PX4", UNKNOWN)],
)
def test_an_empty_face_between_two_obstacles_is_filled_in_the_report(kind: str, filled: int) -> None:
    """By the wall of the policy, rounded away from the vehicle, where the kind is not certain: not only in `for_reader`."""
    found = model(wall_at(30.0, 4.0), wall_at(330.0, 10.0), view_deg=72.0)
    chain = Chain(found, replace(AVOID, unseen="unknown"))
    chain.fly(1.0)
    values = chain.report(AutopilotNow(kind=kind, margin_m=3.0)).values
    assert values is not None
    front = [*values[68:], *values[:5]]
    assert min(front) == filled
    assert front.count(UNKNOWN) == len(front) - (filled != UNKNOWN)


@pytest.mark.parametrize("place", [0, 3, "margin"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_planes_that_are_no_numbers_hide_nothing(place: int | str, value: float) -> None:
    """One such plane must not take the others with it, nor leave the view clear; wherever it comes from."""
    found = model(wall_at(0.0, 5.0), wall_at(10.0, 6.0), free_to_m=13.0, view_deg=72.0)
    if place == "margin":
        found = replace(found, margin_m=np.array([0.0, value], np.float32))
    else:
        planes = found.planes.copy()
        planes[1, place] = value
        found = replace(found, planes=planes)
    chain = Chain(CLEAR)
    chain.fly(1.0)
    good = chain.newest()
    chain.builder.result(replace(good, model=found))  # none of ours, which the pipeline refuses
    assert chain.ahead(PX4) == UNKNOWN
    assert "not finite" in chain.report().blind["front"]
    chain.builder.result(good)
    chain.sees.found = found
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chain.fly(0.2)
        assert chain.ahead(PX4) == UNKNOWN
    assert chain.ahead(ARDUPILOT) == WALL
    assert "not finite" in chain.report().blind["front"]
    result = chain.newest()
    assert not result.valid
    assert result.model is not None
    assert not (result.model.free.free_to_m > 0.0).any()


def test_a_frame_stamped_in_the_future_ages_from_its_arrival() -> None:
    chain = Chain(CLEAR)
    chain.fly(1.0)
    pipeline_result = chain.newest()
    for k in range(3):
        late = chain.now_ns + 100 * MS * k
        chain.builder.result(replace(pipeline_result, t_exposure_ns=late + 3600 * NS, t_arrival_ns=late))
    chain.fly(0.6, frames=False)
    assert chain.ahead(PX4) == UNKNOWN
    assert chain.ahead(ARDUPILOT) == WALL
    chain.fly(2.0, frames=False)
    assert chain.report(PX4).values is None


def test_a_model_that_cannot_be_reckoned_with_is_blindness_and_not_the_end() -> None:
    """Every fault is sent to both autopilots as blind, and valid frames end it."""
    chain = Chain(CLEAR)
    chain.fly(1.0)
    chain.builder.result(replace(chain.newest(), transform=None))
    report = chain.report(PX4)
    assert "cannot be computed" in report.fault
    assert report.values is not None
    assert (report.values == UNKNOWN).all()
    assert chain.ahead(ARDUPILOT) == WALL
    chain.fly(0.1)
    assert chain.ahead(ARDUPILOT) == WALL
    chain.fly(0.4)
    assert chain.ahead(ARDUPILOT) == 1201
    assert not chain.report().fault


def test_a_blind_camera_fills_only_what_it_alone_covers() -> None:
    right = replace(CAMERA, camera="right", mount=CameraMount(yaw_rad=math.radians(60.0)))
    builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", "right"), timeout_s=0.3))
    chain = Chain(CLEAR)
    chain.builder = builder
    builder.announce(CAMERA)
    builder.announce(right)
    chain.fly(1.0)
    values = chain.report(ARDUPILOT).values
    assert values is not None
    assert (values[0:7] == 1201).all()
    assert (values[9:19] == WALL).all()
    assert (values[22:60] == UNKNOWN).all()


def test_results_that_nothing_takes_do_not_pile_up_and_no_camera_is_lost() -> None:
    chain = Chain(CLEAR)
    chain.fly(1.0)
    good = chain.newest()
    for _ in range(MOST_WAITING + 10):
        chain.builder.result(good)
    assert len(chain.builder._waiting) == MOST_WAITING
    chain.builder.announce(CAMERA)
    assert len(chain.builder._waiting) == MOST_WAITING + 1
    chain.builder.catch_up()
    assert len(chain.builder._waiting) == 0

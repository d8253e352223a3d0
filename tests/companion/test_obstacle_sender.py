"""The output when a link of the chain fails: blind by 0.4 s after the newest exposure, whichever part detects the
fault."""

from __future__ import annotations

import math
import threading
import time
import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.autopilot import sender as sender_module
from companion.autopilot.confirmation import PlaneConfirmation
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN, obstacle_distance_message
from companion.autopilot.obstacle_report import ObstacleReport, SeenCameras
from companion.autopilot.report_builder import MOST_WAITING, ObstacleReportBuilder
from companion.autopilot.sender import ObstacleSender
from companion.autopilot.surroundings import Surroundings
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, CameraMount, ExtractorState, FrameModel, Intrinsics, PoseSample
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.px4 import Px4Reader
from tests.waiting import until

from .made_up import MS, frame
from .sector_models import model, wall_at

NS = 1_000_000_000
CAMERA = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5), CameraMount())
AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, recover_frames=3, avoid_margin_m=2.0)
PX4, ARDUPILOT = AutopilotNow(kind="PX4"), AutopilotNow(kind="ArduPilot", margin_m=3.0)
WALL = 320
"""Its fence comes to AVOID_MARGIN less 4 cm; cm."""


class Sees:
    """An extractor that returns given models."""

    def __init__(self, found: FrameModel) -> None:
        self.found = found

    def extract(
        self,
        depth: np.ndarray,
        info: CameraInfo,
        R_level_optical: np.ndarray,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        return self.found, state or ExtractorState()


class Chain:
    """Frames at 10 Hz and attitudes at 100 Hz through the pipeline to a builder, in time that the test makes."""

    def __init__(self, found: FrameModel, avoid: AvoidParams = AVOID) -> None:
        self.sees = Sees(found)
        self.pipeline = Pipeline((CAMERA,), lambda info: self.sees)
        self.builder = ObstacleReportBuilder(avoid, SeenCameras(cameras=("front",), timeout_s=0.3))
        self.builder.announce(CAMERA)
        self.now_ns, self.sequence, self.yaw_rad = 10 * NS, 0, 0.0
        self.position: tuple[float, float, float] | None = None
        self.speed, self.turn_rad_s = (0.0, 0.0, 0.0), 0.0

    def fly(self, seconds: float, frames: bool = True, attitudes: bool = True, deliver: bool = True) -> None:
        for _ in range(round(100 * seconds)):
            self.now_ns += 10 * MS
            if attitudes:
                self.yaw_rad += 0.01 * self.turn_rad_s
                q = quaternion_from_euler(0.0, 0.0, self.yaw_rad)
                samples: list[AttitudeSample | PoseSample] = [
                    AttitudeSample(self.now_ns, self.now_ns, q, (0.0, 0.0, self.turn_rad_s))
                ]
                if self.position is not None:
                    x, y, z = self.position
                    self.position = (x + 0.01 * self.speed[0], y + 0.01 * self.speed[1], z)
                    samples.append(PoseSample(self.now_ns, self.now_ns, self.position, self.speed, 1))
                for sample in samples:
                    self.pipeline.handle(sample)
                self.builder.samples(samples)
            if frames and self.now_ns // (10 * MS) % 10 == 0:
                self.expose(deliver=deliver)

    def expose(self, late_ns: int = 0, deliver: bool = True) -> None:
        """A frame arrives, exposed late_ns before. deliver: its result reaches the builder."""
        for result in self.results(late_ns):
            if deliver:
                self.builder.result(result)

    def results(self, late_ns: int = 0) -> list[PrismsResult]:
        """The results of a frame that arrives, exposed late_ns before."""
        self.sequence += 1
        outputs = self.pipeline.handle(frame(self.sequence, self.now_ns - late_ns, self.now_ns))
        return [output for output in outputs if isinstance(output, PrismsResult)]

    def newest(self) -> PrismsResult:
        """The newest result that has arrived."""
        self.builder.catch_up()
        return self.builder._newest["front"]

    def report(self, autopilot: AutopilotNow = PX4) -> ObstacleReport:
        return self.builder.decide(autopilot, self.now_ns)

    def ahead(self, autopilot: AutopilotNow = PX4) -> int | None:
        values = self.report(autopilot).values
        return None if values is None else int(values[0])


CLEAR = model(free_to_m=13.0, view_deg=72.0)


def test_it_sees_after_good_frames_in_a_row() -> None:
    chain = Chain(CLEAR)
    assert chain.ahead() == UNKNOWN
    chain.fly(0.2)
    assert chain.ahead() == UNKNOWN
    assert "too few valid frames" in chain.report().blind["front"]
    chain.fly(0.2)
    assert chain.ahead() == 1201
    assert chain.report().blind == {}


def broken(chain: Chain, fault: str, seconds: float) -> None:
    if fault == "no frames":
        chain.fly(seconds, frames=False)
    elif fault == "results are lost":
        chain.fly(seconds, deliver=False)
    elif fault == "no attitude":
        chain.fly(seconds, attitudes=False)
    elif fault == "everything stands still":
        chain.now_ns += round(seconds * NS)
    else:
        chain.sees.found = replace(CLEAR, valid=False)
        chain.fly(seconds)


FAULTS = ["no frames", "results are lost", "no attitude", "everything stands still", "invalid frames"]


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("found", [CLEAR, model(wall_at(0.0, 8.0, 12.0), free_to_m=7.5, view_deg=72.0)])
def test_a_blind_camera_is_sent_as_unknown_within_0_4_s_to_both_autopilots(fault: str, found: FrameModel) -> None:
    chain = Chain(found)
    chain.fly(1.0)
    assert chain.ahead() not in (UNKNOWN, None)
    broken(chain, fault, 0.4)
    assert chain.ahead(PX4) == UNKNOWN
    assert chain.ahead(ARDUPILOT) == WALL
    assert chain.report().blind["front"]
    broken(chain, fault, 1.9)
    assert chain.report(PX4).values is None
    assert chain.ahead(ARDUPILOT) == WALL
    broken(chain, fault, 600.0 if fault == "everything stands still" else 5.0)
    assert chain.report(PX4).values is None
    assert chain.ahead(ARDUPILOT) == WALL


def test_the_time_of_the_wall_counts_from_the_exposure_and_not_from_the_arrival() -> None:
    """Of frames that arrive 0.2 s after their exposure the wall for PX4 stood 0.2 s longer, before the silence that makes it hold."""
    chain = Chain(CLEAR)
    chain.fly(0.3, frames=False)
    for _ in range(4):
        chain.fly(0.1, frames=False)
        chain.expose(late_ns=200 * MS)
    px4 = replace(PX4, cp_dist_m=3.0)
    assert chain.ahead(px4) == 1201
    chain.fly(1.78, frames=False)
    chain.report(px4)
    assert chain.ahead(px4) == 302
    chain.fly(0.04, frames=False)
    assert chain.report(px4).values is None


def test_a_frozen_camera_is_blind_as_soon_as_it_is_known_to_be_though_its_stamps_are_new() -> None:
    chain = Chain(CLEAR)
    frozen = {"front": ""}
    chain.builder = ObstacleReportBuilder(
        AVOID, SeenCameras(cameras=("front",), timeout_s=0.3, frame_fault=lambda camera: frozen[camera])
    )
    chain.builder.announce(CAMERA)
    chain.fly(1.0)
    assert chain.ahead(PX4) == 1201
    frozen["front"] = "frozen: the same image 5 times in a row"
    assert chain.ahead(PX4) == UNKNOWN  # at this very instant
    assert chain.ahead(ARDUPILOT) == WALL
    assert chain.report().blind["front"].startswith("frozen")
    frozen["front"] = ""
    assert chain.ahead(PX4) == UNKNOWN  # not before some good frames
    chain.fly(0.5)
    assert chain.ahead(PX4) == 1201


def test_the_last_message_before_a_stop_is_blind() -> None:
    """Stopped within a cycle of the thread, the message before would otherwise be the last."""
    chain = Chain(CLEAR)
    chain.now_ns = time.monotonic_ns() - NS
    posted: list[Any] = []
    sender = ObstacleSender(chain.builder, AVOID, lambda: PX4, posted.append)
    chain.fly(1.0)
    sender.open()
    assert until(lambda: posted)
    chain.builder.end("the service stops")
    sender.close()
    assert set(posted[-1].distances) == {UNKNOWN}
    assert not sender.running


def test_what_was_decided_before_a_pause_of_the_process_is_decided_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stopped process, or a computer without processor time, continues after the decision with distances of before."""
    chain = Chain(CLEAR)
    chain.fly(1.0)
    decide, pauses, now_ns = chain.builder.decide, [600 * MS], [chain.now_ns]
    monkeypatch.setattr(sender_module, "time", SimpleNamespace(monotonic_ns=lambda: now_ns[0]))

    def slow(autopilot: AutopilotNow, t_ns: int) -> ObstacleReport:
        report = decide(autopilot, t_ns)
        now_ns[0] += pauses.pop() if pauses else 10 * MS
        return report

    monkeypatch.setattr(chain.builder, "decide", slow)
    posted: list[Any] = []
    sender = ObstacleSender(chain.builder, AVOID, lambda: PX4, posted.append)
    sender._send(now_ns[0])
    assert [set(message.distances) for message in posted] == [{UNKNOWN}]
    assert posted[0].time_usec == now_ns[0] // 1000 - 10_000


def test_what_was_seen_before_a_suspension_of_the_computer_is_not_sent_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """CLOCK_MONOTONIC stands still meanwhile, so that old frames count as new."""
    clock, suspended_ns = time.clock_gettime_ns, [0]
    chain = Chain(CLEAR)
    chain.fly(1.0)
    monkeypatch.setattr(
        time,
        "clock_gettime_ns",
        lambda which: clock(which) + (suspended_ns[0] if which == time.CLOCK_BOOTTIME else 0),
    )
    monkeypatch.setattr(sender_module, "time", SimpleNamespace(monotonic_ns=lambda: chain.now_ns))
    posted: list[Any] = []
    sender = ObstacleSender(chain.builder, AVOID, lambda: PX4, posted.append)
    sender._send(chain.now_ns)
    assert posted[-1].distances[0] == 1201
    decide = chain.builder.decide

    def suspended_meanwhile(autopilot: AutopilotNow, t_ns: int) -> ObstacleReport:
        report = decide(autopilot, t_ns)
        suspended_ns[0] = 20 * MS
        return report

    monkeypatch.setattr(chain.builder, "decide", suspended_meanwhile)
    for _ in range(2):
        sender._send(chain.now_ns)
        assert set(posted[-1].distances) == {UNKNOWN}
        assert sender.report is not None
        assert "the computer was suspended" in sender.report.blind["front"]


@pytest.mark.parametrize("fault", FAULTS)
def test_it_comes_back_with_good_frames(fault: str) -> None:
    chain = Chain(CLEAR)
    chain.fly(1.0)
    broken(chain, fault, 3.0)
    assert chain.report(PX4).values is None
    chain.sees.found = CLEAR
    chain.fly(0.2)
    assert chain.ahead(ARDUPILOT) == WALL
    chain.fly(0.3)
    assert chain.ahead(PX4) == 1201
    assert chain.ahead(ARDUPILOT) == 1201


def test_a_near_obstacle_stays_while_it_is_blind_and_the_wall_is_farther() -> None:
    chain = Chain(model(wall_at(0.0, 2.0), free_to_m=1.6, view_deg=72.0))
    chain.fly(1.0)
    assert chain.ahead(ARDUPILOT) == 170
    chain.fly(1.0, frames=False)
    assert chain.ahead(ARDUPILOT) == 170
    assert chain.ahead(PX4) == 170
    chain.fly(3.0, frames=False)
    assert chain.ahead(ARDUPILOT) == WALL


def test_an_autopilot_whose_margin_is_unknown_gets_the_configured_wall() -> None:
    chain = Chain(CLEAR)
    assert chain.ahead(AutopilotNow(kind="ArduPilot")) == 212
    assert chain.ahead(AutopilotNow(kind="autopilot 99")) == 212


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
    builder = ObstacleReportBuilder(AVOID, SeenCameras(cameras=("front",), timeout_s=0.3))
    values = builder.decide(ARDUPILOT, NS).values
    assert values is not None
    assert (values == WALL).all()


def test_beside_a_camera_that_sees_one_that_was_never_described_may_look_anywhere() -> None:
    """ArduPilot takes unknown for clear, and would fly where that camera should look."""
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, SeenCameras(cameras=("front", "rear"), timeout_s=0.3))
    chain.builder.announce(CAMERA)
    chain.fly(1.0)
    values = chain.report(ARDUPILOT).values
    assert values is not None
    assert (values[0:7] == 1201).all()
    assert (values[9:63] == WALL).all()


def test_the_surroundings_are_as_old_as_the_oldest_frame_that_counts() -> None:
    shown: list[Surroundings] = []
    rear = replace(CAMERA, camera="rear", mount=CameraMount(yaw_rad=math.pi))
    pipeline = Pipeline((CAMERA, rear), lambda info: Sees(CLEAR))
    builder = ObstacleReportBuilder(AVOID, SeenCameras(cameras=("front", "rear"), timeout_s=0.3, observer=shown.append))
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
    chain.builder = ObstacleReportBuilder(AVOID, SeenCameras(cameras=("front",), timeout_s=0.3))
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


def test_a_remembered_obstacle_outlives_the_attitude() -> None:
    chain = Chain(model(wall_at(0.0, 2.0), free_to_m=1.6, view_deg=72.0))
    chain.fly(1.0)
    assert chain.ahead(ARDUPILOT) == 170
    chain.fly(1.0, attitudes=False)
    assert "attitude" in chain.report().blind["front"]
    assert chain.ahead(ARDUPILOT) == 170


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
    builder = ObstacleReportBuilder(AVOID, SeenCameras(cameras=("front", "right"), timeout_s=0.3))
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


def test_a_result_that_cannot_be_taken_is_blindness_and_not_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is taken by the thread of the sender: the fault ended it, and ArduPilot takes silence for clear."""
    chain = Chain(CLEAR)
    chain.fly(1.0)
    sender = ObstacleSender(chain.builder, AVOID, lambda: ARDUPILOT, lambda message: None)
    with monkeypatch.context() as broken_confirmation:
        broken_confirmation.setattr(PlaneConfirmation, "take", lambda self, result: 1 // 0)
        chain.fly(0.3)
        sender._send(chain.now_ns)
    assert sender.report is not None
    assert "cannot be computed" in sender.report.fault
    assert sender.report.values is not None
    assert sender.report.values[0] == WALL
    chain.fly(0.4)
    assert chain.report(PX4).fault == ""
    chain.fly(0.4)
    assert chain.ahead(PX4) == 1201


@pytest.mark.process
def test_a_result_does_not_wait_for_a_decision_that_takes_long() -> None:
    """The pipeline gave its results while the decision and the guard's sight of the path were computed."""
    deciding, goes_on = threading.Event(), threading.Event()

    def observe(surroundings: Surroundings) -> None:
        deciding.set()
        assert goes_on.wait(60.0)

    chain = Chain(CLEAR)
    chain.fly(1.0)
    good = chain.newest()
    chain.builder._observer = observe
    decision = threading.Thread(target=chain.report)
    decision.start()
    try:
        assert deciding.wait(60.0)
        giving = threading.Thread(target=chain.builder.result, args=(good,))
        giving.start()
        giving.join(10.0)
        assert not giving.is_alive()
    finally:
        goes_on.set()
        decision.join(60.0)

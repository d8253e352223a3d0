"""The output when a link of the chain fails: blind by 0.4 s after the newest exposure, whichever part detects the
fault."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from companion.autopilot import sender as sender_module
from companion.autopilot.confirmation import PlaneConfirmation
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_report import CameraUse, ObstacleReport
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.sender import ObstacleSender
from companion.autopilot.surroundings import Surroundings
from core.types import FrameModel
from tests.nightly import nightly
from tests.waiting import until

from ..report_chain import ARDUPILOT, AVOID, CAMERA, CLEAR, FAULTS, NS, PX4, WALL, Chain, broken
from ..sector_models import model, wall_at
from ..small_recordings import MS


def test_it_sees_after_good_frames_in_a_row() -> None:
    chain = Chain(CLEAR)
    assert chain.ahead() == UNKNOWN
    chain.fly(0.2)
    assert chain.ahead() == UNKNOWN
    assert "too few valid frames" in chain.report().blind["front"]
    chain.fly(0.2)
    assert chain.ahead() == 1201
    assert chain.report().blind == {}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("found", [CLEAR, *nightly(model(wall_at(0.0, 8.0, 12.0), free_to_m=7.5, view_deg=72.0))])
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
        AVOID, CameraUse(cameras=("front",), timeout_s=0.3, frame_fault=lambda camera: frozen[camera])
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


def test_a_remembered_obstacle_outlives_the_attitude() -> None:
    chain = Chain(model(wall_at(0.0, 2.0), free_to_m=1.6, view_deg=72.0))
    chain.fly(1.0)
    assert chain.ahead(ARDUPILOT) == 170
    chain.fly(1.0, attitudes=False)
    assert "attitude" in chain.report().blind["front"]
    assert chain.ahead(ARDUPILOT) == 170


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

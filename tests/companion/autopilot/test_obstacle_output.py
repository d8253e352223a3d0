"""Requests of the obstacle output to the autopilot, and its end in flight: the artificial wall is held for a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from companion.autopilot import obstacle_output, sender
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse, ObstacleReport
from companion.config.avoidance import AvoidParams
from drivers.mavlink.commands import SET_MESSAGE_INTERVAL
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import Vehicle
from osape_client.proto import osape_v1_pb2 as pb

from ..link_status import link_status
from ..report_chain import AVOID, CAMERA, Chain
from ..sector_models import model, wall_at

NS = 1_000_000_000
HOLD_S = 3.0
SEEN = CameraUse(cameras=("front",), timeout_s=0.3)
WALL = ObstacleReport(NS, np.full(72, 212, np.uint16), {"front": "the service stops"}, "stop")


class Stop:
    """An output whose last report is given, with a clock that only `sleep` moves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, report: ObstacleReport | None, armed: bool = True) -> None:
        self.now_ns, self.posted, self.closed, self.silent = NS, list[Any](), 0, False
        self.armed: Callable[[float], bool] = lambda after_s: armed
        monkeypatch.setattr(
            obstacle_output, "time", SimpleNamespace(monotonic_ns=lambda: self.now_ns, sleep=self._sleep)
        )
        avoid = AvoidParams(send=True, stop_hold_s=HOLD_S)
        line = AutopilotLine(lambda: None if self.silent else self._vehicle(), self.posted.append, self._vehicle)
        self.part = ObstacleOutput(avoid, SEEN, line)
        self.sender = SimpleNamespace(report=report, running=True, close=self._close, sent=0)
        monkeypatch.setattr(self.part, "sender", self.sender)

    def _vehicle(self) -> Vehicle:
        return Vehicle(1, "ArduPilot", 2, self.armed((self.now_ns - NS) / NS), 5, 0)

    def _sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)

    def _close(self) -> None:
        self.closed += 1

    def held_s(self) -> float:
        self.part.close()
        return (self.now_ns - NS) / NS


@pytest.mark.parametrize("policy", ["stop", "brake"])
def test_an_armed_vehicle_is_sent_the_wall_for_the_configured_time(
    monkeypatch: pytest.MonkeyPatch, policy: str
) -> None:
    stop = Stop(monkeypatch, replace(WALL, policy=policy))
    stop.part.end()
    assert [m.get_type() for m in stop.posted] == ["STATUSTEXT"]
    assert stop.held_s() == pytest.approx(HOLD_S, abs=0.06)
    assert stop.closed == 1
    assert stop.held_s() == pytest.approx(HOLD_S, abs=0.06), "not again"


@pytest.mark.parametrize("report", [None, replace(WALL, policy="unknown"), replace(WALL, values=None)])
def test_without_a_wall_nothing_is_held(monkeypatch: pytest.MonkeyPatch, report: ObstacleReport | None) -> None:
    stop = Stop(monkeypatch, report)
    stop.part.end()
    assert stop.held_s() == 0.0


def test_a_vehicle_that_is_not_armed_is_sent_neither_text_nor_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = Stop(monkeypatch, WALL, armed=False)
    stop.part.end()
    assert stop.posted == []
    assert stop.held_s() == 0.0


def test_an_armed_vehicle_that_is_silent_may_still_receive(monkeypatch: pytest.MonkeyPatch) -> None:
    """Obstacles are sent to it until the stop, which sent neither text nor wall."""
    stop = Stop(monkeypatch, WALL)
    stop.silent = True
    stop.part.end()
    assert [m.get_type() for m in stop.posted] == ["STATUSTEXT"]
    assert stop.held_s() == pytest.approx(HOLD_S, abs=0.06)


@pytest.mark.parametrize("silent", [False, True])
def test_of_several_vehicles_the_own_one_may_be_armed(monkeypatch: pytest.MonkeyPatch, silent: bool) -> None:
    stop = Stop(monkeypatch, WALL, armed=False)
    stop.part.tick(NS, link_status(None, vehicle_uncertain=True))
    stop.posted.clear()
    stop.silent = silent
    stop.part.end()
    assert [m.get_type() for m in stop.posted] == ["STATUSTEXT"]
    assert stop.held_s() == pytest.approx(HOLD_S, abs=0.06)


def test_the_wall_is_held_no_longer_than_the_vehicle_is_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = Stop(monkeypatch, WALL)
    stop.armed = lambda after_s: after_s < 1.0
    stop.part.end()
    assert stop.held_s() == pytest.approx(1.0, abs=0.06)


def test_an_output_whose_thread_has_ended_holds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = Stop(monkeypatch, WALL)
    stop.sender.running = False
    stop.part.end()
    assert stop.held_s() == 0.0
    assert stop.closed == 1


def test_a_second_announcement_does_not_lengthen_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = Stop(monkeypatch, WALL)
    stop.part.end()
    stop.now_ns += 2 * NS
    stop.part.end()
    assert len(stop.posted) == 1
    assert stop.held_s() == pytest.approx(HOLD_S, abs=0.06)


@pytest.mark.parametrize(("kind", "echo"), [("PX4", 330), ("ArduPilot", 132), ("autopilot 8", None)])
def test_messages_that_the_check_needs_are_requested_every_ten_seconds(kind: str, echo: int | None) -> None:
    """Ten times a second they would fill a slow line. An autopilot that starts again has forgotten the request."""
    requested: list[tuple[int, int]] = []

    def post(message: Any) -> None:
        if message.get_type() == "COMMAND_LONG" and message.command == SET_MESSAGE_INTERVAL:
            assert message.param2 == pytest.approx(500_000.0), "2 Hz"
            requested.append((now_ns // NS, int(message.param1)))

    part = ObstacleOutput(AvoidParams(send=True), SEEN, AutopilotLine(lambda: Vehicle(1, kind, 2, True, 5, 0), post))
    for step in range(250):
        now_ns = NS + step * NS // 10
        part.tick(now_ns)
    assert requested == [(at_s, wanted) for at_s in (1, 11, 21) for wanted in (echo, 245) if echo]


def test_what_the_autopilot_sends_back_is_in_the_health_report() -> None:
    part = ObstacleOutput(AvoidParams(send=True), SEEN, AutopilotLine(lambda: None, lambda message: None))
    echo = dialect.MAVLink_obstacle_distance_message(0, 4, [65535] * 71 + [300], 5, 20, 1000, 5.0, 0.0, 12)
    part.message(echo, NS)
    health = pb.AutopilotHealth()
    part.fill(health, NS + 1)
    assert list(health.obstacles_echoed.cm) == [65535] * 71 + [300]
    assert not health.HasField("obstacles_sent")


def test_the_age_of_what_is_sent_is_that_of_the_frames_it_was_decided_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """A decision that took too long is made again with newer frames."""
    chain = Chain(model(wall_at(0.0, 5.0)), AVOID)
    part = ObstacleOutput(
        AVOID, SEEN, AutopilotLine(lambda: Vehicle(1, "PX4", 2, True, 0, chain.now_ns), lambda message: None)
    )
    clock = SimpleNamespace(monotonic_ns=lambda: chain.now_ns)
    monkeypatch.setattr(obstacle_output, "time", clock)
    monkeypatch.setattr(sender, "time", clock)
    monkeypatch.setattr(chain, "builder", part)
    part.announce(CAMERA)
    chain.fly(1.0)
    decide, decisions = part._builder.decide, list[ObstacleReport]()

    def slow(autopilot: AutopilotNow, now_ns: int) -> ObstacleReport:
        decisions.append(decide(autopilot, now_ns))
        if len(decisions) == 1:
            chain.fly(0.25)
        return decisions[-1]

    monkeypatch.setattr(part._builder, "decide", slow)
    part.sender._send(chain.now_ns)
    assert len(decisions) == 2
    latency = part.latency()
    assert latency is not None
    assert latency[1] == pytest.approx(50.0), "the newest frame; the one before it is 150 ms old"
    assert part.report is decisions[1]

"""Whether a command reaches the right vehicle, and what the commands look like on the wire."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import pytest

from companion.autopilot.line import AutopilotLine
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.config.loader import Config, ConfigError, config_of
from companion.guard.certainty import LONGEST_HEARTBEAT_NS, REACHED_NS, Certainty
from companion.guard.guard import Guard, message_of
from companion.guard.modes import StopMethod
from companion.guard.states import GuardState, SpeedCommand, StopCommand
from drivers.mavlink import commands
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session import MavlinkSession, Vehicle
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from ..link_status import link_status

NS = 1_000_000_000
NOW = 100 * NS
COPTER = Vehicle(7, "ArduPilot", 2, True, 3, NOW)
LINK = link_status(COPTER, clock=ClockEstimate(ClockSource.NONE))


def reached() -> Certainty:
    certainty = Certainty()
    assert len(certainty.requests(COPTER, NOW)) == 1
    certainty.acknowledged(511, 0, NOW)
    return certainty


def test_before_an_acknowledgement_there_is_doubt() -> None:
    certainty = Certainty()
    certainty.acknowledged(511, 0, NOW)  # nothing was asked yet: the answer to another station
    request = certainty.requests(COPTER, NOW)[0]
    assert (request.target_system, request.target_component, request.command, request.param1) == (7, 1, 511, 0)
    assert certainty.doubt(COPTER, {}, "", NOW) == "commands are not acknowledged"
    certainty.acknowledged(511, 2, NOW)  # denied
    assert certainty.doubt(COPTER, {}, "", NOW) != ""
    certainty.acknowledged(511, 0, NOW)
    assert certainty.doubt(COPTER, {}, "", NOW) == ""


@pytest.mark.parametrize(("command", "result"), [(512, 0), (512, 3), (511, 4)])
def test_any_answer_of_px4_shows_that_commands_arrive(command: int, result: int) -> None:
    """PX4 answers a request for the rate of its heartbeat with MAV_RESULT_FAILED (MavlinkReceiver::set_message_interval)."""
    px4, certainty = replace(COPTER, autopilot="PX4"), Certainty()
    certainty.requests(px4, NOW)
    certainty.acknowledged(command, result, NOW)
    assert certainty.doubt(px4, {}, "", NOW) == ""
    assert not certainty.silent(NOW + REACHED_NS)


@pytest.mark.parametrize("kind", ["PX4", "ArduPilot"])
def test_a_change_of_mode_is_known_within_a_quarter_of_a_second(kind: str) -> None:
    """PX4 sends its heartbeat at 1 Hz, whatever rate is requested, and a single one on request. A mission that is resumed
    close to a wall would be noticed up to 1 s late."""
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, armed=True))
    session, certainty, encoder = MavlinkSession(), Certainty(), dialect.MAVLink(None, 1, 196)
    beats: list[int] = []
    for step in range(200):
        now_ns = NOW + step * NS // 20
        for data in autopilot.due(now_ns):
            session.receive([(data, now_ns)])
            m = dialect.MAVLink(None).decode(bytearray(data))
            if m.get_type() == "COMMAND_ACK":
                certainty.acknowledged(int(m.command), int(m.result), now_ns)
            beats += [now_ns] if m.get_type() == "HEARTBEAT" else []
        if session.vehicle is not None:
            for request in certainty.requests(session.vehicle, now_ns):
                autopilot.receive(bytes(request.pack(encoder)), now_ns)
    late = [b - a for a, b in itertools.pairwise(beats) if a > NOW + 2 * NS]
    assert max(late) <= NS // 4


@pytest.mark.parametrize("kind", ["PX4", "ArduPilot"])
def test_a_simulated_autopilot_answers_for_longer_than_an_answer_counts(kind: str) -> None:
    """Its other rates are requested at the start alone."""
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind))
    session, certainty = MavlinkSession(), Certainty()
    encoder = dialect.MAVLink(None, 1, 196)
    for tenth in range(200):
        now_ns = NOW + tenth * NS // 10
        messages = [dialect.MAVLink(None).decode(bytearray(data)) for data in autopilot.due(now_ns)]
        session.receive([(bytes(m.get_msgbuf()), now_ns) for m in messages])
        for m in messages:
            if m.get_type() == "COMMAND_ACK":
                certainty.acknowledged(int(m.command), int(m.result), now_ns)
        if session.vehicle is not None:
            for request in certainty.requests(session.vehicle, now_ns):
                autopilot.receive(bytes(request.pack(encoder)), now_ns)
    assert session.vehicle is not None
    assert certainty.doubt(session.vehicle, {}, "", NOW + 20 * NS) == ""
    assert not certainty.silent(NOW + 20 * NS)


@pytest.mark.parametrize(
    ("vehicle", "conflicts", "signing", "doubt"),
    [
        (COPTER, {"two autopilots": "heartbeats contradict"}, "", "two autopilots"),
        (COPTER, {"two clocks": "stamps of two clocks"}, "", "two clocks"),
        (COPTER, {"two services": "a second sender"}, "", "two services"),
        (COPTER, {"two companions": "another one sends obstacles"}, "", ""),
        (replace(COPTER, autopilot="ArduPilot or PX4"), {}, "", "autopilot kind unknown"),
        (replace(COPTER, autopilot="autopilot 4"), {}, "", "autopilot kind unknown"),
        (replace(COPTER, vehicle_type=1), {}, "", "not a multicopter"),
        (replace(COPTER, vehicle_type=20), {}, "", "not a multicopter"),
        (replace(COPTER, heartbeat_ns=NOW - LONGEST_HEARTBEAT_NS - 1), {}, "", "no heartbeat"),
        (COPTER, {}, "the autopilot signs", "message signing fault"),
    ],
)
def test_doubts(vehicle: Vehicle, conflicts: dict[str, str], signing: str, doubt: str) -> None:
    assert reached().doubt(vehicle, conflicts, signing, NOW) == doubt


def heartbeat(system: int, autopilot: int = 3, armed: bool = True) -> bytes:
    message = dialect.MAVLink_heartbeat_message(2, autopilot, 128 if armed else 0, 3, 4, 3)
    return bytes(message.pack(dialect.MAVLink(None, system, 1)))


@pytest.mark.parametrize("systems", [(1, 2), (2, 1)])
@pytest.mark.parametrize("alternating_s", [1, 5])
@pytest.mark.parametrize("armed", [False, True])
def test_two_vehicles_on_a_link_are_a_doubt(systems: tuple[int, int], alternating_s: int, armed: bool) -> None:
    """First both are received, then only the second. The first one stays the vehicle."""
    session, now_ns = MavlinkSession(), NOW
    certainty = Certainty()
    for second in range(90):
        now_ns += NS
        for system in systems if second < alternating_s else systems[1:]:
            session.receive([(heartbeat(system, armed=armed), now_ns)])
        vehicle = session.vehicle
        assert vehicle is not None
        certainty.requests(vehicle, now_ns)
        certainty.acknowledged(511, 0, now_ns)
        status = session.status(now_ns)
        doubt = certainty.doubt(vehicle, status.conflicts, status.signing_fault, now_ns)
        assert doubt == "several vehicles", second
    assert session.vehicle is not None
    assert session.vehicle.system_id == systems[0]


def test_a_configured_vehicle_is_not_in_doubt_for_another() -> None:
    session = MavlinkSession(MavlinkParams(system_id=1))
    session.receive([(heartbeat(1) + heartbeat(2), NOW)])
    assert "several vehicles" not in session.status(NOW).conflicts


def test_the_vehicle_carries_the_state_of_the_system() -> None:
    session = MavlinkSession()
    message = dialect.MAVLink_heartbeat_message(2, 3, 128, 6, 5, 3)
    session.receive([(bytes(message.pack(dialect.MAVLink(None, 1, 1))), NOW)])
    assert session.vehicle is not None
    assert session.vehicle.system_status == 5


@pytest.mark.parametrize("other", [replace(COPTER, system_id=9), replace(COPTER, autopilot="PX4")])
def test_another_vehicle_must_answer_for_itself(other: Vehicle) -> None:
    certainty = reached()
    certainty.requests(other, NOW)
    assert certainty.doubt(other, {}, "", NOW) == "commands are not acknowledged"


def test_requests_are_repeated_with_growing_waits() -> None:
    certainty = Certainty()
    asked = [n for n in range(600) if certainty.requests(COPTER, NOW + n * NS // 10)]
    assert asked[:4] == [0, 10, 30, 70]
    assert max(b - a for a, b in itertools.pairwise(asked)) == 100


def test_a_vehicle_that_does_not_answer_any_more_is_silent_and_asked_more_often() -> None:
    """What is sent does not arrive, or its answers do not. Who would receive a command is not in doubt."""
    certainty = reached()
    asked: list[int] = []
    for tenth in range(1, 301):
        now_ns = NOW + tenth * NS // 10
        asked += [tenth] if certainty.requests(COPTER, now_ns) else []
        assert certainty.doubt(replace(COPTER, heartbeat_ns=now_ns), {}, "", now_ns) == ""
        assert certainty.silent(now_ns) == (now_ns - NOW > REACHED_NS)
    assert len([tenth for tenth in asked if tenth <= 80]) >= 5, "answers may be lost"
    assert max(b - a for a, b in itertools.pairwise(asked[1:])) == 10, "no longer waits"
    certainty.acknowledged(511, 0, NOW + 30 * NS)
    assert not certainty.silent(NOW + 31 * NS)


def test_a_vehicle_that_never_answered_is_in_doubt_and_not_silent() -> None:
    certainty = Certainty()
    certainty.requests(COPTER, NOW)
    assert certainty.doubt(COPTER, {}, "", NOW + 60 * NS) != ""
    assert not certainty.silent(NOW + 60 * NS)


@pytest.mark.parametrize(
    ("output", "command", "params"),
    [
        (StopCommand(7, StopMethod.PX4_HOLD), 176, (1, 4, 3)),
        (StopCommand(7, StopMethod.COPTER_BRAKE), 176, (1, 17, 0)),
        (StopCommand(7, StopMethod.COPTER_LOITER), 176, (1, 5, 0)),
        (StopCommand(7, StopMethod.PX4_REPOSITION), 192, (-1, 1, 0)),
        (SpeedCommand(7, 2.5), 178, (1, 2.5, -1)),
    ],
)
def test_commands_as_they_are_sent(output: StopCommand | SpeedCommand, command: int, params: tuple[float, ...]) -> None:
    message = message_of(output)
    assert (message.target_system, message.target_component, message.command) == (7, 1, command)
    assert (message.param1, message.param2, message.param3) == params
    if command == 192:
        assert all(math.isnan(value) for value in (message.param5, message.param6, message.param7))


def test_no_broadcast_and_no_speed_of_zero() -> None:
    for system in (0, 256):
        with pytest.raises(ValueError, match="target system"):
            commands.set_px4_hold(system)
    for speed in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="speed"):
            commands.change_speed(1, speed)


def test_the_guard_needs_the_obstacle_output() -> None:
    with pytest.raises(ValueError, match=r"\[guard\] enabled"):
        Config(guard=GuardParams(enabled=True))
    with pytest.raises(ConfigError, match="reaction_s"):
        config_of({"guard": {"reaction_s": 9.0}}, "test")


def test_its_texts_fit_and_are_not_repeated(tmp_path: Any) -> None:
    sent: list[Any] = []
    guard = Guard(
        GuardParams(enabled=True),
        AvoidParams(),
        AutopilotLine(lambda: COPTER, sent.append),
        lambda: LINK,
        tmp_path,
    )
    for n in range(48):  # 2.4 s, in which the heartbeat is young enough
        guard.step(NOW + n * NS // 20)
    texts = [m.text for m in sent if m.get_type() == "STATUSTEXT"]
    assert guard.memory.state is GuardState.UNAVAILABLE
    assert texts == ["OA: guard: off, commands are not acknowledged"]
    assert all(len(text) <= 50 for text in texts)
    assert [d.code for d in guard.diagnostics()] == ["guard_unavailable"]

"""A session against a simulated autopilot: requests, rates, commands and what is handed on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from core.types import AttitudeSample
from drivers.mavlink.commands import DO_SET_MODE, set_px4_hold
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams, Vehicle
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile, hovering

from .conversation import MS, NS, Conversation, talk


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_the_wanted_rates_are_asked_for_and_arrive(kind: str) -> None:
    c = talk(kind, boot_at_ns=90 * NS)
    c.run(8.0)
    status = c.session.status(c.now_ns)
    assert status.attitude_hz == pytest.approx(100.0, rel=0.1)
    assert status.position_hz == pytest.approx(30.0, rel=0.1)


def test_nothing_is_sent_before_a_heartbeat_of_the_autopilot() -> None:
    c = Conversation(MavlinkSession(), [])
    c.session.post(dialect.MAVLink_statustext_message(6, b"nobody hears"), c.now_ns)
    c.run(3.0)
    assert c.sent == []
    assert c.session.counts["unsent_no_autopilot"] == 1


def test_an_autopilot_whose_heartbeats_are_lost_but_not_other_messages_still_receives_obstacles() -> None:
    """On a bad line three heartbeats in a row are soon lost; ArduPilot would fly on without our obstacles."""
    c = talk(ARDUPILOT, boot_at_ns=90 * NS)
    c.run(4.0)
    c.lost = frozenset({0})  # HEARTBEAT
    for _ in range(20):
        c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
        c.run(0.5)
    assert len(c.autopilots[0].of_kind("OBSTACLE_DISTANCE")) == 20
    c.lost = None  # and now everything
    c.run(4.0)
    c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    c.run(0.5)
    assert len(c.autopilots[0].of_kind("OBSTACLE_DISTANCE")) == 20


@pytest.mark.parametrize(("mode", "armed", "sent"), [(0, True, True), (5, True, False), (0, False, False)])
def test_a_command_that_a_heartbeat_contradicts_before_it_is_sent_is_dropped(
    mode: int, armed: bool, sent: bool
) -> None:
    """The pilot changes the mode, or the vehicle disarms, after the command was decided and posted."""
    c = talk(PX4, armed=True)
    c.run(2.0)
    decided_by = c.session.vehicle
    assert decided_by is not None
    c.session.post(set_px4_hold(1), c.now_ns, decided_by)
    c.autopilots[0].profile.custom_mode, c.autopilots[0].profile.armed = mode, armed
    heartbeat = c.autopilots[0]._pack(c.autopilots[0]._heartbeat())
    c.session.receive([(heartbeat, c.now_ns)])
    splitter = MessageSplitter()
    messages = [m for data in c.session.due(c.now_ns) for m in splitter.feed(data)]
    assert any(m.get_type() == "COMMAND_LONG" and m.command == DO_SET_MODE for m in messages) is sent


def test_what_contradicts_the_state_by_which_a_command_was_decided() -> None:
    decided_by = Vehicle(1, PX4, 2, True, 4, 0)
    assert not replace(decided_by, heartbeat_ns=NS, system_status=5).contradicts(decided_by)
    for change in ({"system_id": 2}, {"autopilot": ARDUPILOT}, {"custom_mode": 3}, {"armed": False}):
        assert replace(decided_by, **change).contradicts(decided_by)


def test_of_distances_that_wait_the_newest_alone_goes_out() -> None:
    """After a gap of the link, old messages would be sent before the present one, with directions that were free then."""
    c = talk(PX4, boot_at_ns=90 * NS)
    c.run(2.0)
    for cm in (1201, 900, 300):
        c.session.post(dialect.MAVLink_statustext_message(6, f"at {cm}".encode()), c.now_ns)
        c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [cm] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    c.run(0.2)
    assert [m.distances[0] for m in c.autopilots[0].of_kind("OBSTACLE_DISTANCE")] == [300]
    assert [m.text for m in c.autopilots[0].of_kind("STATUSTEXT")] == ["at 1201", "at 900", "at 300"]


def test_a_hello_goes_out_on_a_line_whose_other_end_waits_for_it() -> None:
    session = MavlinkSession()
    (hello,) = session.due(NS, sends_first=True)
    message = dialect.MAVLink(None).parse_buffer(hello)[0]
    assert message.get_type() == "HEARTBEAT"
    assert session.due(NS + MS, sends_first=True) == []


def test_our_heartbeat_reports_what_we_are_and_how_the_pipeline_is() -> None:
    c = talk(PX4)
    c.session.system_status = dialect.MAV_STATE_CRITICAL
    c.run(3.0)
    beats = c.autopilots[0].of_kind("HEARTBEAT")
    assert len(beats) in (3, 4)
    last = beats[-1]
    assert (last.type, last.autopilot, last.system_status) == (18, 8, dialect.MAV_STATE_CRITICAL)
    assert (last.get_srcSystem(), last.get_srcComponent()) == (1, 196)
    assert last.get_msgbuf()[0] == 0xFD


def test_an_ardupilot_without_intervals_is_asked_in_the_old_way_once() -> None:
    c = talk(ARDUPILOT, knows_intervals=False)
    c.run(10.0)
    requests = c.autopilots[0].of_kind("REQUEST_DATA_STREAM")
    assert sorted(m.req_stream_id for m in requests) == [6, 10]
    assert c.session.status(c.now_ns).attitude_hz == pytest.approx(100.0, rel=0.1)


@pytest.mark.parametrize(
    ("system", "component", "ours"), [(0, 0, True), (1, 196, True), (1, 197, False), (255, 190, False)]
)
def test_answers_to_commands_of_others_do_not_count(system: int, component: int, ours: bool) -> None:
    """A router brings them, and PX4 sends them on every link. A station whose command was not known had the rates requested
    in the old way until the autopilot was restarted. Autopilots without target fields send 0."""
    answers: list[Any] = []
    c = talk(ARDUPILOT)
    c.session = MavlinkSession(on_message=lambda m, _: answers.append(m), reads=frozenset({77}))
    c.run(2.0)
    answers.clear()
    ack = dialect.MAVLink_command_ack_message(511, 3, 0, 0, system, component)
    c.session.receive([(bytes(ack.pack(dialect.MAVLink(None, 1, 1))), c.now_ns)])
    assert (len(answers), c.session.rates.knows_intervals) == (ours, not ours)


def test_the_old_way_is_asked_again_after_another_station_has_changed_the_rates() -> None:
    c = talk(ARDUPILOT, knows_intervals=False)
    c.run(10.0)
    station = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    c.autopilots[0].receive(dialect.MAVLink_request_data_stream_message(1, 1, 10, 4, 1).pack(station), c.now_ns)
    c.run(9.0)
    assert c.session.status(c.now_ns).attitude_hz == pytest.approx(100.0, rel=0.1)
    streams = [m.req_stream_id for m in c.autopilots[0].of_kind("REQUEST_DATA_STREAM")]
    assert (streams.count(6), streams.count(10)) == (1, 3)  # the second one is of the station


def test_a_refused_rate_is_asked_for_ever_more_rarely() -> None:
    c = talk(ARDUPILOT, MavlinkParams(attitude_hz=400.0))
    c.run(60.0)
    asked = [m for m in c.autopilots[0].of_kind("COMMAND_LONG") if m.param1 == 31]
    assert 3 <= len(asked) <= 6
    assert all(m.param2 > 0 for m in asked)


def test_rates_that_another_station_takes_away_are_asked_for_again() -> None:
    c = talk(PX4)
    c.run(5.0)
    c.autopilots[0]._intervals.clear()
    c.run(12.0)
    assert c.session.status(c.now_ns).attitude_hz == pytest.approx(100.0, rel=0.1)


def test_noise_between_messages_is_skipped_and_counted() -> None:
    c = talk(PX4)
    c.noise = b"\x00\xfd\x03noise"
    c.run(3.0)
    assert len([s for s in c.samples if isinstance(s, AttitudeSample)]) > 250  # 100 Hz: none is lost with the noise
    assert c.session.status(c.now_ns).counts["noise_bytes"] > 1000


def test_every_good_frame_is_handed_to_the_log_as_it_came() -> None:
    frames: list[tuple[bytes, int]] = []
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=PX4, motion=hovering))
    c = Conversation(MavlinkSession(on_frame=lambda data, t_ns: frames.append((data, t_ns))), [autopilot])
    c.run(12.0)
    again = MavlinkSession()
    samples = again.receive(frames)  # the logged bytes give the same in a new session, except for the clock
    assert len(frames) == c.session.received
    assert len(samples) > 50  # its clock is not synchronised: the stamps of the first ten seconds are not used
    assert [type(s) for s in samples] == [type(s) for s in c.samples[-len(samples) :]]


def test_a_message_without_a_reader_is_logged_and_counts_as_received() -> None:
    encoder = dialect.MAVLink(None, 1, 1)
    heartbeat = bytes(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(encoder))
    unread = bytes(dialect.MAVLink_vfr_hud_message(1.0, 2.0, 3, 4, 5.0, 6.0).pack(encoder))
    broken = unread[:-1] + bytes([unread[-1] ^ 1])
    kept: list[bytes] = []
    session = MavlinkSession(on_frame=lambda data, t_ns: kept.append(data))
    session.receive([(heartbeat, NS)])
    for k in range(2, 10):
        session.receive([(unread, k * NS), (broken, k * NS)])
        assert session.connected(k * NS)
    assert kept == [heartbeat] + 8 * [unread]
    assert session.status(9 * NS).counts["noise_bytes"] == 8 * len(broken)


def test_a_reader_receives_the_messages_it_requested_and_no_motion() -> None:
    encoder = dialect.MAVLink(None, 1, 1)
    messages = [
        dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3),
        dialect.MAVLink_vfr_hud_message(1.0, 2.0, 3, 4, 5.0, 6.0),
        dialect.MAVLink_attitude_quaternion_message(1000, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_param_value_message(b"CP_DIST", 2.0, 9, 1, 0),
    ]
    for reads, expected in ((None, ["HEARTBEAT", "VFR_HUD", "PARAM_VALUE"]), (frozenset({22}), ["PARAM_VALUE"])):
        received_kinds: list[Any] = []
        session = MavlinkSession(
            on_message=lambda m, t_ns, received_kinds=received_kinds: received_kinds.append(m.get_type()), reads=reads
        )
        session.receive([(bytes(m.pack(encoder)), NS) for m in messages])
        assert received_kinds == expected


@pytest.mark.parametrize(
    ("expected", "params", "connected"),
    [
        (Vehicle(1, PX4, 0, True, 0, 0), None, True),
        (Vehicle(2, PX4, 0, True, 0, 0), None, False),
        (Vehicle(1, PX4, 0, True, 0, 0), MavlinkParams(system_id=2), False),
        (None, None, False),
    ],
)
def test_an_autopilot_received_before_the_start_counts_before_its_heartbeat(
    expected: Vehicle | None, params: MavlinkParams | None, connected: bool
) -> None:
    """After a restart in flight a second may pass until the next one."""
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=PX4, boot_at_ns=90 * NS))
    c = Conversation(MavlinkSession(params, expected=expected), [autopilot], lost=frozenset({0}))
    c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    c.run(0.1)
    assert (c.session.vehicle is not None) == connected
    c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    c.run(0.1)
    assert ("OBSTACLE_DISTANCE" in c.kinds()) == connected
    if params is None:
        c.lost = frozenset()
        c.run(1.5)
        assert c.session.vehicle is not None
        assert c.session.vehicle.heartbeat_ns > 0
        assert not c.session.vehicle.armed  # its heartbeat counts from then on

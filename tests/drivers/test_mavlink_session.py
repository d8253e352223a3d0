"""A session against a simulated autopilot, without a line: instants are made up, bytes are real."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import AttitudeSample, PoseSample
from drivers.logs.codec import attitude_from_message, attitude_message, pose_from_message, pose_message
from drivers.mavlink.bandwidth import budget_of
from drivers.mavlink.clock_sync import ClockFilter, ClockSource
from drivers.mavlink.commands import DO_SET_MODE, set_px4_hold
from drivers.mavlink.dialect import dialect
from drivers.mavlink.motion import motion_fields
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MAV_STATE_CRITICAL, MavlinkSession
from drivers.mavlink.session_types import MavlinkParams, Vehicle
from drivers.mavlink.timesync import TimeSync
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile, hovering
from drivers.simulation.flight_path import VehicleState

MS, NS = 1_000_000, 1_000_000_000


def turning(now_ns: int) -> VehicleState:
    """60 degrees a second to the right."""
    still = (0.0, 0.0, 0.0)
    yaw = math.remainder(math.radians(60.0) * now_ns / NS, 2.0 * math.pi)
    rates = (0.0, 0.0, math.radians(60.0))
    return VehicleState(position_ned_m=still, velocity_ned_m_s=still, euler_rad=(0, 0, yaw), rates_frd_rad_s=rates)


@dataclass
class Conversation:
    """Both ends in steps of a millisecond; a message is delay_ns on its way."""

    session: MavlinkSession
    autopilots: list[SimulatedAutopilot]
    delay_ns: int = 2 * MS
    now_ns: int = 100 * NS
    samples: list[AttitudeSample | PoseSample] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)
    noise: bytes = b""
    lost: frozenset[int] | None = frozenset()
    """Ids of messages that do not arrive here; None: none arrives."""

    def run(self, seconds: float) -> None:
        for _ in range(int(seconds * 1000)):
            self.now_ns += MS
            chunks = [
                (self.noise + d, self.now_ns + self.delay_ns)
                for a in self.autopilots
                for d in a.due(self.now_ns)
                if self.lost is not None and int.from_bytes(d[7:10], "little") not in self.lost
            ]
            self.samples += self.session.receive(chunks)
            for data in self.session.due(self.now_ns):
                self.sent.append(data)
                for a in self.autopilots:
                    a.receive(data, self.now_ns + self.delay_ns)

    def kinds(self) -> list[str]:
        parser = dialect.MAVLink(None)
        return [m.get_type() for d in self.sent for m in parser.parse_buffer(d)]


def talk(kind: str, params: MavlinkParams | None = None, **profile: Any) -> Conversation:
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, **profile))
    return Conversation(MavlinkSession(params), [autopilot])


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_two_seconds_after_the_first_heartbeat_attitudes_come_on_a_synchronised_clock(kind: str) -> None:
    c = talk(kind, boot_at_ns=90 * NS)
    c.run(2.0)
    status = c.session.status(c.now_ns)
    assert status.vehicle is not None
    assert (status.vehicle.autopilot, status.vehicle.system_id) == (kind, 1)
    assert status.clock.source is ClockSource.TIMESYNC
    assert any(isinstance(s, AttitudeSample) for s in c.samples)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_messages_may_lie_while_no_instant_of_an_arrival_counts(kind: str) -> None:
    c = talk(kind)
    c.run(0.2)
    assert c.session.status(c.now_ns).clock.source is not ClockSource.TIMESYNC
    assert not c.session.can_defer_read(c.now_ns)  # the clock is found by arrivals
    c.run(6.0)
    c.lost = frozenset({111})  # the answers to TIMESYNC
    deferrable = []
    for _ in range(1000):
        c.run(0.001)
        deferrable.append(c.session.can_defer_read(c.now_ns))
    assert 100 < deferrable.count(False) < 400  # 0.1 s after each of the two requests, in vain
    assert sum(a and not b for a, b in pairwise(deferrable)) == 2
    c.session.clock.restart()
    assert not c.session.can_defer_read(c.now_ns)


def test_each_sample_has_the_error_bound_of_the_clock() -> None:
    c = talk(PX4, boot_at_ns=90 * NS)
    c.lost = frozenset({111})
    c.run(11.5)
    assert {type(s) for s in c.samples} == {AttitudeSample, PoseSample}
    assert {s.stamp_error_ns for s in c.samples} == {30 * MS}
    c.lost, c.samples = frozenset(), []
    c.run(2.0)
    newest = [s for s in c.samples if isinstance(s, AttitudeSample)][-1]
    assert newest.stamp_error_ns == pytest.approx(c.session.clock.estimate.bound_ns, abs=MS)
    assert 0 < newest.stamp_error_ns < 5 * MS
    assert attitude_from_message(attitude_message(newest)) == newest
    place = [s for s in c.samples if isinstance(s, PoseSample)][-1]
    assert 0 < place.stamp_error_ns < 5 * MS
    assert pose_from_message(pose_message(place)) == place


def test_answers_that_are_too_slow_to_be_used_are_reported() -> None:
    """They counted as answers: no diagnostic was given while the estimate grew old."""
    c = talk(PX4, boot_at_ns=90 * NS)
    c.run(6.0)
    c.delay_ns = 600 * MS
    c.run(10.0)
    assert not c.session.status(c.now_ns).timesync_answered


def test_a_line_that_is_slow_from_the_start_gives_no_samples() -> None:
    """Their stamps were taken for late by 30 ms at most, although answers took more than half a second."""
    c = talk(PX4, boot_at_ns=90 * NS)
    c.delay_ns = 600 * MS
    c.run(6.0)
    assert c.samples == []
    assert not c.session.status(c.now_ns).timesync_answered
    c.now_ns, c.delay_ns = c.now_ns + NS, 2 * MS
    c.run(2.0)
    assert {s.stamp_error_ns < 5 * MS for s in c.samples} == {True}


def test_an_answer_after_many_further_requests_shows_that_the_line_is_slow() -> None:
    """It counted as one to no request."""
    clock = ClockFilter()
    timesync = TimeSync(clock)
    sent = [m.ts1 for k in range(100) for m in timesync.due(100 * NS + k * NS // 10)]
    for k in range(1200):
        clock.arrival(50 * NS + k * 10 * MS, 110 * NS + k * 10 * MS)
    assert clock.usable
    answer = bytes(dialect.MAVLink_timesync_message(10 * NS, sent[0]).pack(dialect.MAVLink(None, 1, 1)))
    (frame,) = MessageSplitter().frames(answer)
    timesync.take(frame, 122 * NS, from_autopilot=True)
    assert timesync.unpaired == 0
    assert not clock.usable


def test_answers_that_stop_are_reported_before_the_clock_is_lost() -> None:
    c = talk(PX4, boot_at_ns=90 * NS)
    c.run(6.0)
    before = c.session.status(c.now_ns)
    assert before.timesync_answered
    c.lost = frozenset({111})
    c.run(10.0)
    after = c.session.status(c.now_ns)
    assert not after.timesync_answered
    assert before.clock.bound_ns is not None
    assert after.clock.bound_ns is not None
    assert after.clock.bound_ns > before.clock.bound_ns + MS
    c.run(52.0)
    assert c.session.status(c.now_ns).clock.source is ClockSource.ENVELOPE
    c.lost = frozenset()
    c.run(2.0)
    found = c.session.status(c.now_ns)
    assert found.timesync_answered
    assert found.clock.source is ClockSource.TIMESYNC


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_the_wanted_rates_are_asked_for_and_arrive(kind: str) -> None:
    c = talk(kind, boot_at_ns=90 * NS)
    c.run(8.0)
    status = c.session.status(c.now_ns)
    assert status.attitude_hz == pytest.approx(100.0, rel=0.1)
    assert status.position_hz == pytest.approx(30.0, rel=0.1)


@pytest.mark.parametrize(("kind", "hz"), [(ARDUPILOT, 5.0), (ARDUPILOT, 200.0), (PX4, 200.0)])
def test_slow_and_quick_attitudes_stand_at_their_measurement(kind: str, hz: float) -> None:
    c = talk(kind, MavlinkParams(attitude_hz=hz), motion=turning, boot_at_ns=90 * NS)
    c.run(8.0)
    assert c.session.status(c.now_ns).attitude_hz == pytest.approx(hz, rel=0.1)
    for s in [s for s in c.samples if isinstance(s, AttitudeSample)][-10:]:
        yaw = 2.0 * math.atan2(s.q_ned_frd_wxyz[3], s.q_ned_frd_wxyz[0])
        assert abs(math.remainder(yaw - turning(s.t_ns).euler_rad[2], 2.0 * math.pi)) < math.radians(0.1)


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
    c.session.system_status = MAV_STATE_CRITICAL
    c.run(3.0)
    beats = c.autopilots[0].of_kind("HEARTBEAT")
    assert len(beats) in (3, 4)
    last = beats[-1]
    assert (last.type, last.autopilot, last.system_status) == (18, 8, MAV_STATE_CRITICAL)
    assert (last.get_srcSystem(), last.get_srcComponent()) == (1, 196)
    assert last.get_msgbuf()[0] == 0xFD


def test_attitudes_stand_at_the_instant_of_their_measurement() -> None:
    c = talk(PX4, motion=turning, drift=50e-6, boot_at_ns=0)
    c.run(6.0)
    late = [s for s in c.samples if isinstance(s, AttitudeSample)][-100:]
    for s in late:
        yaw = 2.0 * math.atan2(s.q_ned_frd_wxyz[3], s.q_ned_frd_wxyz[0])
        error = math.remainder(yaw - turning(s.t_ns).euler_rad[2], 2.0 * math.pi)
        assert abs(math.degrees(error)) < 0.1  # 60 deg/s: 1.7 ms
        assert s.t_ns <= s.t_arrival_ns


def test_the_quaternion_silences_the_angles_while_it_comes() -> None:
    c = talk(PX4)
    c.run(3.0)
    c.samples.clear()
    c.run(1.0)
    attitudes = [s for s in c.samples if isinstance(s, AttitudeSample)]
    assert 85 <= len(attitudes) <= 115  # one kind at 100 Hz, not both


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


def test_a_reboot_restarts_clock_and_rates() -> None:
    c = talk(ARDUPILOT, boot_at_ns=0)
    c.run(5.0)
    c.autopilots[0].reboot(c.now_ns)
    c.run(4.0)
    status = c.session.status(c.now_ns)
    assert status.clock_restarts == 1
    assert status.clock.source is ClockSource.TIMESYNC
    assert status.attitude_hz > 80.0
    last = [s for s in c.samples if isinstance(s, AttitudeSample)][-1]
    assert 0 <= last.t_arrival_ns - last.t_ns < 10 * MS


def test_requests_of_the_autopilot_and_answers_of_others_leave_our_clock_alone() -> None:
    c = talk(PX4, boot_at_ns=0)
    other = SimulatedAutopilot(FirmwareProfile(kind=PX4, system_id=7, boot_at_ns=-5000 * NS))
    camera = SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, component_id=100, boot_at_ns=-300 * NS))
    c.autopilots += [other, camera]
    c.run(5.0)
    status = c.session.status(c.now_ns)
    assert status.vehicle is not None
    assert status.vehicle.system_id == 1
    assert status.clock_restarts == 0
    assert abs(status.clock.local_ns(c.autopilots[0].boot_ns(c.now_ns)) - c.now_ns) < 3 * MS
    assert status.counts["other_vehicle"] >= 4


def test_of_another_component_of_the_vehicle_no_state_attitude_or_time_is_used() -> None:
    """A gimbal or a camera has the system id of the vehicle."""
    alone = talk(PX4, boot_at_ns=0, answers_timesync=False)
    alone.run(12.0)
    c = talk(PX4, boot_at_ns=0, answers_timesync=False)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, component_id=100, boot_at_ns=0)))
    c.run(12.0)
    assert c.session.vehicle is not None
    assert c.session.vehicle.autopilot == PX4
    assert c.session.clock.estimate.source is ClockSource.ENVELOPE
    assert c.samples
    assert [s.t_ns for s in c.samples] == [s.t_ns for s in alone.samples]


def test_another_vehicle_takes_over_only_when_ours_is_silent() -> None:
    c = talk(PX4, boot_at_ns=0)
    c.autopilots.append(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT, system_id=7, boot_at_ns=50 * NS)))
    c.run(2.0)
    assert c.session.vehicle is not None
    assert c.session.vehicle.system_id == 1
    c.autopilots[0].silent = True
    c.run(5.0)
    assert c.session.vehicle.system_id == 7
    assert c.session.status(c.now_ns).clock.source is ClockSource.TIMESYNC


def test_the_clock_of_another_vehicle_is_estimated_anew() -> None:
    """Its boot time is half a second less: not enough for a reboot."""
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    c.autopilots[0] = SimulatedAutopilot(FirmwareProfile(kind=PX4, system_id=7, boot_at_ns=NS // 2))
    c.run(0.5)
    c.autopilots[0].silent = True
    c.run(3.5)
    c.autopilots[0].silent = False
    while c.session.vehicle is not None and c.session.vehicle.system_id != 7:
        c.run(0.001)
    assert c.session.status(c.now_ns).clock_restarts == 1


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_late_copy_of_a_heartbeat_brings_no_earlier_state_back(kind: str) -> None:
    """A network or a second route delivers it again, seconds later."""
    heartbeats: list[bytes] = []
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, armed=True, custom_mode=5))

    def keep(data: bytes, _: int) -> None:
        heartbeats.extend([data] if data[7:10] == b"\0\0\0" else [])

    c = Conversation(MavlinkSession(on_frame=keep), [autopilot])
    c.run(4.0)
    copies = tuple(heartbeats)
    assert len(copies) >= 4
    for armed, mode in ((True, 3), (False, 5)):
        autopilot.profile.armed, autopilot.profile.custom_mode = armed, mode
        c.run(1.5)
        vehicle = c.session.vehicle
        assert vehicle is not None
        assert (vehicle.armed, vehicle.custom_mode) == (armed, mode)
        c.session.post(set_px4_hold(1), c.now_ns, vehicle)
        c.session.receive([(data, c.now_ns) for data in copies])
        assert c.session.vehicle == vehicle
        assert c.session.has_posted
        sent = len(c.sent)
        c.run(0.01)
        assert "COMMAND_LONG" in Conversation(c.session, [], sent=c.sent[sent:]).kinds()
    assert c.session.status(c.now_ns).counts["late_heartbeat"] == 2 * len(copies)
    autopilot.profile.armed = True
    c.run(1.1)
    assert c.session.vehicle is not None
    assert c.session.vehicle.armed
    assert c.session.vehicle.custom_mode == 5  # of a new heartbeat, as before the copies


def test_whether_a_silent_vehicle_is_armed_is_known_only_if_it_was() -> None:
    c = talk(PX4)
    c.run(2.0)
    vehicle = c.session.vehicle
    assert vehicle is not None
    for armed, silent in ((False, None), (True, True)):
        c.session.vehicle = replace(vehicle, armed=armed)
        assert c.session.armed(c.now_ns) is armed
        assert c.session.armed(c.now_ns + 4 * NS) is silent
        assert not c.session.fell_silent(c.now_ns)
        assert c.session.fell_silent(c.now_ns + 4 * NS) is armed


def test_to_a_vehicle_that_fell_silent_in_flight_obstacles_are_still_sent() -> None:
    """Its messages are lost. It may still receive."""
    c = talk(PX4)
    c.run(2.0)
    vehicle = c.session.vehicle
    assert vehicle is not None
    for armed in (False, True):
        c.session.vehicle = replace(vehicle, armed=armed)
        later_ns = c.now_ns + 4 * NS
        c.session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [100] * 72, 5, 20, 1200, 5.0, 0.0, 12), later_ns)
        assert len(c.session.due(later_ns)) == armed


def test_a_configured_vehicle_is_the_only_one_received() -> None:
    c = talk(PX4, MavlinkParams(system_id=3))
    c.run(2.0)
    assert c.session.vehicle is None
    assert c.sent == []


def test_system_0_is_no_vehicle_since_commands_to_it_reach_all() -> None:
    """MAVLink takes target 0 for a broadcast."""
    c = talk(PX4, system_id=0)
    c.run(2.0)
    assert c.session.vehicle is None
    assert c.sent == []
    assert c.session.status(c.now_ns).counts["other_vehicle"] > 0
    expected = Vehicle(0, PX4, 2, True, 0, heartbeat_ns=0)
    c = talk(PX4, system_id=0)
    c.session = MavlinkSession(expected=expected)
    c.run(2.0)
    assert c.session.vehicle is None


def test_noise_between_messages_is_skipped_and_counted() -> None:
    c = talk(PX4)
    c.noise = b"\x00\xfd\x03noise"
    c.run(3.0)
    assert len([s for s in c.samples if isinstance(s, AttitudeSample)]) > 250  # 100 Hz: none is lost with the noise
    assert c.session.status(c.now_ns).counts["noise_bytes"] > 1000


def test_what_is_not_a_number_never_becomes_a_sample() -> None:
    still = (0.0, 0.0, 0.0)
    bad = VehicleState(
        position_ned_m=(math.nan, 0, 0), velocity_ned_m_s=still, euler_rad=(math.nan, 0, 0), rates_frd_rad_s=still
    )
    c = talk(PX4, motion=lambda _: bad)
    c.run(3.0)
    assert c.samples == []
    counts = c.session.status(c.now_ns).counts
    assert counts["attitude_non_finite"] > 50
    assert counts["position_non_finite"] > 20


def test_rates_that_are_not_numbers_leave_the_attitude() -> None:
    still = (0.0, 0.0, 0.0)
    bad = VehicleState(
        position_ned_m=still, velocity_ned_m_s=still, euler_rad=still, rates_frd_rad_s=(math.inf, 0.0, 0.0)
    )
    c = talk(PX4, motion=lambda _: bad)
    c.run(1.0)
    attitudes = [s for s in c.samples if isinstance(s, AttitudeSample)]
    assert attitudes
    assert all(s.rates_frd_rad_s is None for s in attitudes)


@pytest.mark.parametrize("absurd", [1e3, -1e6, 1e30])
def test_rates_and_velocities_that_nothing_flies_with_are_not_known(absurd: float) -> None:
    c = talk(PX4)
    c.run(2.0)
    boot_ms, mavlink = c.autopilots[0].boot_ns(c.now_ns) // MS, dialect.MAVLink(None, 1, 1)
    messages = [
        dialect.MAVLink_attitude_quaternion_message(boot_ms, 1.0, 0.0, 0.0, 0.0, 0.0, absurd, 0.0),
        dialect.MAVLink_local_position_ned_message(boot_ms, 1.0, 2.0, -3.0, 0.0, 0.0, absurd),
    ]
    attitude, pose = c.session.receive([(bytes(m.pack(mavlink)), c.now_ns + MS) for m in messages])
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(pose, PoseSample)
    assert attitude.rates_frd_rad_s is None
    assert pose.velocity_ned_m_s is None


def test_odometry_turns_its_velocity_into_ned_and_reports_jumps() -> None:
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    c.samples.clear()
    q = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))  # heading east
    nan = [math.nan] * 21
    boot_us = c.autopilots[0].boot_ns(c.now_ns) // 1000
    odometry = dialect.MAVLink_odometry_message(
        boot_us, 1, 12, 1.0, 2.0, -3.0, q, 4.0, 0.0, 0.0, 0, 0, 0, nan, nan, reset_counter=5, quality=80
    )
    other = dialect.MAVLink(None, 1, 1)
    assert c.session.receive([(odometry_at(c), c.now_ns + MS)]) == [], "its rate is not known"
    (pose,) = c.session.receive([(bytes(odometry.pack(other)), c.now_ns + MS)])
    assert isinstance(pose, PoseSample)
    assert pose.velocity_ned_m_s == pytest.approx((0.0, 4.0, 0.0), abs=1e-6)
    assert pose.reset_counter == 5
    odometry.quality = -1
    assert c.session.receive([(bytes(odometry.pack(other)), c.now_ns + 2 * MS)]) == []


def odometry_at(c: Conversation, frame_id: int = 1) -> bytes:
    """An ODOMETRY of the autopilot, now, at 1, 2, -3 m."""
    boot_us = c.autopilots[0].boot_ns(c.now_ns) // 1000
    nan = [math.nan] * 21
    q = (1.0, 0.0, 0.0, 0.0)
    message = dialect.MAVLink_odometry_message(boot_us, frame_id, 1, 1.0, 2.0, -3.0, q, 0, 0, 0, 0, 0, 0, nan, nan)
    return bytes(message.pack(dialect.MAVLink(None, 1, 1)))


def test_odometry_counts_while_the_autopilot_also_sends_a_valid_position() -> None:
    """PX4 fills ODOMETRY without a look at the validity of its estimate, which rests at one place when nothing supports it.
    LOCAL_POSITION_NED it sends only while position and velocity are valid."""
    c = talk(PX4, boot_at_ns=0)
    c.lost = frozenset({32})
    c.run(2.0)
    assert c.session.receive([(odometry_at(c), c.now_ns + MS)]) == []
    assert not any(isinstance(s, PoseSample) for s in c.samples)
    c.lost = frozenset()
    c.run(1.0)
    (pose,) = c.session.receive([(odometry_at(c), c.now_ns + MS)] * 2)  # the rate of the first is not known
    assert isinstance(pose, PoseSample)
    assert pose.position_ned_m == (1.0, 2.0, -3.0)
    c.lost = frozenset({32})
    c.run(1.1)
    assert c.session.receive([(odometry_at(c), c.now_ns + MS)]) == []
    assert c.session.status(c.now_ns).counts["odometry_unconfirmed"] == 2


@pytest.mark.parametrize(
    ("odometry_hz", "used"), [(1.0, False), (2.0, False), (4.0, False), (15.0, True), (30.0, True)]
)
def test_odometry_that_is_slower_than_the_position_does_not_replace_it(odometry_hz: float, used: bool) -> None:
    """At 2 Hz each one replaced the positions of the next 0.5 s, at 30 Hz: the vehicle's velocity was up to 0.5 s old."""
    c = talk(PX4)
    c.run(2.0)
    first = len(c.samples)
    start_ns = c.now_ns
    for k in range(round(3.0 * odometry_hz)):
        c.run((start_ns + round((k + 1) * NS / odometry_hz) - c.now_ns) / NS)
        c.samples += c.session.receive([(odometry_at(c), c.now_ns + MS)])
    poses = [s for s in c.samples[first:] if isinstance(s, PoseSample) and s.t_ns > start_ns + NS]
    gaps_ms = [(b.t_arrival_ns - a.t_arrival_ns) / MS for a, b in pairwise(poses)]
    assert max(gaps_ms) < 80.0
    assert any(s.position_ned_m == (1.0, 2.0, -3.0) for s in poses) is used
    assert len({s.position_ned_m == (1.0, 2.0, -3.0) for s in poses}) == 1, "of one kind"


def test_odometry_in_axes_that_do_not_point_north_is_refused() -> None:
    """Loopback of a visual odometry: its x points where the vehicle looked at the start, the attitude is from north."""
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    assert c.session.receive([(odometry_at(c, frame_id=20), c.now_ns + MS)]) == []
    assert len(c.session.receive([(odometry_at(c), c.now_ns + MS)] * 2)) == 1


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


@given(
    st.sampled_from([30, 31, 32]),
    st.integers(0, 2**32 - 1),
    st.lists(st.floats(width=32) | st.just(0.0), min_size=7, max_size=7),
    st.booleans(),
)
def test_motion_is_read_as_the_dialect_reads_it(kind: int, boot_ms: int, numbers: list[float], first: bool) -> None:
    """Also where the zeros at the end of a payload were not sent, and in MAVLink 1."""
    message = dialect.mavlink_map[kind](boot_ms, *numbers[: 7 if kind == 31 else 6])
    data = bytes(message.pack(dialect.MAVLink(None, 1, 1), force_mavlink1=first))
    (frame,) = MessageSplitter().frames(data)
    theirs = frame.message()
    names = [name for name in theirs.ordered_fieldnames if name != "repr_offset_q"]
    fields = motion_fields(frame)
    assert fields is not None
    np.testing.assert_array_equal(fields, [getattr(theirs, name) for name in names])


def warning(bytes_per_s: float | None, params: MavlinkParams | None = None, *, signed: bool = False) -> str:
    budget = budget_of(params or MavlinkParams(), bytes_per_s, signed=signed)
    return budget.warning() if budget is not None else ""


def test_a_slow_line_is_reported_with_the_rate_that_would_fit() -> None:
    assert warning(None) == ""
    assert warning(92_160.0) == ""
    text = warning(5_760.0)
    assert "the line of 57600 baud carries 5760 bytes/s" in text
    hz = int(text.rsplit("attitude_hz = ", 1)[1])
    assert 10 < hz < 40
    assert "attitude_hz" not in warning(5_760.0, MavlinkParams(attitude_hz=float(hz)))


@pytest.mark.parametrize("params", [MavlinkParams(attitude_hz=10, position_hz=5), MavlinkParams(attitude_hz=50)])
def test_a_line_below_230400_baud_is_reported_even_where_all_fits(params: MavlinkParams) -> None:
    assert "set 921600 baud" in warning(11_520.0, params)
    assert warning(23_040.0, params) == ""


def test_what_we_send_and_its_signatures_count() -> None:
    quiet, telling = (
        MavlinkParams(attitude_hz=5, position_hz=1),
        MavlinkParams(attitude_hz=5, position_hz=1, obstacles_hz=20),
    )
    budgets = [budget_of(p, 5_760.0, signed=s) for p, s in ((quiet, False), (telling, False), (telling, True))]
    out = [b.need_out for b in budgets if b is not None]
    assert out[1] - out[0] == pytest.approx(20 * (167 + 12))
    assert out[2] > out[1] + 20 * 13
    assert "each way" in warning(5_760.0, telling)


def test_points_and_distances_up_and_down_count_too() -> None:
    around = MavlinkParams(obstacles_hz=10)
    points = MavlinkParams(obstacles_hz=10, obstacle_points=30, distance_sensors=2)
    a, b = (budget_of(p, 92_160.0) for p in (around, points))
    assert a is not None
    assert b is not None
    assert b.need_out - a.need_out == pytest.approx(10 * (30 * (28 + 12) + 2 * (39 + 12) - (167 + 12)))


def test_messages_between_vehicles_count_in_both_directions() -> None:
    alone, team = MavlinkParams(), MavlinkParams(tunnel_bytes_per_s=300.0, neighbours=2)
    a, b = (budget_of(p, 92_160.0) for p in (alone, team))
    assert a is not None
    assert b is not None
    assert (b.need_in - a.need_in, b.need_out - a.need_out) == pytest.approx((600.0, 300.0))


def test_of_scans_of_points_and_of_distances_the_newest_alone_waits() -> None:
    """A scan is sent whole; an older one is outdated, whichever message it was sent in."""
    c = talk(ARDUPILOT)
    c.run(2.0)
    session = c.session

    def point(time_ms: int, x_m: float) -> None:
        session.post(
            dialect.MAVLink_obstacle_distance_3d_message(time_ms, 4, 12, 65535, x_m, 0.0, 0.0, 0.2, 12.0), c.now_ns
        )

    def sensor(orientation: int, cm: int) -> None:
        session.post(dialect.MAVLink_distance_sensor_message(0, 20, 1200, cm, 4, 1, orientation, 255), c.now_ns)

    session.post(dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns)
    for scan in range(3):
        for k in range(100):
            point(scan, 1.0 + scan + k / 100)
        sensor(24, 250 + scan)
        sensor(25, 150 + scan)
    c.run(0.1)
    autopilot = c.autopilots[0]
    points = autopilot.of_kind("OBSTACLE_DISTANCE_3D")
    assert [m.time_boot_ms for m in points] == [2] * 100
    assert [round(m.x, 2) for m in points] == [round(3.0 + k / 100, 2) for k in range(100)]
    assert [m.current_distance for m in autopilot.of_kind("DISTANCE_SENSOR")] == [252, 152]
    assert autopilot.of_kind("OBSTACLE_DISTANCE") == []


def test_the_budget_holds_what_a_line_carries() -> None:
    """The bytes that a session has sent to it and sends, against the figures."""
    some = (0.1, 0.2, 0.3)  # zeros at the end of a message are not sent
    moving = VehicleState(position_ned_m=some, velocity_ned_m_s=some, euler_rad=some, rates_frd_rad_s=some)
    c = talk(PX4, MavlinkParams(obstacles_hz=10.0), streams={}, boot_at_ns=90 * NS, motion=lambda _: moving)
    c.run(5.0)
    sent_before, received = len(b"".join(c.sent)), 0
    for step in range(1000):
        if step % 100 == 0:
            c.session.post(
                dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1200, 5.0, 0.0, 12), c.now_ns
            )
        c.now_ns += MS
        chunks = [(d, c.now_ns) for d in c.autopilots[0].due(c.now_ns)]
        received += sum(len(d) for d, _ in chunks)
        c.session.receive(chunks)
        for data in c.session.due(c.now_ns):
            c.sent.append(data)
            c.autopilots[0].receive(data, c.now_ns)
    budget = c.session.budget(92_160.0)
    assert budget is not None
    assert 0.75 * budget.need_in < received <= budget.need_in
    assert 0.5 * budget.need_out < len(b"".join(c.sent)) - sent_before <= budget.need_out


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"mavlink: attitude_hz = 0: expected 5.0..400.0 Hz"):
        MavlinkParams(attitude_hz=0)


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


# ---- 49.7 days ----------------------------------------------------------------------------------------------------

WRAP_NS = 2**32 * MS
"""time_boot_ms has 32 bits; TIMESYNC and ODOMETRY do not wrap."""


@pytest.mark.parametrize("answers", [True, False])
@pytest.mark.parametrize("up_ns", [WRAP_NS - 5 * NS, WRAP_NS + 3 * NS, 2 * WRAP_NS - 5 * NS])
def test_the_wrap_of_the_boot_time_is_no_reboot(up_ns: int, answers: bool) -> None:
    waits_s = 4.0 if answers else 12.0
    c = talk(PX4, motion=turning, boot_at_ns=100 * NS - up_ns + round((waits_s - 4.0) * NS))
    if not answers:
        c.lost = frozenset({111})
    c.run(waits_s)
    for _ in range(4):
        c.samples.clear()
        c.run(1.0)
        attitudes = [s for s in c.samples if isinstance(s, AttitudeSample)]
        assert len(attitudes) > 90
        for s in attitudes:
            yaw = 2.0 * math.atan2(s.q_ned_frd_wxyz[3], s.q_ned_frd_wxyz[0])
            late_s = math.remainder(math.radians(60.0) * s.t_ns / NS - yaw, math.tau) / math.radians(60.0)
            assert late_s == pytest.approx(0.0 if answers else 0.002, abs=0.0015)
    status = c.session.status(c.now_ns)
    assert status.clock_restarts == 0
    assert status.clock.source is (ClockSource.TIMESYNC if answers else ClockSource.ENVELOPE)


def test_a_reboot_after_two_months_is_one() -> None:
    c = talk(PX4, boot_at_ns=100 * NS - WRAP_NS - 864_000 * NS)
    c.run(4.0)
    c.autopilots[0].reboot(c.now_ns)
    c.samples.clear()
    c.run(3.0)
    assert c.session.status(c.now_ns).clock_restarts >= 1
    assert c.session.status(c.now_ns).clock.source is ClockSource.TIMESYNC
    assert any(isinstance(s, AttitudeSample) for s in c.samples)


def test_a_clock_in_doubt_is_asked_more_often() -> None:
    """As while NTP corrects the clock of this computer: until then answers came every half second."""
    c = talk(PX4, boot_at_ns=90 * NS)
    c.run(8.0)
    c.sent.clear()
    c.run(2.0)
    assert c.kinds().count("TIMESYNC") == 4
    clock = c.session.clock
    sent_ns = c.now_ns
    assert not clock.exchange(sent_ns, sent_ns - 90 * NS + 50 * MS, sent_ns + MS)
    c.sent.clear()
    c.run(1.0)
    assert 1 < c.kinds().count("TIMESYNC") < 5, "the next answer fits"
    c.lost = frozenset({111})
    assert not clock.exchange(sent_ns, sent_ns - 90 * NS + 50 * MS, sent_ns + MS)
    c.sent.clear()
    c.run(2.0)
    assert c.kinds().count("TIMESYNC") >= 16


def test_the_stated_rate_is_that_of_the_attitudes_that_are_used() -> None:
    """4 quaternions a second replace 50 ATTITUDE, and 50 were stated: no message said why frames were dropped."""
    session = MavlinkSession(MavlinkParams())
    encoder = dialect.MAVLink(None, 1, 1)
    heartbeat = bytes(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(encoder))
    session.receive([(heartbeat, 10 * NS)])
    for k in range(750):
        now_ns = 10 * NS + k * NS // 50
        chunk = bytes(dialect.MAVLink_attitude_message(k * 20, 1e-4 * k, 0, 0, 0, 0, 0).pack(encoder))
        if k % 12 == 0 and k < 700:
            better = dialect.MAVLink_attitude_quaternion_message(k * 20, 1, 1e-4 * k, 0, 0, 0, 0, 0)
            chunk += bytes(better.pack(encoder))
        session.receive([(chunk, now_ns)])
        if k == 699:
            assert session.status(now_ns).attitude_hz < 5.0
    assert session.status(now_ns).attitude_hz == pytest.approx(50.0, abs=1.0)

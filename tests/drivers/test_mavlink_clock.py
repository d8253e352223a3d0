"""The clock of a session: synchronisation, slow lines, reboots and the wrap of the boot time."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from core.types import AttitudeSample, PoseSample
from drivers.logs.codec import attitude_from_message, attitude_message, pose_from_message, pose_message
from drivers.mavlink.clock_sync import ClockFilter, ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.timesync import TimeSync
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile

from .conversation import MS, NS, talk, turning


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


def test_another_vehicle_leaves_the_clock_of_a_silent_one_alone() -> None:
    """Its boot time is half a second less: not enough for a reboot."""
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    before = c.session.status(c.now_ns).clock
    c.autopilots[0] = SimulatedAutopilot(FirmwareProfile(kind=PX4, system_id=7, boot_at_ns=NS // 2))
    c.samples.clear()
    c.run(8.0)
    status = c.session.status(c.now_ns)
    assert status.vehicle is not None
    assert (status.vehicle.system_id, status.clock_restarts) == (1, 0)
    assert (status.clock.offset_ns, status.clock.at_boot_ns) == (before.offset_ns, before.at_boot_ns)
    assert c.samples == []


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

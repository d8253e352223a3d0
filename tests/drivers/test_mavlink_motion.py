"""Attitude, position and odometry of a session: instants, values that cannot be, priority."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import AttitudeSample, PoseSample
from drivers.mavlink.dialect import dialect
from drivers.mavlink.motion import motion_fields
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import ARDUPILOT, PX4
from drivers.simulation.flight_path import VehicleState
from tests.nightly import nightly

from .conversation import MS, NS, Conversation, talk, turning


@pytest.mark.parametrize(("kind", "hz"), [(ARDUPILOT, 5.0), (ARDUPILOT, 200.0), (PX4, 200.0)])
def test_slow_and_quick_attitudes_stand_at_their_measurement(kind: str, hz: float) -> None:
    c = talk(kind, MavlinkParams(attitude_hz=hz), motion=turning, boot_at_ns=90 * NS)
    c.run(8.0)
    assert c.session.status(c.now_ns).attitude_hz == pytest.approx(hz, rel=0.1)
    for s in [s for s in c.samples if isinstance(s, AttitudeSample)][-10:]:
        yaw = 2.0 * math.atan2(s.q_ned_frd_wxyz[3], s.q_ned_frd_wxyz[0])
        assert abs(math.remainder(yaw - turning(s.t_ns).euler_rad[2], 2.0 * math.pi)) < math.radians(0.1)


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


@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (-0.0, 0.0, -0.0), (0.0, 0.0, 1e-6)])
def test_rates_of_zero_about_all_axes_were_not_filled_in(rates: tuple[float, float, float]) -> None:
    """Of an autopilot that sends no rates they carried attitudes to the exposure as if the vehicle did not turn."""
    c = talk(PX4)
    c.run(2.0)
    boot_ms, mavlink = c.autopilots[0].boot_ns(c.now_ns) // MS, dialect.MAVLink(None, 1, 1)
    messages = [
        dialect.MAVLink_attitude_quaternion_message(boot_ms, 0.6, 0.8, 0.0, 0.0, *rates),
        dialect.MAVLink_attitude_message(boot_ms + 600, 0.1, 0.2, 0.3, *rates),
    ]
    arrivals = (c.now_ns + MS, c.now_ns + 601 * MS)
    samples = c.session.receive([(bytes(m.pack(mavlink)), t) for m, t in zip(messages, arrivals, strict=True)])
    found = [s.rates_frd_rad_s for s in samples if isinstance(s, AttitudeSample)]
    assert found == ([pytest.approx(rates)] * 2 if any(rates) else [None, None])


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


def odometry_at(c: Conversation, frame_id: int = 1, estimator: int = 0) -> bytes:
    """An ODOMETRY of the autopilot, now, at 1, 2, -3 m."""
    boot_us = c.autopilots[0].boot_ns(c.now_ns) // 1000
    nan = [math.nan] * 21
    q = (1.0, 0.0, 0.0, 0.0)
    message = dialect.MAVLink_odometry_message(
        boot_us, frame_id, 1, 1.0, 2.0, -3.0, q, 0, 0, 0, 0, 0, 0, nan, nan, estimator_type=estimator
    )
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


@pytest.mark.parametrize(("estimator", "used"), [(0, True), (8, True), (2, False), (3, False), (6, False)])
def test_odometry_of_another_computer_that_the_autopilot_returns_is_refused(estimator: int, used: bool) -> None:
    """PX4 with MAV_ODOM_LP = 1 returns VISION_POSITION_ESTIMATE as ODOMETRY in ned: the origin is that of the other computer."""
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    assert len(c.session.receive([(odometry_at(c, estimator=estimator), c.now_ns + MS)] * 2)) == used
    assert ("odometry_unusable" in c.session.status(c.now_ns).counts) is not used


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


@pytest.mark.parametrize(("kind", "hz"), [(PX4, 5.0), (ARDUPILOT, 30.0), *nightly((PX4, 30.0), (ARDUPILOT, 5.0))])
@pytest.mark.parametrize("velocity_m_s", [(3.0, -0.2, 0.0), (0.0, 0.0, 0.2)])
def test_a_position_that_is_sent_again_with_new_stamps_is_not_used(
    kind: str, hz: float, velocity_m_s: tuple[float, float, float]
) -> None:
    """It counted as fresh, so that the merged world was displaced by up to 2 m until it began a section."""
    stopped_ns, back_ns = 110 * NS, 114 * NS

    def flight(now_ns: int) -> VehicleState:
        t_ns = stopped_ns if stopped_ns <= now_ns < back_ns else now_ns
        x, y, z = (v * t_ns / NS for v in velocity_m_s)
        still = (0.0, 0.0, 0.0)
        return VehicleState(
            position_ned_m=(x, y, z), velocity_ned_m_s=velocity_m_s, euler_rad=still, rates_frd_rad_s=still
        )

    c = talk(kind, MavlinkParams(position_hz=hz), boot_at_ns=90 * NS, motion=flight)
    c.run(9.9)
    assert "position_repeated" not in c.session.status(c.now_ns).counts
    c.run(3.0)
    poses = [s for s in c.samples if isinstance(s, PoseSample)]
    assert len(poses) > 5.0 * hz
    assert poses[-1].t_ns < stopped_ns + round(NS / hz) + 10 * MS  # the newest position, which no message had yet
    assert c.session.status(c.now_ns).counts["position_repeated"] > 2.0 * hz
    c.samples.clear()
    c.run(3.0)
    used = [s.t_ns for s in c.samples if isinstance(s, PoseSample)]
    assert min(used) > back_ns - 10 * MS
    assert max(used) > c.now_ns - round(NS / hz) - 100 * MS


def test_the_position_of_a_vehicle_at_rest_is_used() -> None:
    """A simulator without noise sends the same numbers all the time."""
    c = talk(PX4, boot_at_ns=90 * NS)
    c.run(10.0)
    assert sum(isinstance(s, PoseSample) and s.t_ns > 105 * NS for s in c.samples) > 100
    assert "position_repeated" not in c.session.status(c.now_ns).counts

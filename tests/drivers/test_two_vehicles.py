"""Two vehicles whose autopilots use the same ids on one line: no attitude of either is used."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest

from core.frames import quaternion_from_euler
from drivers.mavlink.clock_sync import ClockFilter
from drivers.mavlink.contradictory_attitude import LASTS_NS, ContradictoryAttitude
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session_types import ATTITUDE_ID, PX4
from drivers.mavlink.timesync import TimeSync
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState
from tests.nightly import nightly

from .conversation import MS, NS, Conversation, talk, turning


def leaning(now_ns: int) -> VehicleState:
    """The other vehicle: it turns, too, with another heading and attitude."""
    state = turning(now_ns)
    return dataclasses.replace(state, euler_rad=(0.3, -0.2, math.remainder(state.euler_rad[2] + 1.0, math.tau)))


def two(after_s: float, *, answers: tuple[bool, bool], other_first: bool = False) -> Conversation:
    """after_s: start of the other autopilot, after ours; answers: whether ours and the other answer TIMESYNC."""
    c = talk(PX4, motion=turning, boot_at_ns=50 * NS, answers_timesync=answers[0])
    other = FirmwareProfile(
        kind=PX4, motion=leaning, boot_at_ns=50 * NS + round(after_s * NS), answers_timesync=answers[1]
    )
    c.autopilots.insert(0 if other_first else 1, SimulatedAutopilot(other))
    return c


BOTH, NEITHER = (True, True), (False, False)
DAILY = [
    *[(after_s, BOTH, after_s < 0.1) for after_s in (-400.0, -0.3, 0.03, 0.3, 5.0)],
    *[(-0.3, NEITHER, False), (0.03, NEITHER, True), (40.0, NEITHER, False)],
]
"""The other one started earlier, at nearly the same time and later, it answers first or second, or neither answers."""
AFTER_S = (-400.0, -5.0, -0.3, -0.03, 0.03, 0.3, 5.0, 40.0)
OTHERS = [case for case in itertools.product(AFTER_S, (BOTH, NEITHER), (False, True)) if case not in DAILY]


@pytest.mark.parametrize(("after_s", "answers", "other_first"), [*DAILY, *nightly(*OTHERS)])
def test_attitudes_of_two_vehicles_are_not_used(after_s: float, answers: tuple[bool, bool], other_first: bool) -> None:
    """Used were those of both in turns where one had started less than a second after the other, and where the other one
    answered first; without answers those of the vehicle whose clock was ahead."""
    c = two(after_s, answers=answers, other_first=other_first)
    c.run(1.0 if all(answers) else 10.5)
    c.samples.clear()
    c.run(3.0)
    assert c.samples == []
    (text,) = c.session.status(c.now_ns).conflicts.values()
    assert "two vehicles use the same ids" in text or (
        not all(answers) and "contradictory autopilot timestamps" in text
    )


@pytest.mark.parametrize("after_s", [-0.03, 0.3])
def test_attitudes_of_a_second_vehicle_that_answers_nothing_are_recognised(after_s: float) -> None:
    c = two(after_s, answers=(True, False))
    c.run(LASTS_NS / NS + 1.5)
    c.samples.clear()
    c.run(2.0)
    refused = after_s < 0.0  # its stamps are ahead, so that no message of it is used
    assert bool(c.samples) is refused
    assert set(c.session.status(c.now_ns).conflicts) & {"two autopilots", "two clocks"}


def test_attitudes_are_used_again_when_the_other_vehicle_has_left() -> None:
    c = two(0.3, answers=(True, True))
    c.run(3.0)
    c.autopilots.pop()
    c.run(LASTS_NS / NS + 1.0)
    c.samples.clear()
    c.run(1.0)
    assert len(c.samples) > 100
    assert c.session.status(c.now_ns).conflicts == {}


def answer(sync: TimeSync, ts1_ns: int, tc1_ns: int, arrival_ns: int) -> None:
    message = dialect.MAVLink_timesync_message(tc1=tc1_ns, ts1=ts1_ns)
    (frame,) = MessageSplitter().frames(bytes(message.pack(dialect.MAVLink(None, 1, 1))))
    sync.take(frame, arrival_ns, from_autopilot=True)


@pytest.mark.parametrize(
    ("second_ms", "arrival_ms", "two_clocks"),
    [(2, 9, False), (200, 210, False), (8, 9, False), (30, 9, True), (-30, 9, True), (2, 2, False)],
)
def test_two_answers_of_one_clock_lie_between_the_request_and_the_later_one(
    second_ms: int, arrival_ms: int, two_clocks: bool
) -> None:
    """A request that a router passes on by two routes is answered twice."""
    sync = TimeSync(ClockFilter())
    sync.due(100 * NS)
    answer(sync, 100 * NS, 7 * NS + 2 * MS, 100 * NS + 4 * MS)
    answer(sync, 100 * NS, 7 * NS + second_ms * MS, 100 * NS + arrival_ms * MS)
    assert sync.two_clocks_answer(100 * NS + arrival_ms * MS) is two_clocks
    assert not sync.two_clocks_answer(111 * NS)


@pytest.mark.parametrize("hz", [4, 10, 100])
def test_resets_of_the_heading_and_late_messages_are_no_second_vehicle(hz: int) -> None:
    """A turn up to 300 degrees a second that begins and ends within a second, two resets within two seconds, each second message
    later than the next one."""
    found = ContradictoryAttitude()
    order = [k + 1 if k % 4 == 1 else k - 1 if k % 4 == 2 else k for k in range(4 * hz)]
    for n, k in enumerate(order):
        t_s = k / hz
        rate_rad_s = math.radians(150.0) * (1.0 - math.cos(math.tau * t_s))
        yaw = math.radians(150.0) * (t_s - math.sin(math.tau * t_s) / math.tau) + (t_s > 1.0) + (t_s > 2.5)
        q = quaternion_from_euler(0.1, 0.1, math.remainder(yaw, math.tau))
        found.take(round(t_s * NS), n * NS // hz, q, (0.0, 0.0, rate_rad_s))
        assert not found.found(n * NS // hz)


@pytest.mark.parametrize("hz", [4, 5, 6, 8, 10, 20])
def test_quick_movements_between_messages_are_no_second_vehicle(hz: int) -> None:
    """The vehicle rests at each message. Between them it rolls, by turns to both sides, up to 220 degrees a second that it reaches
    and ends with 38 rad/s^2."""
    found = ContradictoryAttitude()
    peak_rad_s = min(math.radians(220.0), 38.0 / (2 * hz))
    moved_rad = peak_rad_s / hz - peak_rad_s**2 / 38.0
    for k in range(4 * hz):
        t_ns = k * NS // hz
        found.take(t_ns, t_ns, quaternion_from_euler(moved_rad * (k % 2), 0.1, 0.0), (0.0, 0.0, 0.01))
        assert not found.found(t_ns)


def test_messages_of_a_slow_route_around_one_reset_are_no_second_vehicle() -> None:
    """The heading is reset at 1 s. The quick route loses the ten messages before the reset, which a slow route delivers later."""
    found = ContradictoryAttitude()
    for n, k in enumerate([*range(40), *range(50, 60), *range(40, 50), *range(60, 100)]):
        yaw = 1.0 if k >= 50 else 0.0
        found.take(k * 20 * MS, n * 20 * MS, quaternion_from_euler(0.1, 0.1, yaw), (0.0, 0.0, 0.01))
        assert not found.found(n * 20 * MS)


def test_kinds_of_attitude_that_differ_are_no_second_vehicle() -> None:
    """Older versions of ArduPilot correct ATTITUDE by AHRS_TRIM, and not ATTITUDE_QUATERNION. Until stamps are used, both are examined."""
    c = talk(PX4, motion=turning, boot_at_ns=0, answers_timesync=False)
    c.lost = frozenset({ATTITUDE_ID})
    for _ in range(12 * 50):
        c.run(0.02)
        state, boot_ms = turning(c.now_ns), c.autopilots[0].boot_ns(c.now_ns) // MS
        trimmed = (math.radians(5.0), 0.0, state.euler_rad[2])
        attitude = dialect.MAVLink_attitude_message(boot_ms, *trimmed, *state.rates_frd_rad_s)
        c.session.receive([(bytes(attitude.pack(dialect.MAVLink(None, 1, 1))), c.now_ns + c.delay_ns)])
    assert c.session.status(c.now_ns).conflicts == {}
    assert len(c.samples) > 50


def test_a_reboot_is_no_second_vehicle() -> None:
    found = ContradictoryAttitude()
    for start_ns, roll in ((100 * NS, 0.0), (0, 0.5), (0, 1.0)):
        for k in range(300):
            found.take(start_ns + k * 10 * MS, k * 10 * MS, quaternion_from_euler(roll, 0.0, 0.0), (0.0, 0.0, 0.0))
            assert not found.found(k * 10 * MS)


def test_a_second_reboot_is_no_second_vehicle() -> None:
    """ATTITUDE is decoded only until ATTITUDE_QUATERNION arrives. Those after the second boot were compared with those after the first
    one, since their stamps are as near."""
    found = ContradictoryAttitude()
    for boot, heading_rad in ((0, 0.0), (60, 2.0)):
        for k in range(20):
            arrival_ns = boot * NS + k * 20 * MS
            found.take(NS + k * 20 * MS, arrival_ns, quaternion_from_euler(0.0, 0.0, heading_rad), None)
            assert not found.found(arrival_ns), (boot, k)

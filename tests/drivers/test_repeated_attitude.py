"""Attitudes of an earlier time with new timestamps are not used."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import AttitudeSample
from drivers.mavlink.motion import motion_fields
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.repeated_attitude import FEWEST, LONGEST_NS, WINDOW_NS, RepeatedAttitude
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import ARDUPILOT, PX4

from .test_mavlink_session import Conversation, talk

MS, NS = 1_000_000, 1_000_000_000
STILL = (0.0, 0.0, 0.0)


def attitudes(c: Conversation) -> list[AttitudeSample]:
    return [s for s in c.samples if isinstance(s, AttitudeSample)]


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("hz", [20.0, 100.0])
def test_an_attitude_that_is_sent_again_with_new_stamps_is_not_used(kind: str, hz: float) -> None:
    """It counted as fresh for as long as it arrived."""
    failed_ns, back_ns = 110 * NS, 114 * NS
    c = talk(
        kind,
        MavlinkParams(attitude_hz=hz),
        boot_at_ns=90 * NS,
        repeats_attitude=lambda now_ns: failed_ns <= now_ns < back_ns,
    )
    c.run(9.9)
    assert not c.session.status(c.now_ns).attitude_repeated
    assert "attitude_repeated" not in c.session.status(c.now_ns).counts
    c.run(3.0)
    newest = attitudes(c)[-1]
    assert newest.t_ns < failed_ns + LONGEST_NS + 2 * round(NS / hz)
    status = c.session.status(c.now_ns)
    assert status.attitude_repeated
    assert status.counts["attitude_repeated"] > 2.0 * hz
    assert status.clock.source.name == "TIMESYNC"  # its stamps are right
    c.samples.clear()
    c.run(3.0)
    used = [s.t_ns for s in attitudes(c)]
    assert min(used) > back_ns + WINDOW_NS - 200 * MS
    assert max(used) > c.now_ns - 100 * MS
    assert not c.session.status(c.now_ns).attitude_repeated


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_vehicle_at_rest_is_not_one_that_repeats_its_attitude(kind: str) -> None:
    c = talk(kind, boot_at_ns=90 * NS)
    c.run(20.0)
    assert "attitude_repeated" not in c.session.status(c.now_ns).counts
    assert len(attitudes(c)) > 400


def test_repeated_rates_that_turn_the_vehicle_are_noticed_sooner() -> None:
    slow, fast = RepeatedAttitude(), RepeatedAttitude()
    angles, turning = (0.1, 0.2, 0.3), (0.0, 0.0, math.radians(60.0))
    found = [(slow.take(k * 10 * MS, angles, STILL), fast.take(k * 10 * MS, angles, turning)) for k in range(20)]
    assert [s for s, _ in found].index(True) == 10
    assert [f for _, f in found].index(True) == FEWEST


def test_a_relay_that_repeats_slow_attitudes_is_noticed() -> None:
    """Each message three times: none of them is older than 60 ms, and all of them have wrong stamps."""
    detector = RepeatedAttitude()
    found = [detector.take(k * 20 * MS, (0.01 * (k // 3), 0.0, 0.0), STILL) for k in range(200)]
    assert found.index(True) < 12
    assert all(found[12:])


def test_copies_and_late_messages_are_no_repetitions() -> None:
    detector = RepeatedAttitude()
    for k in range(400):
        for stamp in (k, k, max(0, k - 3)):
            assert not detector.take(stamp * 20 * MS, (0.001 * stamp, 0.0, 0.0), STILL)


def test_after_a_reboot_the_count_begins_again() -> None:
    detector = RepeatedAttitude()
    assert any(detector.take(k * 20 * MS + 90 * NS, (0.0, 0.0, 0.0), STILL) for k in range(20))
    assert not any(detector.take(k * 20 * MS, (0.001 * k, 0.0, 0.0), STILL) for k in range(200))


@given(st.lists(st.tuples(st.integers(1, 200), st.booleans()), min_size=1, max_size=60))
def test_the_rule_by_its_definition(steps: list[tuple[int, bool]]) -> None:
    """Against a slow form: all repetitions are kept and counted anew for each message."""
    detector, repeats, repeated, stamp, angle = RepeatedAttitude(), [], False, 5000, 0.0
    detector.take(stamp * MS, (angle,), STILL)
    for since_ms, same in steps:
        stamp, angle = stamp + since_ms, angle if same else angle + 1.0
        if same:
            repeats.append((stamp, since_ms))
        within = [since for at, since in repeats if stamp - at < 1000]
        repeated = bool(within) and (repeated or (len(within) >= 2 and sum(within) >= 100))
        assert detector.take(stamp * MS, (angle,), STILL) is repeated


def test_no_recorded_attitude_is_refused(shared_data: Path) -> None:
    """Real vehicles, and ArduCopter in SITL on the ground and in flight."""
    checked = 0
    for path in sorted((shared_data / "mavlink").glob("*.tlog")):
        detectors: dict[tuple[int, int, int], RepeatedAttitude] = {}
        data = path.read_bytes()
        for frame in MessageSplitter().frames(data):
            fields = motion_fields(frame)
            if frame.id in (30, 31) and fields is not None:
                detector = detectors.setdefault((frame.system, frame.component, frame.id), RepeatedAttitude())
                assert not detector.take(int(fields[0]) * MS, fields[1:-3], fields[-3:]), path
                assert not detector._repeats, path
                checked += 1
    assert checked > 25_000

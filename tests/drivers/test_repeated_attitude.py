"""Attitudes of an earlier time with new timestamps are not used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import AttitudeSample
from drivers.mavlink.motion import motion_fields
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.repeated_attitude import WINDOW_NS, RepeatedAttitude
from drivers.mavlink.session_types import MavlinkParams
from drivers.simulation.autopilot import ARDUPILOT, PX4

from .conversation import Conversation, talk

MS, NS = 1_000_000, 1_000_000_000


def attitudes(c: Conversation) -> list[AttitudeSample]:
    return [s for s in c.samples if isinstance(s, AttitudeSample)]


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("hz", [20.0, 100.0])
def test_an_attitude_that_is_sent_again_with_new_stamps_is_not_used(kind: str, hz: float) -> None:
    """It counted as fresh for as long as it arrived, then for 0.2 s."""
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
    assert newest.t_ns < failed_ns + round(NS / hz)  # the newest angles, which no message had yet
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


def test_attitudes_of_an_external_estimator_are_used_once() -> None:
    """ArduPilot sends 100 a second; EAHRS_RATE is 50 as delivered. All were refused, for as long as the vehicle ran."""
    detector = RepeatedAttitude()
    for k in range(1000):
        turn = 0.01 * (k // 2)
        assert detector.take(k * 10 * MS, (turn, 0.0, 0.0)) is (k % 2 == 1)
        assert not detector.repeated


@pytest.mark.parametrize("seed", range(5))
def test_an_external_estimator_may_have_jitter_and_lose_messages(seed: int) -> None:
    """50 estimates a second, 7 ms late at most, of which every tenth is lost, on a serial line from it to the autopilot."""
    rng, detector = np.random.default_rng(seed), RepeatedAttitude()
    arrivals_ms = np.arange(1000) * 20.0 + rng.uniform(0.0, 7.0, 1000)
    arrivals_ms = arrivals_ms[rng.random(1000) > 0.1]
    used = 0
    for k in range(10, 1990):
        estimate = int(np.searchsorted(arrivals_ms, k * 10.0))
        used += not detector.take(k * 10 * MS, (0.01 * estimate, 0.0, 0.0))
        assert not detector.repeated
    assert used > 800


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_vehicle_with_a_slower_estimator_is_not_blind(kind: str) -> None:
    """Each attitude is sent up to twice."""
    c = talk(
        kind,
        MavlinkParams(attitude_hz=100.0),
        boot_at_ns=90 * NS,
        repeats_attitude=lambda now_ns: now_ns // MS % 20 >= 10,
    )
    c.run(20.0)
    used = [s.t_ns for s in attitudes(c)]
    assert len(used) > 500
    assert max(np.diff(used)) < 50 * MS
    assert not c.session.status(c.now_ns).attitude_repeated


def test_no_repetition_is_used_until_all_are_refused() -> None:
    detector = RepeatedAttitude()
    found = []
    for k in range(20):
        found.append(detector.take(k * 10 * MS, (0.1, 0.2, 0.3)))
        assert detector.repeated is (k >= 13)
    assert found == [k > 0 for k in range(20)]


def test_a_relay_that_repeats_slow_attitudes_is_noticed() -> None:
    """Each message three times: none of them is older than 60 ms, and all of them have wrong stamps."""
    detector = RepeatedAttitude()
    found = [detector.take(k * 20 * MS, (0.01 * (k // 3), 0.0, 0.0)) for k in range(200)]
    assert found[:15] == [k % 3 > 0 for k in range(14)] + [True]
    assert all(found[14:])


def test_copies_and_late_messages_are_no_repetitions() -> None:
    detector = RepeatedAttitude()
    for k in range(400):
        for stamp in (k, k, max(0, k - 3)):
            assert not detector.take(stamp * 20 * MS, (0.001 * stamp, 0.0, 0.0))


def test_a_copy_of_a_repetition_is_not_used_either() -> None:
    """As over a second route: it has the stamp of the one before."""
    detector = RepeatedAttitude()
    angles = (0.1, 0.2, 0.3)
    assert [detector.take(ms * MS, angles) for ms in (100, 110, 110, 100, 120, 110)] == [
        False,
        True,
        True,
        False,
        True,
        True,
    ]


def test_after_a_reboot_the_count_begins_again() -> None:
    detector = RepeatedAttitude()
    assert any(detector.take(k * 20 * MS + 90 * NS, (0.0, 0.0, 0.0)) for k in range(20))
    assert not any(detector.take(k * 20 * MS, (0.001 * k, 0.0, 0.0)) for k in range(200))


@given(st.lists(st.tuples(st.integers(1, 200), st.booleans()), min_size=1, max_size=60))
def test_the_rule_by_its_definition(steps: list[tuple[int, bool]]) -> None:
    """Against a slow form: all repetitions are kept and counted anew for each message."""
    detector, repeats, repeated, stamp, angle = RepeatedAttitude(), [], False, 5000, 0.0
    detector.take(stamp * MS, (angle,))
    first = stamp
    for since_ms, same in steps:
        stamp, angle = stamp + since_ms, angle if same else angle + 1.0
        first = first if same else stamp
        if stamp - first > 35:
            repeats.append((stamp, since_ms))
        within = [since for at, since in repeats if stamp - at < 1000]
        repeated = bool(within) and (repeated or (len(within) >= 2 and sum(within) >= 100))
        assert detector.take(stamp * MS, (angle,)) is (repeated or same)
        assert detector.repeated is repeated


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
                assert not detector.take(int(fields[0]) * MS, fields[1:-3]), path
                assert not detector._repeats, path
                checked += 1
    assert checked > 25_000

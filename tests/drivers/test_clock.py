"""The clock filter against a simulated link: the truth is always inside the stated bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.mavlink.clock_sync import NS, ClockFilter, ClockParams, ClockSource

MS = 1_000_000


@dataclass
class Link:
    """An autopilot whose clock runs `drift` fast of ours from boot_at on, behind a link with random delays."""

    drift: float = 50e-6
    boot_at_ns: int = -1_000 * NS
    least_delay_ns: int = 300_000
    jitter_ns: int = 5 * MS
    seed: int = 0

    def __post_init__(self) -> None:
        self.rng = np.random.Generator(np.random.PCG64(self.seed))

    def boot(self, local_ns: int) -> int:
        return round((local_ns - self.boot_at_ns) * (1.0 + self.drift))

    def local(self, boot_ns: int) -> float:
        return boot_ns / (1.0 + self.drift) + self.boot_at_ns

    def delay(self) -> int:
        return self.least_delay_ns + int(self.rng.exponential(0.3) * self.jitter_ns)

    def exchange(self, clock: ClockFilter, sent_ns: int) -> bool:
        there = sent_ns + self.delay()
        return clock.exchange(sent_ns, self.boot(there) // 1000 * 1000, there + self.delay())

    def attitude(self, clock: ClockFilter, measured_ns: int) -> None:
        clock.arrival(self.boot(measured_ns) // MS * MS, measured_ns + self.delay())

    def error_ns(self, clock: ClockFilter, boot_ns: int) -> float:
        return clock.estimate.local_ns(boot_ns) - self.local(boot_ns)


def run(link: Link, clock: ClockFilter, seconds: float, hz: float = 10.0, start_ns: int = 0) -> list[float]:
    errors = []
    for k in range(int(seconds * hz)):
        now = start_ns + int(k * NS / hz)
        link.exchange(clock, now)
        link.attitude(clock, now + 10 * MS)
        if clock.estimate.source is ClockSource.TIMESYNC:
            errors.append(link.error_ns(clock, link.boot(now)))
    return errors


def test_nothing_is_known_before_anything_came() -> None:
    assert ClockFilter().estimate.source is ClockSource.NONE


def test_it_is_synchronised_within_two_seconds_at_ten_exchanges_a_second() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 0.5)
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert clock.estimate.bound_ns is not None
    assert clock.estimate.bound_ns < 5 * MS


def test_under_jitter_and_drift_the_error_is_well_below_a_millisecond() -> None:
    errors = np.abs(run(Link(), ClockFilter(), 120.0))
    assert np.median(errors) < 0.3 * MS
    assert errors[100:].max() < 1.0 * MS


def test_the_drift_of_the_crystals_is_found() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 60.0)
    assert clock.estimate.drift == pytest.approx(-50e-6, abs=5e-6)


@settings(max_examples=40, deadline=None)
@given(
    drift=st.floats(-120e-6, 120e-6),
    least=st.integers(0, 20 * MS),
    jitter=st.integers(0, 40 * MS),
    seed=st.integers(0, 1000),
)
def test_the_truth_lies_inside_the_bound(drift: float, least: int, jitter: int, seed: int) -> None:
    clock, link = ClockFilter(), Link(drift=drift, least_delay_ns=least, jitter_ns=jitter, seed=seed)
    for k in range(60):
        now = k * NS // 10
        link.exchange(clock, now)
        e = clock.estimate
        if e.source is ClockSource.TIMESYNC:
            assert e.bound_ns is not None
            assert abs(link.error_ns(clock, e.at_boot_ns)) <= e.bound_ns + 1000  # tc1 comes in whole microseconds
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert clock.strange == 0


def test_a_one_sided_delay_is_inside_the_bound_too() -> None:
    clock = ClockFilter()
    for k in range(20):
        sent = k * NS // 10
        clock.exchange(sent, sent + 5 * NS + 8 * MS, sent + 8 * MS)  # 8 ms there, none back
    e = clock.estimate
    assert e.bound_ns is not None
    assert abs(e.offset_ns + 5 * NS) <= e.bound_ns


def test_without_answers_the_quickest_arrival_is_used_and_reported() -> None:
    clock, link = ClockFilter(), Link()
    for k in range(200):
        link.attitude(clock, k * NS // 50)
    e = clock.estimate
    assert e.source is ClockSource.ENVELOPE
    assert e.bound_ns is None
    late = link.error_ns(clock, e.at_boot_ns)
    assert 0 <= late < 3 * MS


def test_arrivals_sharpen_a_slow_exchange() -> None:
    """Answers take 40 ms each way; attitudes that need 1 ms bound the offset from above."""
    slow, both = ClockFilter(), ClockFilter()
    far = Link(least_delay_ns=40 * MS, jitter_ns=0)
    quick = Link(least_delay_ns=MS, jitter_ns=0)
    for k in range(30):
        far.exchange(slow, k * NS // 10)
        far.exchange(both, k * NS // 10)
        quick.attitude(both, k * NS // 10)
    assert slow.estimate.bound_ns is not None
    assert both.estimate.bound_ns is not None
    assert both.estimate.bound_ns <= slow.estimate.bound_ns + MS


def test_a_reboot_starts_over() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 5.0)
    again = Link(boot_at_ns=6 * NS, seed=1)
    for k in range(5):
        assert clock.restarts == 0
        again.attitude(clock, 8 * NS + k * 10 * MS)
    assert clock.restarts == 1
    assert clock.estimate.source is ClockSource.ENVELOPE
    run(again, clock, 2.0, start_ns=8 * NS)
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert abs(again.error_ns(clock, again.boot(10 * NS))) < 5 * MS


def test_a_message_a_second_late_is_no_reboot() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 5.0)
    for k in range(20):
        assert not clock.arrival(link.boot(3 * NS + k * 10 * MS), 5 * NS + k * 10 * MS)
        assert clock.arrival(link.boot(5 * NS + k * 10 * MS), 5 * NS + k * 10 * MS + MS)
    assert clock.restarts == 0


def test_a_single_contradiction_changes_nothing() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    before = clock.estimate
    assert not clock.exchange(5 * NS, link.boot(5 * NS) + 300 * MS, 5 * NS + MS)
    assert clock.strange == 1
    assert clock.estimate == before


def test_a_step_that_lasts_is_followed() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    stepped = Link(jitter_ns=MS, boot_at_ns=link.boot_at_ns - 300 * MS, seed=2)
    errors = run(stepped, clock, 3.0, start_ns=5 * NS)
    assert clock.restarts == 1
    assert abs(errors[-1]) < 2 * MS


def test_contradictions_that_disagree_with_each_other_are_no_step() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    before = clock.estimate
    for k in range(6):
        sent = 5 * NS + k * NS // 10
        assert not clock.exchange(sent, link.boot(sent) + (200 + 50 * (-1) ** k) * MS, sent + MS)
    assert clock.restarts == 0
    assert clock.estimate == before


def test_a_late_answer_and_one_from_the_future_are_not_used() -> None:
    clock = ClockFilter()
    assert not clock.exchange(0, 0, 600 * MS)
    assert not clock.exchange(100, 0, 50)
    assert clock.slow == 2
    assert clock.estimate.source is ClockSource.NONE


def test_an_old_window_is_forgotten() -> None:
    clock, link = ClockFilter(ClockParams(window_s=5.0)), Link(jitter_ns=MS)
    run(link, clock, 60.0, hz=2.0)
    assert clock.estimate.exchanges <= 11


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"clock: window_s = 0.1: expected 2.0..600.0 s"):
        ClockParams(window_s=0.1)

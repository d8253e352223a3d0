"""The clock filter against a simulated link: the truth is always inside the stated bound."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.mavlink.clock_bounds import MAX_DRIFT, NS
from drivers.mavlink.clock_sync import ClockFilter, ClockSource
from tests.nightly import examples, first

from .clock_exchange import MS, Link, run


def test_nothing_is_known_before_anything_came() -> None:
    assert ClockFilter().estimate.source is ClockSource.NONE


def test_it_is_synchronised_within_two_seconds_at_ten_exchanges_a_second() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 0.5)
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert clock.estimate.bound_ns is not None
    assert clock.estimate.bound_ns < 5 * MS


@pytest.mark.parametrize("seed", first(3, range(10)))
def test_the_drift_stays_within_its_limit(seed: int) -> None:
    clock, link = ClockFilter(), Link(jitter_ns=50 * MS, seed=seed)
    for k in range(20):
        run(link, clock, 0.5, hz=2.0, start_ns=k * NS // 2)
        assert abs(clock.estimate.drift) <= MAX_DRIFT


def test_after_a_long_time_a_step_back_is_a_reboot_and_no_wrap() -> None:
    clock, days_ns = ClockFilter(), 30 * 86_400 * NS
    clock.arrival(days_ns, days_ns + NS)
    assert clock.boot_ns(5_000) == 5 * NS


def test_under_jitter_and_drift_the_error_is_well_below_a_millisecond() -> None:
    errors = np.abs(run(Link(), ClockFilter(), 40.0))
    assert np.median(errors) < 0.3 * MS
    assert errors[100:].max() < 1.0 * MS


def test_the_drift_of_the_crystals_is_found() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 60.0)
    assert clock.estimate.drift == pytest.approx(-50e-6, abs=5e-6)


@examples(1.5)
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
        assert not clock.doubted
    assert clock.estimate.source is ClockSource.TIMESYNC


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


@pytest.mark.parametrize("ahead_ns", [40 * MS, 400 * MS, 400 * NS])
@pytest.mark.parametrize("at", [0, 300])
def test_without_answers_a_single_stamp_of_the_future_does_not_move_the_clock(ahead_ns: int, at: int) -> None:
    """It shifted the estimate by as much for a minute."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    for k in range(600):
        now = k * 20 * MS
        if k == at:
            used = clock.arrival(link.boot(now) + ahead_ns, now + MS)
            assert used == (at == 0), "the first stamp has nothing to contradict"
        link.attitude(clock, now)
        if k > at + 100:
            assert abs(link.error_ns(clock, link.boot(now))) < 2 * MS


@pytest.mark.parametrize("hz", [4, 50])
@pytest.mark.parametrize("delay_ns", [60 * MS, 200 * MS, 900 * MS])
def test_without_answers_a_line_that_becomes_faster_is_no_restart(hz: int, delay_ns: int) -> None:
    """As after the parameters were sent. Before, all was discarded: no stamp was used for 2.5 to 3.5 s, a restart of the
    autopilot's clock was counted, and rates were requested again."""
    clock, slow = ClockFilter(), Link(drift=0.0, least_delay_ns=delay_ns, jitter_ns=MS)
    for k in range(12 * hz):
        slow.attitude(clock, k * NS // hz)
    assert clock.usable
    fast, refused = Link(drift=0.0, least_delay_ns=5 * MS, jitter_ns=MS, seed=1), 0
    for k in range(12 * hz, 20 * hz):
        now_ns = k * NS // hz + delay_ns
        used = clock.arrival(fast.boot(now_ns) // MS * MS, now_ns + fast.delay())
        assert clock.usable
        refused += not used
        if used:
            assert abs(fast.error_ns(clock, fast.boot(now_ns))) < 10 * MS
    assert clock.restarts == 0
    assert refused <= max(5, 0.5 * hz + 1)


def test_without_answers_a_step_of_more_than_a_second_is_a_restart() -> None:
    """As after the companion computer was suspended: its clock stood still."""
    clock, link = ClockFilter(), Link(drift=0.0)
    for k in range(400):
        link.attitude(clock, k * 20 * MS)
    for k in range(400, 600):
        now_ns = k * 20 * MS
        clock.arrival(link.boot(now_ns) + 3 * NS, now_ns + MS)
    assert clock.restarts == 1


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
    assert not clock.mixed(10 * NS)
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert abs(again.error_ns(clock, again.boot(10 * NS))) < 5 * MS


@pytest.mark.parametrize("reboots", [False, True])
@pytest.mark.parametrize("seed", first(2, range(5)))
def test_no_stamp_is_used_before_the_delay_of_the_line_is_known(reboots: bool, seed: int) -> None:
    """The first arrivals on a full line are delayed by any time: for 0.3 s stamps were late by up to 58 ms, and the
    stated error was 30 ms."""
    clock, link, begin_ns = ClockFilter(), Link(least_delay_ns=5 * MS, jitter_ns=60 * MS, seed=seed), 0
    if reboots:
        run(link, clock, 5.0)
        begin_ns = 20 * NS
        link = Link(boot_at_ns=19 * NS, least_delay_ns=5 * MS, jitter_ns=60 * MS, seed=seed)
    used = 0
    for k in range(200):
        now_ns = begin_ns + k * 10 * MS
        link.attitude(clock, now_ns)
        if k >= 20 and k % 10 == 0 and clock.restarts == reboots:
            link.exchange(clock, now_ns)
        if clock.restarts == reboots and clock.usable:
            bound_ns = clock.estimate.bound_ns
            used += 1
            assert abs(link.error_ns(clock, link.boot(now_ns))) < (30 * MS if bound_ns is None else bound_ns + MS)
    assert used > 100


@pytest.mark.parametrize("seed", first(3, range(10)))
@pytest.mark.parametrize("case", ["an answer first", "no answers", "silence", "silence, then no answers"])
def test_no_stamp_is_used_before_the_fastest_arrivals_are_known(case: str, seed: int) -> None:
    """Stamps were late by up to 102 ms, with a stated error of 30 ms: at once where the first answer came before the first
    message, or after a silence of a minute; without answers whenever a further second of arrivals began."""
    clock, link, begin_ns = ClockFilter(), Link(least_delay_ns=5 * MS, jitter_ns=60 * MS, seed=seed), 0
    if case.startswith("silence"):
        run(link, clock, 5.0)
        begin_ns = 70 * NS
    elif case == "an answer first":
        link.exchange(clock, -100 * MS)
    used = 0
    for k in range(1400):
        now_ns = begin_ns + k * 10 * MS
        link.attitude(clock, now_ns)
        if k >= 20 and k % 10 == 0 and not case.endswith("no answers"):
            link.exchange(clock, now_ns)
        if clock.usable:
            bound_ns = clock.estimate.bound_ns
            used += 1
            assert abs(link.error_ns(clock, link.boot(now_ns))) < (30 * MS if bound_ns is None else bound_ns + MS)
    assert used >= 250
    assert clock.restarts == 0


@pytest.mark.parametrize("drift", [150e-6, -150e-6])
def test_without_answers_stamps_of_a_line_without_jitter_are_used_after_ten_seconds(drift: float) -> None:
    """Each arrival of a fast clock is a little faster than all before."""
    clock, link = ClockFilter(), Link(drift=drift, jitter_ns=0)
    usable = []
    for k in range(1100):
        now_ns = k * 10 * MS
        clock.arrival(link.boot(now_ns), now_ns + MS)
        usable.append(clock.usable)
    assert 1000 <= usable.index(True) <= 1002
    assert all(usable[1002:])


def test_a_message_a_second_late_is_no_reboot() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 5.0)
    for k in range(20):
        assert not clock.arrival(link.boot(3 * NS + k * 10 * MS), 5 * NS + k * 10 * MS)
        assert clock.arrival(link.boot(5 * NS + k * 10 * MS), 5 * NS + k * 10 * MS + MS)
    assert clock.restarts == 0


def test_late_messages_of_before_do_not_make_one_late_message_a_reboot() -> None:
    clock, link = ClockFilter(), Link()
    run(link, clock, 5.0)
    for k in range(10):
        assert not clock.arrival(link.boot(3 * NS + k * 10 * MS), 5 * NS + k * 10 * MS)
        assert clock.arrival(link.boot(5 * NS + k * 10 * MS), 5 * NS + k * 10 * MS + MS)
    assert not clock.arrival(link.boot(3 * NS), 7 * NS)
    assert clock.restarts == 0


def test_messages_of_a_second_route_that_come_in_bursts_are_no_reboot() -> None:
    """Five in a row were one, although newer messages had arrived milliseconds before: attitudes of 1.5 s ago were
    stamped as present."""
    clock, link = ClockFilter(), Link()
    run(link, clock, 5.0)
    for k in range(100):
        now = 5 * NS + k * 10 * MS
        assert clock.arrival(link.boot(now), now + MS)
        if k % 10 == 9:
            assert not any(clock.arrival(link.boot(now - 1500 * MS + j * 10 * MS), now + 2 * MS) for j in range(10))
    assert clock.restarts == 0
    assert clock.mixed(6 * NS)
    assert not clock.mixed(16 * NS)


@pytest.mark.parametrize("other_ns", [-200 * NS, -400 * MS, 400 * MS, 200 * NS])
def test_messages_of_another_clock_change_nothing(other_ns: int) -> None:
    """A second vehicle with the same ids that was started earlier or later."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    for k in range(200):
        now = 5 * NS + k * 10 * MS
        assert clock.arrival(link.boot(now), now + MS)
        accepted = clock.arrival(link.boot(now) + other_ns, now + 2 * MS)
        assert accepted == (other_ns == -400 * MS), "as a message that is late"
        if k % 50 == 0:
            link.exchange(clock, now)
        if k % 50 == 25:
            assert not clock.exchange(now, link.boot(now) + other_ns, now + MS)
        assert abs(link.error_ns(clock, link.boot(now))) < MS
    assert clock.restarts == 0


@pytest.mark.parametrize("other_ns", [-200 * NS, 200 * NS])
def test_answers_decide_which_of_two_clocks_is_the_autopilots(other_ns: int) -> None:
    """Messages of both arrive from the beginning on."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    for k in range(1000):
        now = k * 10 * MS
        if k % 10 == 5:
            link.exchange(clock, now)
        clock.arrival(link.boot(now) + other_ns, now + MS)
        accepted = clock.arrival(link.boot(now), now + 2 * MS)
        if k >= 100:
            assert accepted
            assert abs(link.error_ns(clock, link.boot(now))) < MS
    assert clock.restarts <= 1


def test_an_old_window_is_forgotten() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 180.0, hz=2.0)
    assert clock.estimate.exchanges <= 121

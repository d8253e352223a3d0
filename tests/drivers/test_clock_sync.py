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


@pytest.mark.parametrize("seed", range(10))
def test_the_drift_stays_within_its_limit(seed: int) -> None:
    clock, link = ClockFilter(), Link(jitter_ns=50 * MS, seed=seed)
    for k in range(20):
        run(link, clock, 0.5, hz=2.0, start_ns=k * NS // 2)
        assert abs(clock.estimate.drift) <= clock.params.max_drift


def test_after_a_long_time_a_step_back_is_a_reboot_and_no_wrap() -> None:
    clock, days_ns = ClockFilter(), 30 * 86_400 * NS
    clock.arrival(days_ns, days_ns + NS)
    assert clock.boot_ns(5_000) == 5 * NS


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
@pytest.mark.parametrize("seed", range(5))
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


@pytest.mark.parametrize("seed", range(10))
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


@pytest.mark.parametrize("answers", [True, False])
def test_after_a_suspension_no_stamp_is_used_that_contradicts_the_answers(answers: bool) -> None:
    """The local clock stood for 50 ms: stamps were taken for the time of arrival, 50 ms late for the attitude before."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    later = Link(boot_at_ns=link.boot_at_ns - 50 * MS, jitter_ns=MS, seed=2)
    used = []
    for k in range(300):
        now = 5 * NS + k * 10 * MS
        if answers and k % 50 == 0:
            later.exchange(clock, now)
        boot_ns = later.boot(now) // MS * MS
        if clock.arrival(boot_ns, now + MS):
            used.append(k)
            assert later.error_ns(clock, boot_ns) < 5 * MS
    assert 40 <= used[0] <= 160, "SILENT_NS after the newest stamp that fits"
    assert used == list(range(used[0], 300))
    assert clock.restarts == 1


def test_an_arrival_that_corrects_the_estimate_does_so_at_once() -> None:
    """Answers are delayed on the way back only: a quicker message shows by how much at least."""
    clock = ClockFilter()
    for k in range(20):
        sent = k * NS // 10
        clock.exchange(sent, sent + 5 * NS, sent + 8 * MS)
    assert clock.estimate.local_ns(7 * NS) == pytest.approx(2 * NS + 4 * MS, abs=MS)
    assert clock.arrival(7 * NS, 2 * NS + MS)
    assert clock.estimate.local_ns(7 * NS) <= 2 * NS + MS


def test_the_bound_grows_when_nothing_arrives() -> None:
    """The status stated 0.3 ms 74 s after the newest message."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    bound_ns = clock.estimate.bound_ns
    later = clock.estimate_at(79 * NS)
    assert bound_ns is not None
    assert later.bound_ns is not None
    assert later.bound_ns - bound_ns == pytest.approx(74 * 2 * 150_000, rel=0.01)
    assert clock.estimate_at(79 * NS).offset_ns == clock.estimate.offset_ns


@pytest.mark.parametrize("every_s", [25.0, 40.0, 55.0])
def test_the_bound_holds_with_rare_answers(every_s: float) -> None:
    """With fewer than min_exchanges in the window the estimate stayed as it was, and so did its bound."""
    clock, link = ClockFilter(), Link(drift=50e-6, jitter_ns=MS)
    run(link, clock, 20.0)
    rare = Link(drift=30e-6, jitter_ns=MS, boot_at_ns=round(20 * NS - link.boot(20 * NS) / (1.0 + 30e-6)), seed=2)
    for k in range(20 * 10, 1500 * 10):
        now = k * NS // 10
        if now % round(every_s * NS) == 0:
            rare.exchange(clock, now)
        rare.attitude(clock, now)
        e = clock.estimate
        assert e.source is ClockSource.TIMESYNC
        assert e.bound_ns is not None
        assert abs(rare.error_ns(clock, rare.boot(now))) <= e.bound_ns + MS


def test_a_single_contradiction_changes_the_bound_alone_until_an_answer_fits() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    before = clock.estimate
    assert not clock.exchange(5 * NS, link.boot(5 * NS) + 300 * MS, 5 * NS + MS)
    assert clock.doubted
    assert before.bound_ns is not None
    assert clock.estimate.bound_ns == pytest.approx(300 * MS, abs=3 * MS)
    assert abs(link.error_ns(clock, link.boot(5 * NS))) < before.bound_ns
    assert link.exchange(clock, 5 * NS + 100 * MS)
    assert not clock.doubted
    assert clock.estimate.bound_ns == pytest.approx(before.bound_ns, abs=MS)


@pytest.mark.parametrize("rate", [0.02, -0.02, 0.083])
def test_the_bound_holds_while_the_clock_of_this_computer_is_corrected(rate: float) -> None:
    """NTP changes the speed of CLOCK_MONOTONIC by up to 8 %. Stamps were wrong by 100 ms, the bound was 2 ms."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 20.0)
    worst_ns = 0
    for k in range(5 * 100):
        now = 20 * NS + k * 10 * MS
        # the correction begins at 20 s: of the local time rate / (1 + rate) is correction
        slewed = Link(jitter_ns=MS, boot_at_ns=link.boot_at_ns + round(rate / (1.0 + rate) * (now - 20 * NS)), seed=k)
        if k % 10 == 0:
            slewed.exchange(clock, now)
        slewed.attitude(clock, now)
        e = clock.estimate
        if e.source is ClockSource.TIMESYNC:
            assert e.bound_ns is not None
            worst_ns = max(worst_ns, round(abs(slewed.error_ns(clock, slewed.boot(now)))) - e.bound_ns)
    assert worst_ns <= abs(rate) * 100 * MS + 2 * MS  # what is corrected between two answers


def test_a_step_that_lasts_is_followed() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    stepped = Link(jitter_ns=MS, boot_at_ns=link.boot_at_ns - 300 * MS, seed=2)
    errors = run(stepped, clock, 3.0, start_ns=5 * NS)
    assert clock.restarts == 1
    assert abs(errors[-1]) < 2 * MS


def test_answers_are_used_again_from_the_one_that_confirms_a_step() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    stepped, few = Link(jitter_ns=MS, boot_at_ns=link.boot_at_ns - 300 * MS, seed=2), clock.params.strange_exchanges
    used = [stepped.exchange(clock, 5 * NS + k * NS // 10) for k in range(few + 2)]
    assert used == [False] * (few - 1) + [True] * 3
    assert not clock.doubted


def test_a_contradiction_ends_with_the_answers_that_it_contradicts() -> None:
    """After window_s without an answer the arrivals count alone."""
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    assert not clock.exchange(5 * NS, link.boot(5 * NS) + 300 * MS, 5 * NS + MS)
    for k in range(5 * 62):
        link.attitude(clock, 5 * NS + k * NS // 5)
        if k < 5 * 59:
            assert clock.doubted
    assert clock.estimate.source is ClockSource.ENVELOPE
    assert not clock.doubted


def test_contradictions_that_disagree_with_each_other_are_no_step() -> None:
    clock, link = ClockFilter(), Link(jitter_ns=MS)
    run(link, clock, 5.0)
    before = clock.estimate
    for k in range(6):
        sent = 5 * NS + k * NS // 10
        assert not clock.exchange(sent, link.boot(sent) + (200 + 50 * (-1) ** k) * MS, sent + MS)
    assert clock.restarts == 0
    assert clock.estimate.offset_ns == pytest.approx(before.offset_ns, abs=MS)


@pytest.mark.parametrize("begins", ["at the start", "after a reboot", "after a minute"])
def test_no_stamp_is_used_of_a_line_whose_answers_are_slow(begins: str) -> None:
    """Answers slower than max_rtt_s are not used. The fastest arrivals then counted as delayed by 30 ms at most, although the
    answers show that the line may take half a second and more: attitudes were used that were as old."""
    clock, begin_ns, boot_at_ns = ClockFilter(), 0, -1_000 * NS
    if begins != "at the start":
        run(Link(), clock, 5.0)
        begin_ns = 20 * NS
    if begins == "after a reboot":
        boot_at_ns = 19 * NS
    slow = Link(boot_at_ns=boot_at_ns, least_delay_ns=300 * MS)
    for k in range(1, 1000):
        now_ns = begin_ns + k * 100 * MS
        slow.attitude(clock, now_ns)
        slow.exchange(clock, now_ns)
        if clock.usable:
            assert clock.estimate.source is ClockSource.TIMESYNC  # of the answers before, until they are too old
            assert begins == "after a minute" or now_ns < begin_ns + 2 * NS
    assert not clock.usable
    fast = Link(boot_at_ns=boot_at_ns)
    run(fast, clock, 1.0, start_ns=begin_ns + 101 * NS)
    assert clock.usable
    assert clock.estimate.source is ClockSource.TIMESYNC


def test_a_line_that_has_not_shown_a_slow_answer_for_a_minute_counts_as_one_without_answers() -> None:
    clock, link = ClockFilter(), Link()
    assert not clock.exchange(0, link.boot(0), 600 * MS)
    usable_s = []
    for k in range(1, 9000):
        link.attitude(clock, k * 10 * MS)
        if clock.usable:
            usable_s.append(k / 100)
    assert usable_s[0] == pytest.approx(60.6, abs=0.1)
    assert len(usable_s) == pytest.approx(100 * (90 - 60.6), abs=20)


def test_a_late_answer_and_one_from_the_future_are_not_used() -> None:
    clock = ClockFilter()
    assert not clock.exchange(0, 0, 600 * MS)
    assert not clock.exchange(100, 0, 50)
    assert clock.estimate.source is ClockSource.NONE


def test_an_old_window_is_forgotten() -> None:
    clock, link = ClockFilter(ClockParams(window_s=5.0)), Link(jitter_ns=MS)
    run(link, clock, 60.0, hz=2.0)
    assert clock.estimate.exchanges <= 11


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(ValueError, match=r"clock: window_s = 0.1: expected 2.0..600.0 s"):
        ClockParams(window_s=0.1)


@pytest.mark.parametrize("later_drift", [75e-6, -75e-6])
def test_the_bound_grows_when_answers_stop(later_drift: float) -> None:
    """The drift may change with the temperature. After 10 min without an answer the error was 45 ms, the bound 1.3 ms."""
    clock, before = ClockFilter(), Link(drift=75e-6, jitter_ns=MS)
    run(before, clock, 20.0)
    later = Link(
        drift=later_drift, boot_at_ns=round(20 * NS - before.boot(20 * NS) / (1.0 + later_drift)), jitter_ns=MS
    )
    bounds_ns = []
    for k in range(20 * 50, 600 * 50):
        later.attitude(clock, k * NS // 50)
        e = clock.estimate
        if e.source is ClockSource.TIMESYNC:
            assert e.bound_ns is not None
            assert abs(later.error_ns(clock, later.boot(k * NS // 50))) <= e.bound_ns + MS
            bounds_ns.append(e.bound_ns)
    assert clock.estimate.source is ClockSource.ENVELOPE
    assert 0 <= later.error_ns(clock, clock.estimate.at_boot_ns) < 3 * MS
    assert len(bounds_ns) == pytest.approx(60 * 50, abs=100), "window_s after the newest answer"
    assert bounds_ns[-1] > 3 * bounds_ns[0]
    run(later, clock, 2.0, start_ns=600 * NS)
    assert clock.estimate.source is ClockSource.TIMESYNC
    assert clock.restarts == 0

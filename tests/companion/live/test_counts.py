"""What the service counts of itself, by a clock of the test's."""

from __future__ import annotations

from companion.live.counts import NS, REPORT_NS, FrameRates, RecentLosses


def test_the_rate_is_that_of_the_last_seconds_and_not_of_the_whole_flight() -> None:
    rates, seen = FrameRates(), []
    frames = 0
    for second in range(20):
        seen.append(rates.hz("front", frames, second * NS))
        frames += 30 if second < 10 else 5
    assert seen[0] == 0.0
    assert seen[5] == 30.0
    assert seen[-1] == 5.0


def test_each_call_gives_a_rate_over_a_second_or_more() -> None:
    """The main loop asks with each tick of 80 ms; a report is made of any of them."""
    rates, tick_ns = FrameRates(), NS * 2 // 25
    seen = [rates.hz("front", 5 * k * tick_ns // NS, k * tick_ns) for k in range(100)]
    assert all(4.0 <= hz <= 6.0 for hz in seen[13:])


def test_cameras_are_counted_apart() -> None:
    rates = FrameRates()
    rates.hz("front", 0, 0)
    rates.hz("left", 0, 0)
    assert rates.hz("front", 12, NS) == 12.0
    assert rates.hz("left", 0, NS) == 0.0


def test_a_loss_is_reported_for_ten_seconds_after_the_last() -> None:
    losses = RecentLosses()
    assert not losses.active(0, 0, is_fault=True)
    assert losses.active(3, NS, is_fault=True)
    assert losses.active(4, 5 * NS, is_fault=True)
    assert losses.active(4, 5 * NS + REPORT_NS - 1, is_fault=True)
    assert not losses.active(4, 5 * NS + REPORT_NS, is_fault=True)


def test_what_is_lost_at_a_start_is_no_fault_and_none_later() -> None:
    losses = RecentLosses()
    assert not losses.active(7, NS, is_fault=False)
    assert not losses.active(7, 2 * NS, is_fault=True)
    assert losses.active(8, 3 * NS, is_fault=True)


def test_what_is_lost_just_before_the_start_is_over_is_no_fault() -> None:
    """Each first start, which compiles kernels, ended with a warning about hundreds of thousands of lost samples."""
    losses = RecentLosses()
    assert not losses.active(200_000, NS, is_fault=False)
    assert not losses.active(200_900, 2 * NS, is_fault=True)
    assert losses.active(200_903, 3 * NS, is_fault=True)
    assert losses.count == 3

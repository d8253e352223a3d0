"""What the service counts of itself, by a clock of the test's."""

from __future__ import annotations

from companion.live.counts import NS, TOLD_NS, FrameRates, Losses


def test_the_rate_is_that_of_the_last_seconds_and_not_of_the_whole_flight() -> None:
    rates, seen = FrameRates(), []
    frames = 0
    for second in range(20):
        seen.append(rates.hz("front", frames, second * NS))
        frames += 30 if second < 10 else 5
    assert seen[0] == 0.0
    assert seen[5] == 30.0
    assert seen[-1] == 5.0


def test_cameras_are_counted_apart() -> None:
    rates = FrameRates()
    rates.hz("front", 0, 0)
    rates.hz("left", 0, 0)
    assert rates.hz("front", 12, NS) == 12.0
    assert rates.hz("left", 0, NS) == 0.0


def test_a_loss_is_told_for_ten_seconds_after_the_last() -> None:
    losses = Losses()
    assert not losses.of_late(0, 0, counts=True)
    assert losses.of_late(3, NS, counts=True)
    assert losses.of_late(4, 5 * NS, counts=True)
    assert losses.of_late(4, 5 * NS + TOLD_NS - 1, counts=True)
    assert not losses.of_late(4, 5 * NS + TOLD_NS, counts=True)


def test_what_is_lost_at_a_start_is_no_trouble_and_none_later() -> None:
    losses = Losses()
    assert not losses.of_late(7, NS, counts=False)
    assert not losses.of_late(7, 2 * NS, counts=True)
    assert losses.of_late(8, 3 * NS, counts=True)

"""OAK stamps while a time daemon corrects the clock of this computer."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import BadData
from drivers.cameras.clock_correction import SPAN_NS, ClockCorrection, difference_ns
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings
from drivers.cameras.oak_stamps import MOST_CORRECTED_NS

from .oak_host import DEVICE_ALONE, HostLink, depth_message

NS = 1_000_000_000
MS = 1_000_000
PERIOD_NS = 5 * NS
LATENCY_NS = 100 * MS
SETTINGS = OakSettings(camera="front", match=DEVICE_ALONE, first_frame_s=60.0)


def slewed(begins_ns: int, per_mille: float, most_ms: float) -> Callable[[int], int]:
    """The correction of the clock, ns, at an instant of the uncorrected one."""

    def corrected_ns(raw_ns: int) -> int:
        done_ns = max(0, raw_ns - begins_ns) * abs(per_mille) / 1000.0
        return round(min(done_ns, most_ms * MS)) * (1 if per_mille >= 0.0 else -1)

    return corrected_ns


def errors_ms(corrected_ns: Callable[[int], int], phase_ns: int, seconds: float) -> tuple[float, float]:
    """(greatest error of all stamps, of those that are used): a device that compares the clocks every 5 s."""
    now = [0]
    correction = ClockCorrection(lambda: corrected_ns(now[0]))
    every, used = 0.0, 0.0
    for raw_ns in range(0, round(seconds * NS), 33 * MS):
        now[0] = raw_ns + LATENCY_NS
        compared_ns = raw_ns - (raw_ns + phase_ns) % PERIOD_NS
        error_ms = abs(corrected_ns(raw_ns) - corrected_ns(compared_ns)) / MS
        every = max(every, error_ms)
        if correction.take(now[0] + corrected_ns(now[0])) <= MOST_CORRECTED_NS:
            used = max(used, error_ms)
    return every, used


@given(st.floats(-83.0, 83.0), st.floats(0.0, 1000.0), st.integers(0, PERIOD_NS - 1), st.integers(0, 20 * NS))
def test_no_stamp_that_is_used_is_wrong_by_more_than_the_limit(
    per_mille: float, most_ms: float, phase_ns: int, begins_ns: int
) -> None:
    _, used = errors_ms(slewed(begins_ns, per_mille, most_ms), phase_ns, 30.0)
    assert used <= MOST_CORRECTED_NS / MS


@pytest.mark.parametrize("per_mille", [20.0, 83.0, -83.0])
def test_without_it_stamps_are_wrong_by_a_tenth_of_a_second(per_mille: float) -> None:
    every, used = errors_ms(slewed(10 * NS, per_mille, 100.0), 0, 40.0)
    assert every > 80.0
    assert used <= MOST_CORRECTED_NS / MS


@pytest.mark.parametrize("per_mille", [0.0, 0.1, -0.5, 0.5])
def test_the_rate_of_a_usual_clock_is_not_refused(per_mille: float) -> None:
    now = [0]
    correction = ClockCorrection(lambda: slewed(0, per_mille, 1e9)(now[0]))
    for raw_ns in range(0, 60 * NS, 100 * MS):
        now[0] = raw_ns
        assert correction.take(raw_ns) <= MOST_CORRECTED_NS


def test_a_correction_counts_for_its_span_and_no_longer() -> None:
    now = [0]
    correction = ClockCorrection(lambda: slewed(NS, 50.0, 50.0)(now[0]))
    seen = []
    for raw_ns in range(0, 2 * SPAN_NS, 100 * MS):
        now[0] = raw_ns
        seen.append(correction.take(raw_ns))
    assert max(seen) == 50 * MS
    assert seen[15] > MOST_CORRECTED_NS
    assert seen[-1] == 0


def test_a_pause_of_the_reader_does_not_hide_a_correction() -> None:
    now = [0]
    correction = ClockCorrection(lambda: slewed(NS, 50.0, 50.0)(now[0]))
    correction.take(0)
    now[0] = 30 * NS
    assert correction.take(30 * NS) == 50 * MS


def test_readings_that_fail_change_nothing() -> None:
    correction = ClockCorrection(lambda: None)
    assert [correction.take(k * NS) for k in range(20)] == [0] * 20


def test_both_clocks_of_this_computer_are_read() -> None:
    found = [difference_ns() for _ in range(100)]
    assert any(d is not None for d in found)
    assert all(
        abs(d - (time.monotonic_ns() - time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW))) < NS for d in found if d
    )


@pytest.mark.process
def test_frames_are_refused_with_the_cause_while_the_clock_is_corrected() -> None:
    reads = [0]

    def read() -> int:
        reads[0] += 1
        return max(0, reads[0] - 20) * MS

    source = OakSource(SETTINGS, HostLink(depth_message), ClockCorrection(read))
    source.open()
    assert source.read(60.0) is not None
    with pytest.raises(BadData, match=r"camera front: the clock of this computer was corrected by 1\d ms"):
        read_all(source)
    source.close()


def read_all(source: OakSource) -> None:
    """Reads until something is wrong."""
    for _ in range(1000):
        source.read(0.05)

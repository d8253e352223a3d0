"""The clock by which ages are computed."""

from __future__ import annotations

import time

LONGEST_WAIT_S = 365.0 * 24.0 * 3600.0
"""A longer wait, also one without an end, ends after this time: the nanoseconds of a much longer one do not fit into 64 bits."""


def clock_ns() -> int:
    """Returns the time since the start of this computer, ns, including the time for which it was suspended: CLOCK_BOOTTIME on
    Linux. CLOCK_MONOTONIC stands still meanwhile, and old messages would count as new."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic_ns() if clock is None else time.clock_gettime_ns(clock)


def deadline_ns(timeout_s: float) -> int:
    """Returns the instant, by `clock_ns`, at which a wait of timeout_s from now on ends."""
    return clock_ns() + round(1e9 * min(timeout_s, LONGEST_WAIT_S))

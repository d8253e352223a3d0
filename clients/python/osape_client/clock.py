"""The clock by which ages are computed."""

from __future__ import annotations

import time


def clock_ns() -> int:
    """Returns the time since the start of this computer, ns, including the time for which it was suspended: CLOCK_BOOTTIME on
    Linux. CLOCK_MONOTONIC stands still meanwhile, and old messages would count as new."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic_ns() if clock is None else time.clock_gettime_ns(clock)

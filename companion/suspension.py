"""Detects that the computer was suspended.

CLOCK_MONOTONIC, by which the age of everything is computed, stands still meanwhile: old frames would count as new, and the
space that they show free as free."""

from __future__ import annotations

import time
from time import CLOCK_BOOTTIME, CLOCK_MONOTONIC

NS = 1_000_000_000
LEAST_NS = NS // 100
"""A suspension takes longer. Less would make no age wrong by much."""


def suspended_ns() -> int:
    """Returns the time for which the computer was suspended since it was started."""
    # The order of the clocks: a pause of this process between them must not look like a suspension.
    boot_ns = time.clock_gettime_ns(CLOCK_BOOTTIME)
    return boot_ns - time.clock_gettime_ns(CLOCK_MONOTONIC)


class Suspension:
    """Detects a suspension since it was made."""

    def __init__(self) -> None:
        # the other order than in `suspended_ns`, for the same reason
        monotonic_ns = time.clock_gettime_ns(CLOCK_MONOTONIC)
        self._before_ns = time.clock_gettime_ns(CLOCK_BOOTTIME) - monotonic_ns

    def fault(self) -> str:
        """Returns that the computer was suspended, as text; empty: it was not."""
        passed_ns = suspended_ns() - self._before_ns
        if passed_ns < LEAST_NS:
            return ""
        return f"the computer was suspended for {passed_ns / NS:.1f} s: what was seen before it is too old"

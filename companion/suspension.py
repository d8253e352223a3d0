"""Detects that the computer was suspended.

CLOCK_MONOTONIC, by which the age of everything is computed, stands still meanwhile: old frames would count as new, and the
space that they show free as free."""

from __future__ import annotations

import time
from time import CLOCK_BOOTTIME, CLOCK_MONOTONIC

from drivers.suspended_time import LEAST_NS, suspended_ns

NS = 1_000_000_000


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

"""The time for which the computer was suspended. CLOCK_MONOTONIC stands still meanwhile."""

from __future__ import annotations

import time
from time import CLOCK_BOOTTIME, CLOCK_MONOTONIC
from typing import Final

LEAST_NS: Final = 10_000_000
"""A suspension takes longer. Less would make no age wrong by much."""


def suspended_ns() -> int:
    """Returns the time for which the computer was suspended since it was started."""
    # The order of the clocks: a pause of this process between them must not look like a suspension.
    boot_ns = time.clock_gettime_ns(CLOCK_BOOTTIME)
    return boot_ns - time.clock_gettime_ns(CLOCK_MONOTONIC)

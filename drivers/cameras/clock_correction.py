"""Corrections of CLOCK_MONOTONIC by a time daemon, for devices that stamp with a clock of their own.

Such a device compares its clock with the host's from time to time and assumes that both advance equally in between. While
the host's clock is slewed they do not: its stamps are wrong by the correction since the last comparison."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

NS: Final = 1_000_000_000
SPAN_NS: Final = 10 * NS
"""Time over which corrections are added up. DepthAI compares the clocks every 5 s (DEFAULT_TIMESYNC_PERIOD), by requests
whose duration is not documented."""
_EVERY_NS: Final = NS // 10
_CLOSE_NS: Final = 50_000
_TRIES: Final = 4


def difference_ns() -> int | None:
    """Returns CLOCK_MONOTONIC minus CLOCK_MONOTONIC_RAW, which no daemon corrects, to 50 us; None: the processor was taken away
    at each try."""
    for _ in range(_TRIES):
        before_ns = time.monotonic_ns()
        raw_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
        after_ns = time.monotonic_ns()
        if after_ns - before_ns <= _CLOSE_NS:
            return (before_ns + after_ns) // 2 - raw_ns
    return None


class RecentValues:
    """Keeps a value of the last SPAN_NS, one of each _EVERY_NS. `take` is to be called several times a second."""

    def __init__(self) -> None:
        self._values: deque[tuple[int, int]] = deque()

    def take(self, now_ns: int, value: int | None) -> int:
        """Returns by how much the value differed within SPAN_NS; 0 at the first call. now_ns: monotonic. value: None: not known now."""
        if value is None:
            value = self._values[-1][1] if self._values else 0
        elif not self._values or now_ns - self._values[-1][0] >= _EVERY_NS:
            self._values.append((now_ns, value))
        while len(self._values) > 1 and now_ns - self._values[1][0] >= SPAN_NS:
            self._values.popleft()
        kept = [earlier for _, earlier in self._values] + [value]
        return max(kept) - min(kept)


class ClockCorrection:
    """The differences of both clocks of the last SPAN_NS. `take` is to be called several times a second."""

    def __init__(self, read: Callable[[], int | None] = difference_ns) -> None:
        self._read = read
        self._differences = RecentValues()

    def take(self, now_ns: int) -> int:
        """Returns by how much the clock was corrected within SPAN_NS, ns; 0 at the first call. now_ns: monotonic."""
        return self._differences.take(now_ns, self._read())

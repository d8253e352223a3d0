"""Frame rates and losses between two health reports."""

from __future__ import annotations

from collections import deque

NS = 1_000_000_000
REPORT_NS = 10 * NS
"""Time for which a loss is reported."""


class FrameRates:
    """Frame rate of each camera."""

    def __init__(self) -> None:
        self._marks: dict[str, deque[tuple[int, int]]] = {}

    def hz(self, name: str, frames: int, now_ns: int) -> float:
        """The rate over the last one to two seconds. frames: total number of frames that arrived."""
        marks = self._marks.setdefault(name, deque(maxlen=2))
        if not marks or now_ns - marks[-1][1] >= NS:
            marks.append((frames, now_ns))
        before, then_ns = marks[0]
        return (frames - before) * NS / max(1, now_ns - then_ns)


class RecentLosses:
    """Detects losses of samples within the last REPORT_NS. count: number of those that are faults."""

    def __init__(self) -> None:
        self._lost = self._until_ns = self.count = 0
        self._counts = False

    def active(self, lost: int, now_ns: int, *, is_fault: bool) -> bool:
        """lost: total so far. is_fault: whether a loss counts as a fault from now on; what was lost between this call and the
        one before is a fault if it did at both."""
        if lost != self._lost:
            new, self._lost = lost - self._lost, lost
            if is_fault and self._counts:
                self.count += new
                self._until_ns = now_ns + REPORT_NS
        self._counts = is_fault
        return now_ns < self._until_ns

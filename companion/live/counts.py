"""What is counted from one look of the service at itself to the next."""

from __future__ import annotations

NS = 1_000_000_000
REPORT_NS = 10 * NS
"""So long a loss is told."""


class FrameRates:
    """Frames a second of each camera."""

    def __init__(self) -> None:
        self._before: dict[str, tuple[int, int]] = {}

    def hz(self, name: str, frames: int, now_ns: int) -> float:
        """Since the report before the last. frames: how many came in all."""
        before, then_ns = self._before.get(name, (frames, now_ns))
        if now_ns - then_ns > 2 * NS or name not in self._before:
            self._before[name] = (frames, now_ns)
        return (frames - before) * NS / max(1, now_ns - then_ns)


class RecentLosses:
    """Whether something was lost within the last REPORT_NS."""

    def __init__(self) -> None:
        self._lost = self._until_ns = 0

    def active(self, lost: int, now_ns: int, *, is_fault: bool) -> bool:
        """lost: total so far. is_fault: whether a loss since the last call counts as a fault."""
        if lost != self._lost:
            self._lost = lost
            self._until_ns = now_ns + REPORT_NS if is_fault else 0
        return now_ns < self._until_ns

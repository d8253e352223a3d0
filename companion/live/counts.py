"""What is counted from one look of the service at itself to the next."""

from __future__ import annotations

NS = 1_000_000_000
TOLD_NS = 10 * NS
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


class Losses:
    """Whether something was lost of late."""

    def __init__(self) -> None:
        self._lost = self._until_ns = 0

    def of_late(self, lost: int, now_ns: int, *, counts: bool) -> bool:
        """lost: how much in all. counts: whether what was lost since the last look is a trouble."""
        if lost != self._lost:
            self._lost = lost
            self._until_ns = now_ns + TOLD_NS if counts else 0
        return now_ns < self._until_ns

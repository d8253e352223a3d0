"""The newest samples of the attitude, or of the position, ordered by stamp."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from typing import Generic, Protocol, TypeVar

HELD = 256
"""Number of samples that are kept for late frames: 0.6 s at the greatest rate of the attitude."""
RESTART_STEP_NS = 1_000_000_000
"""Stamps that step back by more are a restart of the autopilot; those of a camera, when its frames have done so for this time."""


class _Stamped(Protocol):
    @property
    def t_ns(self) -> int: ...


S = TypeVar("S", bound=_Stamped)


class SampleBuffer(Generic[S]):
    """The newest samples ordered by stamp. `counts`: numbers of duplicates, samples out of order and restarts."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._samples: list[S] = []
        self.counts: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def samples(self) -> tuple[S, ...]:
        """The stored samples by stamp."""
        return tuple(self._samples)

    @property
    def newest(self) -> S | None:
        """The stored sample with the newest stamp."""
        return self._samples[-1] if self._samples else None

    @property
    def newest_ns(self) -> int | None:
        """The newest stored stamp."""
        return self._stamps[-1] if self._stamps else None

    def add(self, sample: S, since_ns: int = 0) -> None:
        """Adds a sample. A stamp far before the newest one means that the sender restarted: all stored samples are
        discarded. Of two samples with the same stamp the first is kept. A late one with a stamp before since_ns is not."""
        if self._stamps and sample.t_ns <= self._stamps[-1] - RESTART_STEP_NS:
            self.counts["restarts"] += 1
            self._stamps.clear()
            self._samples.clear()
        i = bisect_left(self._stamps, sample.t_ns)
        if i < len(self._stamps):
            anomaly = "duplicates" if self._stamps[i] == sample.t_ns else "out_of_order"
            self.counts[anomaly] += 1
            if anomaly == "duplicates" or sample.t_ns < since_ns:
                return
        self._stamps.insert(i, sample.t_ns)
        self._samples.insert(i, sample)
        if len(self._samples) > HELD:
            del self._stamps[0], self._samples[0]

    def around(self, t_ns: int) -> tuple[S | None, S | None]:
        """(newest sample at or before t_ns, oldest at or after it); both are the same sample at an exact stamp."""
        i = bisect_left(self._stamps, t_ns)
        after = self._samples[i] if i < len(self._samples) else None
        if after is not None and after.t_ns == t_ns:
            return after, after
        return (self._samples[i - 1] if i else None), after

    def before(self, sample: S) -> S | None:
        """The stored sample just before this one."""
        i = bisect_left(self._stamps, sample.t_ns)
        return self._samples[i - 1] if i else None


def nearest_of(t_ns: int, before: S | None, after: S | None) -> S:
    """The nearer of two samples, at least one of which exists; the earlier one where both are equally near."""
    if before is None or (after is not None and after.t_ns - t_ns < t_ns - before.t_ns):
        if after is None:
            raise ValueError("there is neither a sample before nor one after")
        return after
    return before

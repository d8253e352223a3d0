"""How long frames take, stage by stage: percentiles over the newest ones."""

from __future__ import annotations

from collections import deque

STAGES = (
    "exposure to arrival", "waiting", "extracting", "extracting, processor's time", "publishing", "exposure to published"
)  # fmt: skip
"""Extracting takes longer than its processor's time where other programs, or other threads, have the processor."""
_HELD = 512


class Latencies:
    """`add` in nanoseconds; `percentiles` in milliseconds."""

    def __init__(self, stages: tuple[str, ...] = STAGES) -> None:
        self._held: dict[str, deque[int]] = {stage: deque(maxlen=_HELD) for stage in stages}

    def add(self, stage: str, took_ns: int) -> None:
        """One frame's time in a stage."""
        self._held[stage].append(took_ns)

    def percentiles(self) -> list[tuple[str, float, float, float]]:
        """(stage, p50, p95, p99) of the stages with frames; the p-th is the least that p % do not exceed."""
        found = []
        for stage, held in self._held.items():
            if held:
                ordered = sorted(held)
                last = len(ordered) - 1
                p50, p95, p99 = (ordered[min(last, -(-len(ordered) * p // 100) - 1)] / 1e6 for p in (50, 95, 99))
                found.append((stage, p50, p95, p99))
        return found

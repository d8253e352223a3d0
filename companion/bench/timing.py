"""Times of many runs of one call on one thread of one core: the wall's, and what the processor really worked."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_THREADS: Final = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
ONE_THREAD: Final = dict.fromkeys(_THREADS, "1")
"""Environment that keeps libraries to one thread; read by them when they are first imported."""


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """wall_ms, cpu_ms: (N,) float64 of N runs. The processor's time leaves out what other work on the machine takes,
    but not what it does to the caches and the clock rate."""

    wall_ms: NDArray[np.float64]
    cpu_ms: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not len(self.wall_ms) == len(self.cpu_ms) > 0:
            raise ValueError(f"times: {len(self.wall_ms)} of the wall, {len(self.cpu_ms)} of the processor")

    def __len__(self) -> int:
        return len(self.wall_ms)

    def wall(self, percent: float = 50.0) -> float:
        """A percentile of the wall's time, ms: of N runs, one that was really measured."""
        return float(np.percentile(self.wall_ms, percent, method="higher"))

    def cpu(self, percent: float = 50.0) -> float:
        """A percentile of the processor's time, ms."""
        return float(np.percentile(self.cpu_ms, percent, method="higher"))


class Clock:
    """Collects the times of runs."""

    def __init__(self) -> None:
        self._wall_ns: list[int] = []
        self._cpu_ns: list[int] = []

    def run(self, call: Callable[[], Any]) -> Any:
        """What the call returns; its time is kept."""
        wall, cpu = time.perf_counter_ns(), time.thread_time_ns()
        result = call()
        self._cpu_ns.append(time.thread_time_ns() - cpu)
        self._wall_ns.append(time.perf_counter_ns() - wall)
        return result

    def times(self) -> Times:
        """Of all runs so far."""
        return Times(1e-6 * np.array(self._wall_ns, np.float64), 1e-6 * np.array(self._cpu_ns, np.float64))


@contextmanager
def one_core() -> Iterator[int | None]:
    """Keeps this thread on one of the cores that it may use, the last of them; gives its number. None: the system does
    not let a process choose."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)

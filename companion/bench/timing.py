"""Measures many runs of a call on one thread of one core: wall time and processor time."""

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
"""Environment variables that restrict libraries to one thread, read at their import."""


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Times of N runs. Processor time excludes that of other programs, but not their effect on caches and clock
    frequency."""

    wall_ms: NDArray[np.float64]  # (N,) float64
    cpu_ms: NDArray[np.float64]  # (N,) float64

    def __post_init__(self) -> None:
        if not len(self.wall_ms) == len(self.cpu_ms) > 0:
            raise ValueError(
                f"times: {len(self.wall_ms)} wall times and {len(self.cpu_ms)} processor times; expected equal numbers"
            )

    def __len__(self) -> int:
        return len(self.wall_ms)

    def wall(self, percent: float = 50.0) -> float:
        """A percentile of the wall time, ms: one of the measured values."""
        return float(np.percentile(self.wall_ms, percent, method="higher"))

    def cpu(self, percent: float = 50.0) -> float:
        """A percentile of the processor time, ms."""
        return float(np.percentile(self.cpu_ms, percent, method="higher"))


class Clock:
    """Collects the times of runs."""

    def __init__(self) -> None:
        self._wall_ns: list[int] = []
        self._cpu_ns: list[int] = []

    def run(self, call: Callable[[], Any]) -> Any:
        """Runs the call, stores its time and returns its result."""
        wall, cpu = time.perf_counter_ns(), time.thread_time_ns()
        result = call()
        self._cpu_ns.append(time.thread_time_ns() - cpu)
        self._wall_ns.append(time.perf_counter_ns() - wall)
        return result

    def times(self) -> Times:
        """The times of all runs so far."""
        return Times(1e-6 * np.array(self._wall_ns, np.float64), 1e-6 * np.array(self._cpu_ns, np.float64))


@contextmanager
def one_core() -> Iterator[int]:
    """Binds this thread to the last of its allowed cores and returns the core's number."""
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)

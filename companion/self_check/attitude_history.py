"""The attitudes of the last seconds, from which the self-checks interpolate at the times of images."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from core.types import AttitudeSample

NS = 1_000_000_000
HISTORY_NS, GAP_NS = 3 * NS, 150_000_000
"""Time for which attitudes are kept, and the widest gap that is interpolated."""


class AttitudeHistory:
    """The attitudes of the last seconds as arrays."""

    def __init__(self) -> None:
        self._samples: deque[tuple[int, tuple[float, float, float, float]]] = deque()
        self._t_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._q: NDArray[np.float64] = np.empty((0, 4))
        self._stale = False

    @property
    def newest_ns(self) -> int | None:
        return self._samples[-1][0] if self._samples else None

    def add(self, sample: AttitudeSample) -> bool:
        """Adds a sample unless it is late. False: the sender restarted and earlier samples are discarded."""
        newest = self.newest_ns
        restarted = newest is not None and sample.t_ns < newest - NS
        if restarted:
            self._samples.clear()
        elif newest is not None and sample.t_ns <= newest:
            return True
        q = sample.q_ned_frd_wxyz
        if self._samples and sum(a * b for a, b in zip(q, self._samples[-1][1], strict=True)) < 0.0:
            q = (-q[0], -q[1], -q[2], -q[3])  # same rotation with the sign that allows interpolation by component
        self._samples.append((sample.t_ns, q))
        while self._samples[0][0] < sample.t_ns - HISTORY_NS:
            self._samples.popleft()
        self._stale = True
        return not restarted

    def at(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Quaternions (T, 4), not normalised, at increasing times (T,); None where one is not between two close
        samples."""
        if self._stale:
            self._t_ns = np.array([t for t, _ in self._samples], np.int64)
            self._q = np.array([q for _, q in self._samples])
            self._stale = False
        if len(self._t_ns) < 2 or t_ns[0] < self._t_ns[0] or t_ns[-1] > self._t_ns[-1]:
            return None
        after = np.clip(np.searchsorted(self._t_ns, t_ns), 1, len(self._t_ns) - 1)
        gaps = self._t_ns[after] - self._t_ns[after - 1]
        if int(gaps.max()) > GAP_NS:
            return None
        share = ((t_ns - self._t_ns[after - 1]) / gaps)[:, None]
        return np.asarray(self._q[after - 1] * (1.0 - share) + self._q[after] * share)

"""Horizontal acceleration of the vehicle by its lean. A multirotor accelerates to the side to which it leans, so that
the attitude shows a turn before the velocity does, and without the noise of the velocity."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

NS = 1_000_000_000
SETTLE_S = 2.0
"""Time constant of the lean in steady flight, against wind and drag."""
NEWEST_NS = 3 * NS // 10
"""An older lean is not that of the vehicle now."""
Horizontal = tuple[float, float]
"""North and east."""


@dataclass(slots=True)
class LeanAcceleration:
    """Acceleration by the lean, without the lean of steady flight. That one is the mean difference between lean and
    measured change of the velocity."""

    _leans: deque[tuple[int, Horizontal]] = field(default_factory=lambda: deque(maxlen=32))
    _steady: Horizontal | None = None
    _settled_s: float = 0.0
    _until_ns: int = 0

    def take(self, t_ns: int, lean_m_s2: Horizontal) -> None:
        """Adds the acceleration by which a vehicle leans (`Here.lean_m_s2`)."""
        self._leans.append((t_ns, lean_m_s2))

    def settle(self, begin_ns: int, end_ns: int, change_m_s: Horizontal) -> None:
        """Takes a change of the velocity between two instants. Without a lean between them it is not used."""
        between = [lean for t_ns, lean in self._leans if begin_ns <= t_ns <= end_ns]
        if not between:
            return
        time_s, passed_s = (end_ns - begin_ns) / NS, (end_ns - max(begin_ns, self._until_ns)) / NS
        self._until_ns, self._settled_s = end_ns, self._settled_s + passed_s
        weight = min(1.0, max(passed_s / SETTLE_S, passed_s / self._settled_s))
        north, east = (
            sum(lean[axis] for lean in between) / len(between) - change_m_s[axis] / time_s for axis in (0, 1)
        )
        before = self._steady or (north, east)
        self._steady = before[0] + weight * (north - before[0]), before[1] + weight * (east - before[1])

    def newest_m_s2(self, now_ns: int) -> Horizontal | None:
        """Returns the acceleration by the newest lean; None: not known, or older than NEWEST_NS."""
        if self._steady is None or not self._leans or now_ns - self._leans[-1][0] > NEWEST_NS:
            return None
        lean = self._leans[-1][1]
        return lean[0] - self._steady[0], lean[1] - self._steady[1]

"""Divides the autopilot's position estimate into sections between its jumps.

Positions can be compared only within a section: after a jump, what was remembered in ned is at another place.
ODOMETRY counts the jumps of the estimate (reset_counter). LOCAL_POSITION_NED, which both autopilots send, does not:
there, a step that the velocity does not explain counts as a jump. A section also begins when small steps have added up
within WINDOW_NS, and after a gap."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from core.types import PoseSample

NS: Final = 1_000_000_000
JUMP_M: Final = 0.5
"""Smallest step that counts as a jump. A smaller one is a correction of the estimate within the margins of the
obstacle output."""
JUMP_SPEED_M_S: Final = 5.0
"""The limit grows by this times the time between two positions, because the velocity may change between them."""
UNKNOWN_SPEED_M_S: Final = 30.0
"""The same if no velocity is known."""
WINDOW_NS: Final = 3 * NS
"""Time for which steps add up: that for which obstacles and free space are remembered by default."""
RESTART_NS: Final = NS
"""A stamp that steps back by this means that the autopilot has restarted."""
LONGEST_NS: Final = NS
"""After a longer time without a position a new section begins, because the estimate may have jumped meanwhile."""
_MARK_NS: Final = NS // 4
_MOST: Final = 16
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the position."""

    number: int  # counts the sections
    begins_ns: int  # stamp of its first position
    # first stamp after the newest jump, of this section or an earlier one, or after a gap in which the estimate may
    # have jumped; 0: there was none. A section may also begin when small steps have added up.
    jump_ns: int


NO_SECTION: Final = Section(0, 0, 0)


@dataclass(frozen=True, slots=True)
class PositionState:
    """What later sections depend on, see PositionSections."""

    number: int = 0
    since_ns: int = 0
    newest: PoseSample | None = None  # position
    begun: tuple[Section, ...] = ()  # the newest sections
    sum_m: Vector = (0.0, 0.0, 0.0)  # of the unexplained steps of the section
    sums: tuple[tuple[int, Vector], ...] = ()  # that sum every _MARK_NS, with its stamp


@dataclass(slots=True)
class PositionSections:
    """Number and beginning of the present section."""

    number: int = 0  # number of the section
    since_ns: int = 0  # arrival of its first position. All parts of the service use the section from then on.
    _newest: PoseSample | None = None
    _begun: deque[Section] = field(default_factory=lambda: deque(maxlen=_MOST))
    _sum_m: Vector = (0.0, 0.0, 0.0)  # of the unexplained steps of the section
    _sums: deque[tuple[int, Vector]] = field(default_factory=deque)  # that sum every _MARK_NS, with its stamp

    def state(self) -> PositionState:
        """Returns what later sections depend on."""
        return PositionState(
            self.number, self.since_ns, self._newest, tuple(self._begun), self._sum_m, tuple(self._sums)
        )

    def resume(self, state: PositionState) -> None:
        """Continues from a state."""
        self.number, self.since_ns, self._newest = state.number, state.since_ns, state.newest
        self._begun = deque(state.begun, maxlen=_MOST)
        self._sum_m, self._sums = state.sum_m, deque(state.sums)

    def take(self, sample: PoseSample) -> None:
        """Handles a position. One that is not newer than the newest changes nothing, unless the stamps restart."""
        newest = self._newest
        if newest is not None and newest.t_ns - RESTART_NS < sample.t_ns <= newest.t_ns:
            return
        self._newest = sample
        if newest is None or not 0 < sample.t_ns - newest.t_ns <= LONGEST_NS:
            self._begin(sample, jumped=newest is not None)
        elif sample.reset_counter != newest.reset_counter or self._stepped(newest, sample):
            self._begin(sample, jumped=True)
        elif self._drifted(newest, sample):
            self._begin(sample, jumped=False)

    @property
    def begins_ns(self) -> int:
        """Stamp of the first position of the present section; 0: there is none."""
        return self._begun[-1].begins_ns if self._begun else 0

    def at(self, t_ns: int) -> Section:
        """Returns the section of a position with this stamp."""
        return next((s for s in reversed(self._begun) if s.begins_ns <= t_ns), NO_SECTION)

    def _begin(self, sample: PoseSample, *, jumped: bool) -> None:
        self.number, self.since_ns = self.number + 1, sample.t_arrival_ns
        before_ns = self._begun[-1].jump_ns if self._begun else 0
        self._begun.append(Section(self.number, sample.t_ns, sample.t_ns if jumped else before_ns))
        self._sum_m = (0.0, 0.0, 0.0)
        self._sums.clear()
        self._sums.append((sample.t_ns, self._sum_m))

    def _stepped(self, before: PoseSample, after: PoseSample) -> bool:
        """True if the velocities at two positions do not explain the distance between them."""
        if _unexplained_m(before, after) is None:
            way_m = math.dist(before.position_ned_m, after.position_ned_m)
            return way_m > JUMP_M + UNKNOWN_SPEED_M_S * (after.t_ns - before.t_ns) / NS
        return contradict(before, after)

    def _drifted(self, before: PoseSample, after: PoseSample) -> bool:
        """True if what the velocities do not explain has added up to more than the limit of one step."""
        step_m = _unexplained_m(before, after)
        if step_m is None:
            return False
        x, y, z = (a + b for a, b in zip(self._sum_m, step_m, strict=True))
        self._sum_m = (x, y, z)
        if any(math.dist(sum_m, self._sum_m) > _limit_m(before, after) for _, sum_m in self._sums):
            return True
        if after.t_ns - self._sums[-1][0] >= _MARK_NS:
            self._sums.append((after.t_ns, self._sum_m))
        while after.t_ns - self._sums[0][0] > WINDOW_NS and len(self._sums) > 1:
            self._sums.popleft()
        return False


def contradict(before: PoseSample, after: PoseSample) -> bool:
    """Returns whether the velocities at two positions do not explain the distance between them: one of both is of another instant
    than its stamp, or the estimate jumped. False where no velocities are known."""
    step_m = _unexplained_m(before, after)
    return step_m is not None and math.hypot(*step_m) > _limit_m(before, after)


def _limit_m(before: PoseSample, after: PoseSample) -> float:
    return JUMP_M + JUMP_SPEED_M_S * (after.t_ns - before.t_ns) / NS


def _unexplained_m(before: PoseSample, after: PoseSample) -> Vector | None:
    """Returns the part of the step between two positions that their velocities do not explain; None: no velocity is
    known."""
    time_s = (after.t_ns - before.t_ns) / NS
    velocities = [s.velocity_ned_m_s for s in (before, after) if s.velocity_ned_m_s is not None]
    if not velocities:
        return None
    mean_m_s = [sum(v) / len(velocities) for v in zip(*velocities, strict=True)]
    way_m = [b - a for a, b in zip(before.position_ned_m, after.position_ned_m, strict=True)]
    x, y, z = (w - v * time_s for w, v in zip(way_m, mean_m_s, strict=True))
    return x, y, z

"""Detects jumps of the autopilot's heading estimate.

Both autopilots reset the heading in flight, for example after take-off or when the compass contradicts GPS. ATTITUDE
and ATTITUDE_QUATERNION do not report it: a turn that the body rates do not explain counts as a jump. The vehicle has
not turned. What was placed by the heading before the jump is rotated by it.

The limit grows with the time between two attitudes, because the rates may change between them. After LONGEST_NS, or when
small turns have added up within WINDOW_NS, the heading may have jumped by an unknown angle."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from core.types import AttitudeSample

from .quaternion import Quaternion, conjugate, normalised, plausible_rates, product, rotate_by_rates, to_rotation_vector

NS: Final = 1_000_000_000
JUMP_RAD: Final = math.radians(3.0)
"""Smallest turn that counts as a jump."""
RATE_CHANGE_RAD_S2: Final = 10.0
"""Largest change of the rates between two attitudes that these do not show: up and back within the time between them."""
UNKNOWN_RATE_RAD_S: Final = 6.0
"""The limit grows by this times the time between two attitudes if no rates are known."""
LONGEST_NS: Final = NS // 4
"""After a longer time without an attitude the heading may have jumped unnoticed: the limit would be 12 degrees."""
DRIFT_RAD: Final = math.radians(10.0)
"""Largest sum of unexplained turns within WINDOW_NS. In recordings without a jump it is up to 7.6 degrees."""
WINDOW_NS: Final = 3 * NS
"""Time for which obstacles and free space are remembered by default."""
RESTART_NS: Final = NS
"""A stamp that steps back by this means that the autopilot has restarted."""
_MARK_NS: Final = NS // 4
_MOST: Final = 16
Jumps = tuple[tuple[int, float], ...]
"""Of each jump the stamp of the first attitude after it, ns, and its angle, clockwise, rad. 0: the heading may have
jumped by an unknown angle."""


@dataclass(frozen=True, slots=True)
class HeadingState:
    """What the detection of later jumps depends on, see HeadingJumps."""

    number: int = 0
    turned_rad: float = 0.0
    gap_ns: int = 0
    newest: AttitudeSample | None = None  # attitude
    jumps: Jumps = ()
    sum_rad: float = 0.0  # of the unexplained turns since the newest jump
    sums: tuple[tuple[int, float], ...] = ()  # that sum every _MARK_NS, with its stamp


@dataclass(slots=True)
class HeadingJumps:
    """The jumps so far. `take` gets each attitude, in order of arrival."""

    number: int = 0  # number of jumps, and of gaps in which one may have happened
    turned_rad: float = 0.0  # sum of the jumps, clockwise
    # stamp of the first attitude after the newest gap, ns; 0: there was none. By which angle the heading has jumped in
    # it is not known: what was seen before cannot be rotated by it.
    gap_ns: int = 0
    _newest: AttitudeSample | None = None
    _jumps: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=_MOST))  # stamp, jump
    _sum_rad: float = 0.0  # of the unexplained turns since the newest jump
    _sums: deque[tuple[int, float]] = field(default_factory=deque)  # that sum every _MARK_NS, with its stamp

    def state(self) -> HeadingState:
        """Returns what later jumps depend on."""
        return HeadingState(
            self.number,
            self.turned_rad,
            self.gap_ns,
            self._newest,
            tuple(self._jumps),
            self._sum_rad,
            tuple(self._sums),
        )

    def resume(self, state: HeadingState) -> None:
        """Continues from a state."""
        self.number, self.turned_rad, self.gap_ns, self._newest = (
            state.number,
            state.turned_rad,
            state.gap_ns,
            state.newest,
        )
        self._jumps = deque(state.jumps, maxlen=_MOST)
        self._sum_rad, self._sums = state.sum_rad, deque(state.sums)

    def take(self, sample: AttitudeSample) -> None:
        """Handles an attitude. One that is not newer than the newest changes nothing, unless the stamps restart."""
        newest = self._newest
        if newest is None:
            self._newest = sample
            return
        if newest.t_ns - RESTART_NS < sample.t_ns <= newest.t_ns:
            return
        self._newest = sample
        if sample.t_ns < newest.t_ns:
            self._jumps.clear()
        if not 0 < sample.t_ns - newest.t_ns <= LONGEST_NS:
            self.gap_ns = sample.t_ns
            self._jumped(sample.t_ns, 0.0)
        elif (jump_rad := heading_jump_rad(newest, sample)) != 0.0:
            self._jumped(sample.t_ns, jump_rad)
        elif self._drifted(newest, sample):
            self._jumped(sample.t_ns, 0.0)

    def _jumped(self, t_ns: int, jump_rad: float) -> None:
        self.number += 1
        self.turned_rad += jump_rad
        self._jumps.append((t_ns, jump_rad))
        self._sum_rad = 0.0
        self._sums.clear()

    def _drifted(self, before: AttitudeSample, after: AttitudeSample) -> bool:
        """Returns whether what the rates do not explain has added up to more than DRIFT_RAD within WINDOW_NS."""
        turn = _unexplained(before, after)
        if turn.known:
            self._sum_rad += turn.angle_rad
        if not self._sums or after.t_ns - self._sums[-1][0] >= _MARK_NS:
            self._sums.append((after.t_ns, self._sum_rad))
        while after.t_ns - self._sums[0][0] > WINDOW_NS:
            self._sums.popleft()
        return any(abs(self._sum_rad - sum_rad) > DRIFT_RAD for _, sum_rad in self._sums)

    @property
    def jump_ns(self) -> int:
        """Stamp of the first attitude after the newest jump, known or possible; 0: there is none."""
        return self._jumps[-1][0] if self._jumps else 0

    def newest_ns(self, t_ns: int) -> int:
        """Returns the stamp of the first attitude after the newest jump, known or possible, of those up to t_ns; 0: there
        is none."""
        return next((at_ns for at_ns, _ in reversed(self._jumps) if at_ns <= t_ns), 0)

    def up_to(self, t_ns: int) -> Jumps:
        """Returns the newest jumps, known or possible, up to an instant, the oldest first."""
        return tuple(jump for jump in self._jumps if jump[0] <= t_ns)

    def since_rad(self, t_ns: int) -> float:
        """Returns the sum of the known jumps after an instant, clockwise."""
        return sum(jump_rad for at_ns, jump_rad in self._jumps if at_ns > t_ns)


class Turn(NamedTuple):
    """The turn about the vertical between two attitudes that the rates do not explain."""

    angle_rad: float  # clockwise
    whole_rad: float  # about any axis, at least 0
    limit_rad: float  # a larger one is a jump
    known: bool  # whether rates are known


def heading_jump_rad(before: AttitudeSample, after: AttitudeSample) -> float:
    """Returns the turn about the vertical, clockwise, that the rates of two successive attitudes do not explain; 0 if it
    is within the limit."""
    turn = _unexplained(before, after)
    return turn.angle_rad if abs(turn.angle_rad) > turn.limit_rad else 0.0


def contradict(before: AttitudeSample, after: AttitudeSample) -> bool:
    """Returns whether the rates of two attitudes do not explain the turn between them, about any axis: one of both is of another
    instant than its stamp, or the estimate jumped. False where no rates are known."""
    turn = _unexplained(before, after)
    return turn.known and turn.whole_rad > turn.limit_rad


def _unexplained(before: AttitudeSample, after: AttitudeSample) -> Turn:
    """Expects a turn by the mean of the rates at both attitudes.

    The mean is wrong by at most half of the change of the rates, and, where they change by RATE_CHANGE_RAD_S2 and back,
    by a quarter of that times the square of the time."""
    dt_s = (after.t_ns - before.t_ns) / NS
    rates = [r for r in (plausible_rates(s.rates_frd_rad_s) for s in (before, after)) if r is not None]
    x, y, z = (sum(r) / len(rates) for r in zip(*rates, strict=True)) if rates else (0.0, 0.0, 0.0)
    expected = rotate_by_rates(before.q_ned_frd_wxyz, (x, y, z), dt_s)
    turned = product(normalised(after.q_ned_frd_wxyz), conjugate(expected))
    angle_rad, whole_rad = _about_vertical_rad(turned), math.hypot(*to_rotation_vector(turned))
    if not rates:
        return Turn(angle_rad, whole_rad, JUMP_RAD + UNKNOWN_RATE_RAD_S * dt_s, False)
    change_rad_s = math.dist(*rates) if len(rates) == 2 else RATE_CHANGE_RAD_S2 * dt_s
    limit_rad = JUMP_RAD + 0.5 * change_rad_s * dt_s + 0.25 * RATE_CHANGE_RAD_S2 * dt_s**2
    return Turn(angle_rad, whole_rad, limit_rad, True)


def _about_vertical_rad(q_ned: Quaternion) -> float:
    """Returns the part of a rotation in ned that is about the vertical, -pi to pi."""
    return math.remainder(2.0 * math.atan2(q_ned[3], q_ned[0]), math.tau)

"""Detects jumps of the autopilot's heading estimate.

Both autopilots reset the heading in flight, for example after take-off or when the compass contradicts GPS. ATTITUDE
and ATTITUDE_QUATERNION do not report it: a turn that the body rates do not explain counts as a jump. The vehicle has
not turned. What was placed by the heading before the jump is rotated by it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from core.types import AttitudeSample

from .quaternion import Quaternion, conjugate, normalised, product, rotate_by_rates

NS: Final = 1_000_000_000
JUMP_RAD: Final = math.radians(3.0)
"""Smallest turn that counts as a jump."""
SLACK_RAD_S: Final = 2.0
"""The limit grows by this times the time between two attitudes, because the rates may change between them."""
UNKNOWN_RATE_RAD_S: Final = 6.0
"""The same if no rates are known."""
LONGEST_NS: Final = NS // 2
"""After a longer time without an attitude the heading may have jumped unnoticed."""
RESTART_NS: Final = NS
"""A stamp that steps back by this means that the autopilot has restarted."""
_MOST: Final = 16
Jumps = tuple[tuple[int, float], ...]
"""Of each jump the stamp of the first attitude after it, ns, and its angle, clockwise, rad."""


@dataclass(slots=True)
class HeadingJumps:
    """The jumps so far. `take` gets each attitude, in order of arrival.

    Attributes:
        number: number of jumps, and of gaps in which one may have happened.
        turned_rad: sum of the jumps, clockwise."""

    number: int = 0
    turned_rad: float = 0.0
    _newest: AttitudeSample | None = None
    _jumps: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=_MOST))  # stamp, jump

    def take(self, sample: AttitudeSample) -> None:
        """Handles an attitude. One that is not newer than the newest changes nothing, unless the stamps restart."""
        newest = self._newest
        if newest is None:
            self._newest = sample
            return
        if newest.t_ns - RESTART_NS < sample.t_ns <= newest.t_ns:
            return
        jump_rad = 0.0
        if not 0 < sample.t_ns - newest.t_ns <= LONGEST_NS:
            self.number += 1
            if sample.t_ns < newest.t_ns:
                self._jumps.clear()
        else:
            jump_rad = heading_jump_rad(newest, sample)
        if jump_rad != 0.0:
            self.number += 1
            self.turned_rad += jump_rad
            self._jumps.append((sample.t_ns, jump_rad))
        self._newest = sample

    def newest_ns(self, t_ns: int) -> int:
        """Returns the stamp of the first attitude after the newest jump, of the jumps up to t_ns; 0: there is none."""
        return next((at_ns for at_ns, _ in reversed(self._jumps) if at_ns <= t_ns), 0)

    def up_to(self, t_ns: int) -> Jumps:
        """Returns the newest known jumps up to an instant, the oldest first."""
        return tuple(jump for jump in self._jumps if jump[0] <= t_ns)

    def since_rad(self, t_ns: int) -> float:
        """Returns the sum of the known jumps after an instant, clockwise."""
        return sum(jump_rad for at_ns, jump_rad in self._jumps if at_ns > t_ns)


def heading_jump_rad(before: AttitudeSample, after: AttitudeSample) -> float:
    """Returns the turn about the vertical, clockwise, that the rates of two successive attitudes do not explain; 0 if it
    is within the limit."""
    dt_s = (after.t_ns - before.t_ns) / NS
    rates = [s.rates_frd_rad_s for s in (before, after) if s.rates_frd_rad_s is not None]
    x, y, z = (sum(r) / len(rates) for r in zip(*rates, strict=True)) if rates else (0.0, 0.0, 0.0)
    expected = rotate_by_rates(before.q_ned_frd_wxyz, (x, y, z), dt_s)
    jump_rad = _about_vertical_rad(product(normalised(after.q_ned_frd_wxyz), conjugate(expected)))
    limit_rad = JUMP_RAD + (SLACK_RAD_S if rates else UNKNOWN_RATE_RAD_S) * dt_s
    return jump_rad if abs(jump_rad) > limit_rad else 0.0


def _about_vertical_rad(q_ned: Quaternion) -> float:
    """Returns the part of a rotation in ned that is about the vertical, -pi to pi."""
    return math.remainder(2.0 * math.atan2(q_ned[3], q_ned[0]), math.tau)

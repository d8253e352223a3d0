"""The speed limit of the guard: when it is sent, lowered, repeated and raised. It has no clock and no link."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, auto
from statistics import fmean

from drivers.mavlink.dialect import dialect

from ..config.guard import GuardParams
from .assessment import LIMIT_STEP_M_S, Action, Verdict

NS = 1_000_000_000
LEAST_LIMIT_M_S = 1.0
"""Lowest limit; below it only a stop follows."""
RAISE_AFTER_NS = 3 * NS
"""A limit is raised when a higher one was allowed for this time."""
APART_NS = NS // 2
"""Least time between two commands."""
EXCESS_M_S, EXCESS_NS = 0.5, 2 * NS
"""A vehicle does not follow its limit if it is faster by EXCESS_M_S and has not slowed down by EXCESS_M_S within
EXCESS_NS after its greatest speed."""
KEPT_SLOWER_M_S = 0.2
"""The mission or a ground station keeps a vehicle slower than its limit if its average speed over RAISE_AFTER_NS is lower
by more than this. Noise of the measured speed and gusts average out."""
FOLLOWS_NS = NS
"""A vehicle follows its limit if it is not faster this long after the command. Before that, limited jerk may still
exceed it."""
TRIES = 3
"""A limit that is not acknowledged is sent this many times; the stop does not depend on it."""
ACCEPTED = dialect.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED = dialect.MAV_RESULT_TEMPORARILY_REJECTED
IN_PROGRESS = dialect.MAV_RESULT_IN_PROGRESS
"""All other results mean that the command has no effect."""


class LimitState(Enum):
    """What the newest command has become."""

    IN_USE = auto()
    """The autopilot accepts limits, or none was sent yet."""
    REFUSED = auto()
    """The autopilot accepts no limit in this mode."""
    INEFFECTIVE = auto()
    """The vehicle does not follow the limit, which is then not in force."""
    ENDED = auto()
    """The limit sent last is the speed before the first limit again."""


@dataclass(slots=True)
class SpeedLimiter:
    """Decides which limit to send; see `wanted`."""

    guard: GuardParams
    speed_m_s: float = 0.0  # the limit in force; 0: none
    fastest_m_s: float = 0.0  # speed of the vehicle just before the first limit
    state: LimitState = LimitState.IN_USE  # what the newest command has become
    _sent_ns: int | None = None
    _result: int | None = None
    _tries: int = 0
    _free_since_ns: int | None = None
    _free_speeds_m_s: list[float] = field(default_factory=list)
    _excess: tuple[int, float] | None = None
    _followed: bool = False

    def acknowledged(self, result: int) -> None:
        """Handles a COMMAND_ACK of MAV_CMD_DO_CHANGE_SPEED for the service."""
        if self._sent_ns is not None and self._result in (None, IN_PROGRESS):
            self._result = result
            if result not in (ACCEPTED, TEMPORARILY_REJECTED, IN_PROGRESS):
                self.state = LimitState.REFUSED

    def wanted(self, verdict: Verdict, now_ns: int) -> float | None:
        """Returns the limit to send now, in m/s; None: nothing is to be sent.

        MAV_CMD_DO_CHANGE_SPEED sets the speed: a value above that of the mission would make the vehicle faster. The
        first limit is therefore not above the speed of the vehicle, and a limit is raised to at most that speed.
        cruise_m_s, if it is set, limits both."""
        speed_m_s = verdict.speed_m_s
        if speed_m_s is None:
            return None
        self._follow_effect(speed_m_s, now_ns)
        if self.state is LimitState.INEFFECTIVE:
            return None
        if self._sent_ns is not None and now_ns - self._sent_ns < APART_NS:
            return None
        allowed_m_s = max(LEAST_LIMIT_M_S, _stepped(verdict.allowed_m_s))
        if self.speed_m_s <= 0.0:
            cap_m_s = min(speed_m_s, self.guard.cruise_m_s or speed_m_s)
            first_m_s = max(LEAST_LIMIT_M_S, min(allowed_m_s, _stepped(cap_m_s)))
            if verdict.action is not Action.SLOW or first_m_s > cap_m_s:
                return None
            self.fastest_m_s = cap_m_s
            return self._send(first_m_s, now_ns)
        if verdict.action is Action.SLOW and allowed_m_s < self.speed_m_s:
            return self._send(allowed_m_s, now_ns)
        if verdict.action is Action.SLOW and self._followed and speed_m_s > self.speed_m_s + EXCESS_M_S:
            return self._send(self.speed_m_s, now_ns)  # the mission has set another speed
        if self._result in (None, TEMPORARILY_REJECTED) and self._tries < TRIES:
            return self._send(self.speed_m_s, now_ns)
        return self._raised(allowed_m_s, speed_m_s, now_ns)

    def _follow_effect(self, speed_m_s: float, now_ns: int) -> None:
        """Detects a limit that the vehicle does not follow: the mission has set another speed, or the autopilot
        ignores it."""
        if self.speed_m_s <= 0.0 or speed_m_s <= self.speed_m_s + EXCESS_M_S:
            settled = self._sent_ns is not None and now_ns - self._sent_ns >= FOLLOWS_NS
            self._excess, self._followed = None, self._followed or (settled and self.speed_m_s > 0.0)
        elif self._excess is None or not self._excess[1] - EXCESS_M_S < speed_m_s <= self._excess[1]:
            self._excess = now_ns, speed_m_s  # also while the speed still rises, because jerk is limited
        elif now_ns - self._excess[0] >= EXCESS_NS:
            self.state = LimitState.INEFFECTIVE

    def _raised(self, allowed_m_s: float, speed_m_s: float, now_ns: int) -> float | None:
        """Returns a higher limit after it was allowed for RAISE_AFTER_NS; None: none.

        It never exceeds the speed before the limit, and rises by at least two steps unless that speed is reached. For
        a vehicle that is slower than its limit no limit is raised: the mission or a ground station keeps it slow, and
        it would get faster than they have commanded."""
        target_m_s = min(allowed_m_s, self.fastest_m_s)
        if speed_m_s < self.speed_m_s - EXCESS_M_S:
            self._free_since_ns = None
            return None
        worthwhile = target_m_s >= self.speed_m_s + 2.0 * LIMIT_STEP_M_S or target_m_s == self.fastest_m_s
        if target_m_s <= self.speed_m_s or not worthwhile:
            self._free_since_ns = None
            return None
        if self._free_since_ns is None:
            self._free_since_ns, self._free_speeds_m_s = now_ns, []
        self._free_speeds_m_s.append(speed_m_s)
        if now_ns - self._free_since_ns < RAISE_AFTER_NS:
            return None
        if fmean(self._free_speeds_m_s) < self.speed_m_s - KEPT_SLOWER_M_S:
            self._free_since_ns = None
            return None
        if target_m_s == self.fastest_m_s:
            self.state = LimitState.ENDED
        return self._send(target_m_s, now_ns)

    def _send(self, speed_m_s: float, now_ns: int) -> float:
        self._tries = self._tries + 1 if speed_m_s == self.speed_m_s else 1
        self.speed_m_s, self._sent_ns, self._result = speed_m_s, now_ns, None
        self._free_since_ns, self._excess, self._followed = None, None, False
        return speed_m_s


def _stepped(speed_m_s: float) -> float:
    """Rounds down to a multiple of LIMIT_STEP_M_S."""
    return math.floor(speed_m_s / LIMIT_STEP_M_S) * LIMIT_STEP_M_S

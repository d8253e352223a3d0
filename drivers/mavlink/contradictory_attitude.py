"""Detects attitudes of two vehicles that use the same ids.

Messages of both alternate. Where their boot clocks differ by less than a second, their timestamps do not show it: messages of the
vehicle that started later look as if the line had delayed them. A vehicle turns between two attitudes by no more than its body
rates explain, except at a reset of its estimate, which is a single turn."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from typing import Final

NS: Final = 1_000_000_000
KEPT_NS: Final = 2 * NS
"""Attitudes are kept for this time before the newest one, by stamp and by arrival: refused are stamps that are a second back, and of
a kind that arrives no longer what is kept may be of the boot before."""
APART_NS: Final = NS // 8
"""Attitudes that are further apart are not compared: a vehicle tilts by tens of degrees and back to its rates. Those of two vehicles
with 4 each per second are closer."""
LEAST_RAD: Final = math.radians(3.0)
RATE_CHANGE_RAD_S2: Final = 40.0
"""Largest change of the rates between two attitudes that these do not show: up and back within the time between them. A multirotor
begins or ends to tilt with 220 degrees a second (PX4, MC_ROLLRATE_MAX) within 0.1 s."""
UNKNOWN_RATE_RAD_S: Final = 6.0
"""Largest rate of attitudes whose rates are not known."""
ROUNDING_NS: Final = 1_000_000
"""Timestamps have a resolution of a millisecond."""
FEWEST: Final = 5
WITHIN_NS: Final = 2 * NS
"""So many contradictions within this time are not resets of the estimate: each is one."""
LASTS_NS: Final = 10 * NS
"""No attitude is used for this time after contradictions."""

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


class ContradictoryAttitude:
    """Takes all attitudes of one kind of the autopilot's ids in order of arrival."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._attitudes: list[tuple[Quaternion, Vector | None]] = []
        self._contradictions: deque[int] = deque(maxlen=FEWEST)  # arrivals
        self._arrived_ns = 0  # the newest one
        self._until_ns = 0

    def take(self, boot_ns: int, arrival_ns: int, q_ned_frd_wxyz: Quaternion, rates_rad_s: Vector | None) -> None:
        """Takes an attitude. boot_ns: its timestamp; q_ned_frd_wxyz: of length 1."""
        rebooted = bool(self._stamps) and boot_ns < self._stamps[-1] - KEPT_NS
        if rebooted or arrival_ns - self._arrived_ns > KEPT_NS:
            self._stamps.clear()
            self._attitudes.clear()
        self._arrived_ns = arrival_ns
        at = bisect_left(self._stamps, boot_ns)
        new = (q_ned_frd_wxyz, rates_rad_s)
        beside = range(max(0, at - 1), min(at + 1, len(self._stamps)))
        near = [(self._attitudes[k], abs(boot_ns - self._stamps[k])) for k in beside]
        near = [(other, apart_ns) for other, apart_ns in near if apart_ns <= APART_NS]
        # of a single turn that is not explained, at a reset, a late message fits the attitudes on one side
        if near and all(_contradict(new, other, apart_ns) for other, apart_ns in near):
            self._contradictions.append(arrival_ns)
        self._stamps.insert(at, boot_ns)
        self._attitudes.insert(at, new)
        old = bisect_left(self._stamps, self._stamps[-1] - KEPT_NS)
        del self._stamps[:old], self._attitudes[:old]
        if len(self._contradictions) == FEWEST and arrival_ns - self._contradictions[0] < WITHIN_NS:
            self._until_ns = self._contradictions[-1] + LASTS_NS

    def found(self, now_ns: int) -> bool:
        """Returns whether attitudes contradict each other, so that none must be used."""
        return now_ns < self._until_ns


def _contradict(a: tuple[Quaternion, Vector | None], b: tuple[Quaternion, Vector | None], apart_ns: int) -> bool:
    """Returns whether the vehicle would have turned between two attitudes by more than the rates at both explain."""
    apart_s = (apart_ns + ROUNDING_NS) / NS
    rates = [math.hypot(*r) for r in (a[1], b[1]) if r is not None]
    most_rad = LEAST_RAD + max(rates, default=UNKNOWN_RATE_RAD_S) * apart_s
    most_rad += 0.25 * RATE_CHANGE_RAD_S2 * apart_s**2
    cosine = abs(sum(p * q for p, q in zip(a[0], b[0], strict=True)))
    return 2.0 * math.acos(min(1.0, cosine)) > most_rad

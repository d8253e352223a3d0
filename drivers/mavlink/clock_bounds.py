"""Bounds of the offset between two clocks, and the line through them: the arithmetic of `clock_sync`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

NS = 1_000_000_000
MS = 1_000_000
MAX_DRIFT = 150e-6
"""Largest frequency difference of both clocks."""
DRIFT_SPAN_NS = 5 * NS
"""Shorter spans cannot separate drift from jitter."""


@dataclass(frozen=True, slots=True)
class Bound:
    """low <= offset <= high at boot_ns. low None: no lower bound."""

    boot_ns: int
    low: int | None
    high: int

    @property
    def rtt_ns(self) -> int:
        """The round-trip time of an exchange."""
        return self.high - (self.high if self.low is None else self.low)

    def slack_ns(self, at_ns: int) -> int:
        """Returns by how much the bound is wider at another instant."""
        return round(MAX_DRIFT * abs(at_ns - self.boot_ns))


def common_offsets(bounds: Sequence[Bound], at_ns: int) -> tuple[int, int] | None:
    """Returns the least and greatest offset at at_ns that no bound excludes; None if there are none."""
    low = max((b.low - b.slack_ns(at_ns) for b in bounds if b.low is not None), default=None)
    high = min((b.high + b.slack_ns(at_ns) for b in bounds), default=None)
    if low is None or high is None or low > high:
        return None
    return low, high


def extended(interval: tuple[int, int], doubtful: Sequence[Bound], at_ns: int) -> tuple[int, int]:
    """Returns the interval extended to what contradicting answers show.

    A clock that is corrected, as by NTP, runs faster or slower than MAX_DRIFT permits: then the newest answer is right,
    and the others are wrong now."""
    low, high = interval
    for b in doubtful:
        low = min(low, (b.high if b.low is None else b.low) - b.slack_ns(at_ns))
        high = max(high, b.high + b.slack_ns(at_ns))
    return low, high


def line_through(exchanges: Sequence[Bound], at_ns: int) -> tuple[int, float]:
    """Returns (offset at at_ns, drift) of the weighted least-squares line through the middles of the exchanges.

    The error of a middle is at most half of the difference between its round-trip time and the shortest one, plus
    an error that all share. The weights are the inverse square of that."""
    quickest = min(b.rtt_ns for b in exchanges)
    first = exchanges[0]
    base = first.high
    sw = sx = sy = sxx = sxy = 0.0
    for b in exchanges:
        x = (b.boot_ns - at_ns) / NS
        y = 0.5 * ((b.low or 0) + b.high) - base
        w = 1.0 / (0.5 * (b.rtt_ns - quickest) + 0.05 * quickest + 20_000.0) ** 2
        sw, sx, sy = sw + w, sx + w * x, sy + w * y
        sxx, sxy = sxx + w * x * x, sxy + w * x * y
    drift = 0.0
    scatter = sxx - sx * sx / sw
    if exchanges[-1].boot_ns - first.boot_ns >= DRIFT_SPAN_NS and scatter > 0.0:
        limit = MAX_DRIFT * NS
        drift = min(max((sxy - sx * sy / sw) / scatter, -limit), limit)
    return base + round((sy - drift * sx) / sw), drift / NS

"""The autopilot's boot clock on our monotonic clock, with a bound that is proven, not hoped for.

local = boot + offset. Two facts bound the offset, whatever the delays of the link are: an answer to our TIMESYNC was
stamped after we asked and before we had it (ts1 - tc1 <= offset <= now - tc1), and no message arrives before it was
measured (offset <= arrival - boot). Between two instants the offset moves by at most `max_drift` of the time between
them. All bounds together leave an interval; the estimate is the line through the quickest exchanges, kept inside it.
Nothing here looks at a clock or does input or output, so a replay finds the same estimates.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from core.param_field import check, number

NS = 1_000_000_000


class ClockSource(IntEnum):
    """What an estimate rests on."""

    NONE = 0
    ENVELOPE = 1
    """No answer to TIMESYNC yet: the quickest messages are taken to have needed no time. Late by their least delay."""
    TIMESYNC = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockParams:
    """Raises ValueError naming the field, its value and its range."""

    max_drift: float = number(150e-6, 1e-6, 1e-3, "", "largest frequency difference of both clocks")
    window_s: float = number(60.0, 2.0, 600.0, "s", "older exchanges are not used")
    drift_span_s: float = number(5.0, 1.0, 300.0, "s", "shorter spans cannot separate drift from jitter")
    min_exchanges: int = number(3, 1, 50, "", "answers before the clock is called synchronised")
    max_rtt_s: float = number(0.5, 0.01, 5.0, "s", "slower answers are not used")
    reboot_step_s: float = number(1.0, 0.1, 60.0, "s", "boot time that goes back this far is a reboot")
    reboot_messages: int = number(5, 1, 50, "", "messages in a row that lie so far back; one alone is only late")
    strange_exchanges: int = number(
        3, 2, 20, "", "answers in a row that contradict the rest mean a step: restart the estimate"
    )

    def __post_init__(self) -> None:
        check("clock", self)


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """local_ns = boot_ns + offset_ns + drift * (boot_ns - at_boot_ns), surely within bound_ns at at_boot_ns.

    bound_ns: None where only the envelope is known: the true instant may be earlier by any delay. rtt_ns: the quickest
    exchange of the window."""

    source: ClockSource
    offset_ns: int = 0
    drift: float = 0.0
    at_boot_ns: int = 0
    bound_ns: int | None = None
    rtt_ns: int | None = None
    exchanges: int = 0

    def local_ns(self, boot_ns: int) -> int:
        """An instant of the autopilot's boot clock on ours."""
        return boot_ns + self.offset_ns + round(self.drift * (boot_ns - self.at_boot_ns))


@dataclass(frozen=True, slots=True)
class _Bound:
    """offset >= low, offset <= high at boot_ns (None: not bounded on that side)."""

    boot_ns: int
    low: int | None
    high: int


class ClockFilter:
    """Takes exchanges and arrivals in, gives the estimate. `restarts` counts reboots and steps, `strange` answers that
    contradicted the rest, `slow` answers that came too late."""

    def __init__(self, params: ClockParams | None = None) -> None:
        self.params = params or ClockParams()
        self.estimate = ClockEstimate(ClockSource.NONE)
        self.restarts = self.strange = self.slow = 0
        self._exchanges: deque[_Bound] = deque()
        self._doubtful: list[_Bound] = []
        self._arrivals: deque[_Bound] = deque()
        self._newest_boot_ns: int | None = None
        self._back = 0

    def restart(self) -> None:
        """Forgets everything: the autopilot is another one, or has booted."""
        self.restarts += 1
        self._forget()

    def _forget(self) -> None:
        self._exchanges.clear()
        self._arrivals.clear()
        self._doubtful.clear()
        self._back = 0
        self._newest_boot_ns = None
        self.estimate = ClockEstimate(ClockSource.NONE)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def arrival(self, boot_ns: int, arrival_ns: int) -> bool:
        """A message measured at boot_ns (rounded down) arrived at arrival_ns: it was not measured later than that.

        False: it lies so far back that it is either very late or the first after a reboot; do not use it."""
        if self._is_back(boot_ns):
            self._back += 1
            if self._back < self.params.reboot_messages:
                return False
            self.restart()
        self._back = 0
        self._newest_boot_ns = max(boot_ns, self._newest_boot_ns or boot_ns)
        high = arrival_ns - boot_ns
        newest = self._arrivals[-1] if self._arrivals else None
        if newest is not None and boot_ns - newest.boot_ns < NS:
            if high >= newest.high:
                return True
            self._arrivals.pop()
        self._arrivals.append(_Bound(boot_ns, None, high))
        self._trim(boot_ns)
        if self.estimate.source is not ClockSource.TIMESYNC:
            self._envelope(boot_ns)
        return True

    def exchange(self, ts1_ns: int, tc1_ns: int, now_ns: int) -> bool:
        """An answer: we asked at ts1_ns, the autopilot's clock said tc1_ns, we had it at now_ns. False: not used."""
        if not 0 <= now_ns - ts1_ns <= self.params.max_rtt_s * NS:
            self.slow += 1
            return False
        if self._is_back(tc1_ns):
            self.restart()
        self._newest_boot_ns = max(tc1_ns, self._newest_boot_ns or tc1_ns)
        new = _Bound(tc1_ns, ts1_ns - tc1_ns, now_ns - tc1_ns)
        if self._exchanges and not self._fits(new):
            return self._doubt(new)
        self._doubtful.clear()
        self._exchanges.append(new)
        self._trim(tc1_ns)
        self._estimate(tc1_ns)
        return True

    def _is_back(self, boot_ns: int) -> bool:
        newest = self._newest_boot_ns
        return newest is not None and boot_ns < newest - self.params.reboot_step_s * NS

    def _doubt(self, new: _Bound) -> bool:
        """One contradiction is ignored; several in a row that agree with each other are a step."""
        self.strange += 1
        if self._doubtful and not _common([*self._doubtful, new], new.boot_ns, self.params.max_drift):
            self._doubtful.clear()
        self._doubtful.append(new)
        if len(self._doubtful) < self.params.strange_exchanges:
            return False
        kept = list(self._doubtful)
        self.restart()
        self._newest_boot_ns = new.boot_ns
        self._exchanges.extend(kept)
        self._estimate(new.boot_ns)
        return True

    def _fits(self, new: _Bound) -> bool:
        return _common([*self._exchanges, new], new.boot_ns, self.params.max_drift) is not None

    def _trim(self, boot_ns: int) -> None:
        oldest = boot_ns - round(self.params.window_s * NS)
        for bounds in (self._exchanges, self._arrivals):
            while len(bounds) > 1 and bounds[0].boot_ns < oldest:
                bounds.popleft()

    # ---- what it says -----------------------------------------------------------------------------------------------

    def _envelope(self, at_ns: int) -> None:
        drift = self.params.max_drift
        offset = min(b.high + round(drift * abs(at_ns - b.boot_ns)) for b in self._arrivals)
        self.estimate = ClockEstimate(ClockSource.ENVELOPE, offset_ns=offset, at_boot_ns=at_ns)

    def _estimate(self, at_ns: int) -> None:
        p = self.params
        bounds = [*self._exchanges, *self._arrivals]
        interval = _common(bounds, at_ns, p.max_drift) or _common(list(self._exchanges), at_ns, p.max_drift)
        if interval is None:  # exchanges agree with each other, see exchange()
            raise AssertionError("the exchanges held contradict each other")
        if len(self._exchanges) < p.min_exchanges:
            return
        offset, drift = self._line(at_ns)
        offset = min(max(offset, interval[0]), interval[1])
        self.estimate = ClockEstimate(
            ClockSource.TIMESYNC,
            offset_ns=offset,
            drift=drift,
            at_boot_ns=at_ns,
            bound_ns=max(interval[1] - offset, offset - interval[0]),
            rtt_ns=min(_rtt(b) for b in self._exchanges),
            exchanges=len(self._exchanges),
        )

    def _line(self, at_ns: int) -> tuple[int, float]:
        """(offset at at_ns, drift): the weighted least-squares line through the middles of the exchanges.

        An exchange's middle is off by at most half of what its RTT exceeds the quickest one's (plus what is common to
        all); weights are the inverse square of that."""
        quickest = min(_rtt(b) for b in self._exchanges)
        first = self._exchanges[0]
        base = first.high
        sw = sx = sy = sxx = sxy = 0.0
        for b in self._exchanges:
            x = (b.boot_ns - at_ns) / NS
            y = 0.5 * ((b.low or 0) + b.high) - base
            w = 1.0 / (0.5 * (_rtt(b) - quickest) + 0.05 * quickest + 20_000.0) ** 2
            sw, sx, sy = sw + w, sx + w * x, sy + w * y
            sxx, sxy = sxx + w * x * x, sxy + w * x * y
        drift = 0.0
        scatter = sxx - sx * sx / sw
        span_ns = self._exchanges[-1].boot_ns - first.boot_ns
        if span_ns >= self.params.drift_span_s * NS and scatter > 0.0:
            limit = self.params.max_drift * NS
            drift = min(max((sxy - sx * sy / sw) / scatter, -limit), limit)
        return base + round((sy - drift * sx) / sw), drift / NS


def _rtt(bound: _Bound) -> int:
    return bound.high - (bound.low if bound.low is not None else bound.high)


def _common(bounds: list[_Bound], at_ns: int, drift: float) -> tuple[int, int] | None:
    """The offsets at at_ns that no bound forbids, None when there are none."""
    low: int | None = None
    high: int | None = None
    for b in bounds:
        slack = round(drift * abs(at_ns - b.boot_ns))
        high = b.high + slack if high is None else min(high, b.high + slack)
        if b.low is not None:
            low = b.low - slack if low is None else max(low, b.low - slack)
    if low is None or high is None or low > high:
        return None
    return low, high

"""Estimates the autopilot's boot clock on the local monotonic clock, with a guaranteed bound.

local = boot + offset. Two facts limit the offset, whatever the delays of the link are. The answer to a TIMESYNC
request was stamped after the request was sent and before the answer arrived (ts1 - tc1 <= offset <= now - tc1). No
message arrives before it was measured (offset <= arrival - boot). Between two instants the offset changes by at most
`MAX_DRIFT` times the time between them. All bounds together give an interval. The estimate is the line through the
fastest exchanges, limited to the interval.

This module uses no clock and no input or output, so that a replay gives the same estimates."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from enum import IntEnum

from .clock_bounds import MAX_DRIFT, MS, NS, Bound, common_offsets, extended, line_through

WRAP_NS = 2**32 * MS
"""time_boot_ms has 32 bits and begins again after 49.7 days. The times of TIMESYNC and ODOMETRY do not."""
NEAR_WRAP_NS = 600 * NS
"""Longest time without a message in which the wrap is recognised. Any other step back is a reboot."""


SILENT_NS = NS // 2
"""Stamps that contradict the estimate mean a reboot or a step only if none that fits has arrived for this time."""
MIXED, MIXED_NS = 5, 10 * NS
"""So many changes between refused and used stamps within this time are not a reboot: two clocks, or late copies."""
UNKNOWN_DELAY_NS = 30 * MS
"""Delay that the fastest messages may have where TIMESYNC is not answered: on a busy line of 57600 baud. A stamp that is
ahead of them by more contradicts the estimate."""
KNOWN_SECONDS = 2
"""Arrivals of so many whole seconds are collected before the fastest of them count: the first ones may be delayed by more.
Of each second the fastest one is kept, and one second alone does not count: its stamp may be wrong."""
UNANSWERED_NS = 10 * NS
"""Stamps are used without an answer to TIMESYNC when messages have arrived for this time: a line may be as late, and the first
answer under way."""
WINDOW_NS = 60 * NS
"""Older exchanges are not used."""
MIN_EXCHANGES = 3
"""Answers before the clock is called synchronised."""
MAX_RTT_NS = NS // 2
"""Slower answers are not used, and show that arrivals may be late."""
REBOOT_STEP_NS = NS
"""Boot time that goes back this far is a reboot."""
REBOOT_MESSAGES = 5
"""Messages in a row that contradict the estimate; one alone is only late."""
STEP_EXCHANGES = 3
"""Answers in a row that contradict the rest mean a step: the estimate begins again."""
ANSWERS_NS = 2 * NS
"""Answers come twice a second. After a longer time without one the estimate is made again at arrivals."""


class ClockSource(IntEnum):
    """The basis of an estimate."""

    NONE = 0
    ENVELOPE = 1
    """No answer to TIMESYNC within `WINDOW_NS`: the fastest messages count as not delayed. The estimate is late by their
    least delay."""
    TIMESYNC = 2


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """Estimate local_ns = boot_ns + offset_ns + drift * (boot_ns - at_boot_ns), guaranteed within bound_ns at
    at_boot_ns."""

    source: ClockSource
    offset_ns: int = 0
    drift: float = 0.0
    at_boot_ns: int = 0
    bound_ns: int | None = None  # None: only the envelope is known, and the true instant may be earlier by any delay
    rtt_ns: int | None = None  # round-trip time of the fastest exchange in the window
    exchanges: int = 0  # number of exchanges in the window

    def local_ns(self, boot_ns: int) -> int:
        """Returns an instant of the autopilot's boot clock on the local clock."""
        return boot_ns + self.offset_ns + round(self.drift * (boot_ns - self.at_boot_ns))


class ClockFilter:
    """Estimates the clock from exchanges and arrivals.

    Attributes:
        estimate: the present estimate.
        restarts: number of reboots and steps."""

    def __init__(self) -> None:
        self.estimate = ClockEstimate(ClockSource.NONE)
        self.restarts = 0
        self._exchanges: deque[Bound] = deque()
        self._doubtful: list[Bound] = []
        self._undoubted_ns = 0  # bound of the estimate by the answers that fit
        self._arrivals: deque[Bound] = deque()
        self._newest_boot_ns: int | None = None
        self._began_ns = 0  # boot time of the first arrival, since the start or a silence of more than WINDOW_NS
        self._second_ns = 0  # boot time at which the newest second of arrivals begins
        self._accepted_ns: int | None = None
        self._refused: list[Bound] = []  # in a row
        self._changes_ns: deque[int] = deque(maxlen=MIXED)
        self._slow_answer_ns: int | None = None  # arrival of the newest one, unless synchronised since

    def restart(self) -> None:
        """Discards everything: the autopilot has been replaced, or has rebooted."""
        self.restarts += 1
        self._forget()

    def _forget(self) -> None:
        self._exchanges.clear()
        self._arrivals.clear()
        self._doubtful.clear()
        self._refused.clear()
        self._newest_boot_ns = self._accepted_ns = None
        self.estimate = ClockEstimate(ClockSource.NONE)

    # ---- input ----------------------------------------------------------------------------------------------------

    def boot_ns(self, time_boot_ms: int) -> int:
        """Returns the boot time of a 32-bit stamp: after a wrap, the time that continues the earlier ones."""
        boot_ns, newest_ns = time_boot_ms * MS, self._newest_boot_ns
        if newest_ns is None:
            return boot_ns
        unwrapped_ns = boot_ns + round((newest_ns - boot_ns) / WRAP_NS) * WRAP_NS
        return unwrapped_ns if abs(unwrapped_ns - newest_ns) <= NEAR_WRAP_NS else boot_ns

    def arrival(self, boot_ns: int, arrival_ns: int) -> bool:
        """Adds the arrival of a message that was measured at boot_ns (rounded down); returns True if its stamp may be
        used, once the estimate is `usable`.

        False: the stamp is so far back that the message is very late, or it would have been measured after it arrived.
        Another sender, a reboot or a step of one of the clocks also causes this."""
        if self._slow_answer_ns is not None and arrival_ns - self._slow_answer_ns > WINDOW_NS:
            self._slow_answer_ns = None
        if self._is_back(boot_ns) or self._is_ahead(boot_ns, arrival_ns):
            self._refused.append(Bound(boot_ns, None, arrival_ns - boot_ns))
            if len(self._refused) < REBOOT_MESSAGES or self._fits_recently(arrival_ns):
                return False
            if not self._line_is_faster():
                self.restart()
            elif self.usable:  # what arrived before was delayed by more
                self._arrivals, self._second_ns = deque(self._refused[:-1]), boot_ns - NS
            else:
                self._forget()
        elif self._refused:
            self._changes_ns.append(arrival_ns)
        self._refused.clear()
        self._accepted_ns = arrival_ns
        self._newest_boot_ns = max(boot_ns, self._newest_boot_ns or boot_ns)
        high = arrival_ns - boot_ns
        if self._arrivals and boot_ns - self._second_ns < NS:
            if high >= self._arrivals[-1].high:
                return True
            self._arrivals.pop()
        else:
            self._second_ns = boot_ns
        self._arrivals.append(Bound(boot_ns, None, high))
        self._trim(self._arrivals, boot_ns)
        if len(self._arrivals) == 1 and self._second_ns == boot_ns:
            self._began_ns = boot_ns
        self._estimate_at_arrival(boot_ns, arrival_ns)
        return True

    def _estimate_at_arrival(self, boot_ns: int, arrival_ns: int) -> None:
        """Without answers the drift may change: the bound grows, and after WINDOW_NS the arrivals count alone. An arrival
        before the estimated instant corrects it at once."""
        if self.estimate.source is not ClockSource.TIMESYNC:
            self._envelope(boot_ns)
            return
        unanswered_ns = boot_ns - self._exchanges[-1].boot_ns
        if unanswered_ns > WINDOW_NS:
            self._exchanges.clear()
            self._doubtful.clear()
            self._envelope(boot_ns)
        elif unanswered_ns > ANSWERS_NS or self.estimate.local_ns(boot_ns) > arrival_ns:
            self._estimate(boot_ns)

    def exchange(self, ts1_ns: int, tc1_ns: int, now_ns: int) -> bool:
        """Adds an answer to TIMESYNC; returns False if it is not used.

        Args:
            ts1_ns: local time of the request.
            tc1_ns: time of the autopilot's clock.
            now_ns: local time of the arrival."""
        if not 0 <= now_ns - ts1_ns <= MAX_RTT_NS:
            self._slow_answer_ns = now_ns if now_ns > ts1_ns else self._slow_answer_ns
            return False
        new = Bound(tc1_ns, ts1_ns - tc1_ns, now_ns - tc1_ns)
        if self._exchanges and not self._fits(new):
            return self._doubt(new)
        before = self.estimate.source
        self._newest_boot_ns = max(tc1_ns, self._newest_boot_ns or tc1_ns)
        self._doubtful.clear()
        self._exchanges.append(new)
        self._trim(self._exchanges, tc1_ns)
        self._estimate(tc1_ns)
        if self.estimate.source is ClockSource.TIMESYNC:
            self._slow_answer_ns = None
        if self.estimate.source is not before:  # what arrived earlier may be of another clock
            self._newest_boot_ns = tc1_ns
            self._arrivals.clear()
        return True

    def _is_back(self, boot_ns: int) -> bool:
        newest = self._newest_boot_ns
        return newest is not None and boot_ns < newest - REBOOT_STEP_NS

    def _is_ahead(self, boot_ns: int, arrival_ns: int) -> bool:
        """Returns whether a message would have arrived before it was measured, whatever the error of the estimate is."""
        e = self.estimate
        if e.source is ClockSource.NONE:
            return False
        bound_ns = UNKNOWN_DELAY_NS if e.source is ClockSource.ENVELOPE else self._undoubted_ns
        slack_ns = MS + round(MAX_DRIFT * abs(boot_ns - e.at_boot_ns))
        return e.local_ns(boot_ns) - arrival_ns > bound_ns + slack_ns

    def _line_is_faster(self) -> bool:
        """Returns whether the refused messages were only delayed by less than those before, where TIMESYNC is not answered."""
        e, longest_ns = self.estimate, REBOOT_STEP_NS
        if e.source is not ClockSource.ENVELOPE:
            return False
        return all(0 <= e.local_ns(b.boot_ns) - (b.boot_ns + b.high) < longest_ns for b in self._refused)

    @property
    def usable(self) -> bool:
        """Whether stamps may be used: the clock is synchronised, or no answer has come for UNANSWERED_NS and the arrivals of
        KNOWN_SECONDS are known, after which those of a further second have begun. A slow answer shows that all arrivals may
        be delayed by more than UNKNOWN_DELAY_NS: they are not used until the clock is synchronised, or no answer was slow for
        WINDOW_NS."""
        source = self.estimate.source
        if source is ClockSource.TIMESYNC:
            return True
        if source is not ClockSource.ENVELOPE or self._slow_answer_ns is not None or self._newest_boot_ns is None:
            return False
        return len(self._arrivals) > KNOWN_SECONDS and self._newest_boot_ns - self._began_ns >= UNANSWERED_NS

    @property
    def doubted(self) -> bool:
        """Whether the newest answer contradicts the others."""
        return bool(self._doubtful)

    def mixed(self, now_ns: int) -> bool:
        """Returns whether stamps that are refused keep arriving among those that are used."""
        return len(self._changes_ns) == MIXED and now_ns - self._changes_ns[0] < MIXED_NS

    def _fits_recently(self, now_ns: int) -> bool:
        """Returns whether a message with a stamp that fits arrived within SILENT_NS."""
        return self._accepted_ns is not None and now_ns - self._accepted_ns < SILENT_NS

    def _doubt(self, new: Bound) -> bool:
        """Handles an answer that contradicts the others: one is ignored, several in a row that agree are a step of
        the clock."""
        if self._doubtful and not common_offsets([*self._doubtful, new], new.boot_ns):
            self._doubtful.clear()
        self._doubtful.append(new)
        if len(self._doubtful) < STEP_EXCHANGES:
            self._estimate(new.boot_ns)
            return False
        kept = list(self._doubtful)
        self.restart()
        self._newest_boot_ns = new.boot_ns
        self._exchanges.extend(kept)
        self._estimate(new.boot_ns)
        return True

    def _fits(self, new: Bound) -> bool:
        return common_offsets([*self._exchanges, new], new.boot_ns) is not None

    def _trim(self, bounds: deque[Bound], boot_ns: int) -> None:
        oldest = boot_ns - WINDOW_NS
        while len(bounds) > 1 and bounds[0].boot_ns < oldest:
            bounds.popleft()

    def estimate_at(self, now_ns: int) -> ClockEstimate:
        """Returns the estimate with the bound that it has at a local instant, also when nothing arrives any more."""
        e = self.estimate
        if e.bound_ns is None:
            return e
        silent_ns = max(0, now_ns - e.local_ns(e.at_boot_ns))
        return replace(e, bound_ns=e.bound_ns + round(2.0 * MAX_DRIFT * silent_ns))

    # ---- estimate -------------------------------------------------------------------------------------------------

    def _envelope(self, at_ns: int) -> None:
        offsets = sorted(b.high + b.slack_ns(at_ns) for b in self._arrivals)
        offset = offsets[min(1, len(offsets) - 1)]  # of the fastest in each second; one alone may have a wrong stamp
        self.estimate = ClockEstimate(ClockSource.ENVELOPE, offset_ns=offset, at_boot_ns=at_ns)

    def _estimate(self, at_ns: int) -> None:
        exchanges = list(self._exchanges)
        interval = common_offsets([*exchanges, *self._arrivals], at_ns) or common_offsets(exchanges, at_ns)
        if interval is None:  # impossible: `exchange` keeps only exchanges that agree
            raise AssertionError("the exchanges held contradict each other")
        if len(exchanges) < MIN_EXCHANGES and self.estimate.source is not ClockSource.TIMESYNC:
            return
        offset, drift = line_through(exchanges, at_ns)
        offset = min(max(offset, interval[0]), interval[1])
        self._undoubted_ns = max(interval[1] - offset, offset - interval[0])
        low, high = extended(interval, self._doubtful, at_ns)
        self.estimate = ClockEstimate(
            ClockSource.TIMESYNC,
            offset_ns=offset,
            drift=drift,
            at_boot_ns=at_ns,
            bound_ns=max(high - offset, offset - low),
            rtt_ns=min(b.rtt_ns for b in exchanges),
            exchanges=len(exchanges),
        )

"""TIMESYNC: our requests, paired exactly with their answers, into the clock filter.

Other parties ask on the same link (tc1 = 0) and several may answer us: only an answer of the autopilot itself that
mirrors a stamp we sent, once, counts. We answer nobody's request: another companion may be the one the autopilot
synchronises with."""

from __future__ import annotations

import struct
from collections import OrderedDict
from typing import Any

from .clock_sync import NS, ClockFilter, ClockSource
from .dialect import dialect
from .parser import Frame

FAST_NS, SLOW_NS = NS // 10, NS // 2
"""Between requests: until the clock is synchronised and for FAST_FOR_NS after that, and from then on."""
FAST_FOR_NS = 3 * NS
_PENDING = 64
_FIELDS = struct.Struct("<qq")
"""tc1 and ts1, as they lie in the payload: autopilots ask ten times a second for themselves."""
UNANSWERED_NS = 4 * NS
"""Without any answer for this time TIMESYNC counts as not answered."""
AWAITED_NS = NS // 10
"""After a request, so long its answer is waited for at the line: later than that it would say little."""


class TimeSync:
    """Asks and pairs. `unpaired`: answers that mirror nothing we asked; `others`: those not from the autopilot."""

    def __init__(self, clock: ClockFilter) -> None:
        self._clock = clock
        self._pending: OrderedDict[int, None] = OrderedDict()
        self._next_ns = 0
        self._synchronised_ns: int | None = None
        self._waits_since_ns: int | None = None
        self._asked_ns = 0
        self.asked = self.answered = self.unpaired = self.others = 0

    def due(self, now_ns: int) -> list[Any]:
        """The request to send now, if it is time for one. ts1 is now_ns: send it at once."""
        if now_ns < self._next_ns:
            return []
        if self._clock.estimate.source is not ClockSource.TIMESYNC:
            self._synchronised_ns = None
        elif self._synchronised_ns is None:
            self._synchronised_ns = now_ns
        settled = self._synchronised_ns is not None and now_ns - self._synchronised_ns > FAST_FOR_NS
        self._next_ns = now_ns + (SLOW_NS if settled else FAST_NS)
        self._pending[now_ns] = None
        if self._waits_since_ns is None or now_ns - self._asked_ns > NS:  # no request was sent
            self._waits_since_ns = now_ns
        self._asked_ns = now_ns
        if len(self._pending) > _PENDING:
            self._pending.popitem(last=False)
        self.asked += 1
        return [dialect.MAVLink_timesync_message(tc1=0, ts1=now_ns)]

    def take(self, frame: Frame, arrival_ns: int, *, from_autopilot: bool) -> None:
        """A TIMESYNC that came in."""
        tc1, ts1 = frame.fields(_FIELDS)
        if tc1 == 0:
            return
        if not from_autopilot:
            self.others += 1
            return
        if ts1 not in self._pending:
            self.unpaired += 1
            return
        del self._pending[ts1]
        self.answered += 1
        self._waits_since_ns = arrival_ns
        self._clock.exchange(ts1, tc1, arrival_ns)

    def awaits(self, now_ns: int) -> bool:
        """Whether the newest request was sent a moment ago and its answer has not come."""
        return self._asked_ns in self._pending and now_ns - self._asked_ns < AWAITED_NS

    def answers(self, now_ns: int) -> bool:
        """Whether what we ask is answered, or it is too early to say."""
        return self._waits_since_ns is None or now_ns - self._waits_since_ns < UNANSWERED_NS

    def restart(self) -> None:
        """Another autopilot, or the same one booted: what was asked before is void."""
        self._pending.clear()
        self._next_ns = 0
        self._synchronised_ns = self._waits_since_ns = None

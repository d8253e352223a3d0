"""TIMESYNC: sends requests, and passes their answers to the clock filter.

Other senders use TIMESYNC on the same link (tc1 = 0), and several may answer a request: only an answer of the
autopilot itself that returns a stamp of a request, once, counts. Requests of others are not answered: the autopilot
may synchronise with another companion."""

from __future__ import annotations

import struct
from collections import OrderedDict
from typing import Any

from .clock_bounds import NS
from .clock_sync import ClockFilter, ClockSource
from .dialect import dialect
from .parser import Frame

FAST_NS, SLOW_NS = NS // 10, NS // 2
"""Interval of the requests: until the clock is synchronised, for FAST_FOR_NS after that, and while the newest answer
contradicts the others; otherwise."""
FAST_FOR_NS = 3 * NS
_PENDING = 600
"""Requests of a minute at FAST_NS, of which answers count: also a very late one shows that the line is slow."""
_FIELDS = struct.Struct("<qq")
"""tc1 and ts1 as in the payload: autopilots send ten requests per second themselves."""
UNANSWERED_NS = 4 * NS
"""TIMESYNC counts as not answered after this time without an answer."""
TWO_CLOCKS_NS = 10 * NS
"""Two clocks answer, if they did within this time."""
_ANSWERED, _TOLERANCE_NS = 64, 1_000_000
"""Number of answered requests for which a second answer counts; largest rounding of the times of an answer."""
AWAITED_NS = NS // 10
"""Time after a request for which reads are not deferred; a later answer gives little information."""


class TimeSync:
    """Sends requests and matches answers. unpaired: number of answers to no request."""

    def __init__(self, clock: ClockFilter) -> None:
        self._clock = clock
        self._pending: OrderedDict[int, None] = OrderedDict()
        self._next_ns = 0
        self._synchronised_ns: int | None = None
        self._waits_since_ns: int | None = None
        self._used_ns: int | None = None
        self._asked_ns = 0
        self._answered: OrderedDict[int, int] = OrderedDict()  # stamp of the request -> time of the first answer
        self._two_clocks_ns: int | None = None
        self.unpaired = 0

    def due(self, now_ns: int) -> list[Any]:
        """Returns the request to send now, if any. Its ts1 is now_ns: it must be sent at once."""
        if now_ns < self._next_ns:
            return []
        if self._clock.estimate.source is not ClockSource.TIMESYNC:
            self._synchronised_ns = None
        elif self._synchronised_ns is None:
            self._synchronised_ns = now_ns
        settled = self._synchronised_ns is not None and now_ns - self._synchronised_ns > FAST_FOR_NS
        self._next_ns = now_ns + (SLOW_NS if settled and not self._clock.doubted else FAST_NS)
        self._pending[now_ns] = None
        if self._waits_since_ns is None or now_ns - self._asked_ns > NS:  # no request was sent
            self._waits_since_ns = now_ns
        if self._used_ns is None or now_ns - self._asked_ns > NS:
            self._used_ns = now_ns
        self._asked_ns = now_ns
        if len(self._pending) > _PENDING:
            self._pending.popitem(last=False)
        return [dialect.MAVLink_timesync_message(tc1=0, ts1=now_ns)]

    def take(self, frame: Frame, arrival_ns: int, *, from_autopilot: bool) -> None:
        """Handles a received TIMESYNC."""
        tc1, ts1 = frame.fields(_FIELDS)
        if tc1 == 0 or not from_autopilot:
            return
        if ts1 not in self._pending:
            self.unpaired += 1
            if abs(tc1 - self._answered.get(ts1, tc1)) > arrival_ns - ts1 + _TOLERANCE_NS:
                self._two_clocks_ns = arrival_ns
            return
        del self._pending[ts1]
        self._answered[ts1] = tc1
        if len(self._answered) > _ANSWERED:
            self._answered.popitem(last=False)
        self._waits_since_ns = arrival_ns
        if self._clock.exchange(ts1, tc1, arrival_ns):
            self._used_ns = arrival_ns

    def two_clocks_answer(self, now_ns: int) -> bool:
        """Returns whether two vehicles answer: the times of two answers to one request are further apart than the request and
        the later answer. A request that reaches one autopilot by two routes has two answers, too, between these instants."""
        return self._two_clocks_ns is not None and now_ns - self._two_clocks_ns < TWO_CLOCKS_NS

    def awaits(self, now_ns: int) -> bool:
        """True if the newest request was sent a moment ago and is not answered yet."""
        return self._asked_ns in self._pending and now_ns - self._asked_ns < AWAITED_NS

    def answers(self, now_ns: int) -> bool:
        """True if requests are answered, or if it is too early to tell."""
        return self._waits_since_ns is None or now_ns - self._waits_since_ns < UNANSWERED_NS

    def synchronises(self, now_ns: int) -> bool:
        """True if the clock filter uses the answers, or if it is too early to tell. It uses none that are slow or contradict
        the others."""
        return self._used_ns is None or now_ns - self._used_ns < UNANSWERED_NS

    def restart(self) -> None:
        """Discards earlier requests: the autopilot has been replaced or has rebooted."""
        self._pending.clear()
        self._answered.clear()
        self._next_ns = 0
        self._synchronised_ns = self._waits_since_ns = self._used_ns = None

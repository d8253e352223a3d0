"""Requests message rates, and repeats a request while the measured rate is too low.

The measured rate counts, not the acknowledgement: other stations reset intervals, and a reboot clears them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from .clock_bounds import NS
from .commands import SET_MESSAGE_INTERVAL, set_message_interval
from .dialect import dialect

WINDOW_NS = 2 * NS
"""Time over which a rate is measured."""
FIRST_WAIT_NS, LONGEST_WAIT_NS = 2 * NS, 30 * NS
"""Time after a request before the next one; doubled each time."""
ENOUGH = 0.8
"""Sufficient share of the wanted rate."""
STREAMS = {30: 10, 31: 10, 32: 6, 331: 6}
"""Data stream of a message in the old request: MAV_DATA_STREAM_EXTRA1, MAV_DATA_STREAM_POSITION."""


@dataclass(frozen=True, slots=True)
class RateRequest:
    """A wanted message."""

    message_id: int
    name: str
    hz: float
    instead_of: int | None = None  # it is requested only while that other message does not arrive


class RateMonitor:
    """Measures the rates that arrive and returns the requests to send."""

    def __init__(self, requests: tuple[RateRequest, ...]) -> None:
        self.requests = requests
        self._arrivals: dict[int, deque[int]] = {w.message_id: deque() for w in requests}
        self._next_ns: dict[int, int] = {}
        self._wait_ns: dict[int, int] = {}
        self._first_asked_ns: dict[int, int] = {}
        self.knows_intervals = True

    def received(self, message_id: int, now_ns: int) -> None:
        """Records the arrival of a message."""
        arrivals = self._arrivals.get(message_id)
        if arrivals is not None:
            arrivals.append(now_ns)
            _forget_old(arrivals, now_ns)

    def rate_hz(self, message_id: int, now_ns: int) -> float:
        """Returns the rate of a message over the last two seconds."""
        arrivals = self._arrivals[message_id]
        _forget_old(arrivals, now_ns)
        return len(arrivals) * NS / WINDOW_NS

    def acknowledged(self, command: int, result: int) -> None:
        """Handles a COMMAND_ACK. An autopilot that does not know SET_MESSAGE_INTERVAL gets REQUEST_DATA_STREAM
        instead."""
        if command == SET_MESSAGE_INTERVAL and result == dialect.MAV_RESULT_UNSUPPORTED:
            self.knows_intervals = False

    def restart(self) -> None:
        """Requests all intervals again, after a reboot or for another autopilot."""
        self._next_ns.clear()
        self._wait_ns.clear()
        self._first_asked_ns.clear()
        self.knows_intervals = True

    def due(self, now_ns: int, system: int) -> list[Any]:
        """Returns the requests to send now."""
        wanted = [w for w in self.requests if self._wanting(w, now_ns)]
        if not wanted:
            return []
        for w in wanted:
            wait = self._wait_ns.get(w.message_id, FIRST_WAIT_NS)
            self._next_ns[w.message_id] = now_ns + wait
            self._wait_ns[w.message_id] = min(2 * wait, LONGEST_WAIT_NS)
            self._first_asked_ns.setdefault(w.message_id, now_ns)
        if not self.knows_intervals:
            return self._old_request(wanted, now_ns, system)
        return [set_message_interval(system, w.message_id, w.hz) for w in wanted]

    def _wanting(self, w: RateRequest, now_ns: int) -> bool:
        if now_ns < self._next_ns.get(w.message_id, 0):
            return False
        if self._flows(w, now_ns):
            self._wait_ns.pop(w.message_id, None)
            return False
        if w.instead_of is None:
            return True
        # give the better message its chance before asking for its substitute
        asked_ns = self._first_asked_ns.get(w.instead_of)
        if asked_ns is None or now_ns - asked_ns < FIRST_WAIT_NS:
            return False
        return self.rate_hz(w.instead_of, now_ns) == 0.0

    def _old_request(self, wanted: list[RateRequest], now_ns: int, system: int) -> list[Any]:
        """Requests the streams of the wanted messages, except where another message of the stream arrives at its rate: the
        firmware then does not have the wanted one."""
        flowing = {STREAMS[w.message_id] for w in self.requests if self._flows(w, now_ns)}
        rates: dict[int, int] = {}
        for w in wanted:
            stream = STREAMS[w.message_id]
            if stream not in flowing:
                rates[stream] = max(rates.get(stream, 0), round(w.hz))
        return [
            dialect.MAVLink_request_data_stream_message(system, dialect.MAV_COMP_ID_AUTOPILOT1, stream, hz, 1)
            for stream, hz in rates.items()
        ]

    def _flows(self, w: RateRequest, now_ns: int) -> bool:
        return self.rate_hz(w.message_id, now_ns) >= ENOUGH * w.hz


def _forget_old(arrivals: deque[int], now_ns: int) -> None:
    while arrivals and arrivals[0] <= now_ns - WINDOW_NS:
        arrivals.popleft()

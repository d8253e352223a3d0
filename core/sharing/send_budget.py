"""What may be sent on a link now."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from .packet_codec import STATE_BYTES

NS = 1_000_000_000
WINDOW_S = 10.0
WINDOW_NS = 10 * NS
BURST_S = 0.6
"""The budget of this time may be sent at once."""
PACKET_S = 2.0
"""A packet is not larger than the budget of this time."""
RESERVE = 0.5
"""Share of that which is kept for new planes while others are repeated, at most that of half a packet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """Budget of a link."""

    bytes_per_s: float  # of all packets, with the overhead of the transport, over ten seconds
    overhead_bytes: int  # overhead per packet
    packet_bytes: int  # greatest size of a packet
    refresh_s: float = 20.0  # interval in which a plane is repeated


class SentBytes:
    """Bytes that were sent: a token bucket, and the sum of the last WINDOW_S. In no window of WINDOW_S more than the budget is sent,
    but for one packet where a new section begins.

    The bucket is filled at a rate that leaves room for a burst in each window. At the whole rate a burst left a pause WINDOW_S later,
    and so did that pause, in which new planes waited. The own state and motion are sent once per second without asking for room: a
    part of the budget is kept for them."""

    def __init__(self, budget: Budget, begun_ns: int) -> None:
        packet_bytes = budget.packet_bytes + budget.overhead_bytes
        self._most = max(BURST_S * budget.bytes_per_s, 1.25 * packet_bytes)
        self._fill_bytes_per_s = max(0.5 * budget.bytes_per_s, budget.bytes_per_s - self._most / WINDOW_S)
        self._reserve = min(RESERVE * self._most, 0.25 * packet_bytes)
        self._tokens, self._now_ns = self._most, begun_ns
        state_bytes = STATE_BYTES + budget.overhead_bytes
        longest_pause_s = (self._most + state_bytes) / budget.bytes_per_s
        self._left_bytes = WINDOW_S * budget.bytes_per_s - math.ceil(longest_pause_s) * state_bytes
        self._recent: deque[tuple[int, int]] = deque()

    def follow(self, now_ns: int) -> None:
        """Follows the clock."""
        gained = self._fill_bytes_per_s * max(0, now_ns - self._now_ns) / NS
        self._tokens, self._now_ns = min(self._most, self._tokens + gained), now_ns
        while self._recent and self._recent[0][0] <= now_ns - WINDOW_NS:
            self._left_bytes += self._recent.popleft()[1]

    def add(self, size: int) -> None:
        """Records what was sent."""
        self._tokens -= size
        self._left_bytes -= size
        self._recent.append((self._now_ns, size))

    def room(self, *, urgent: bool) -> int:
        """Returns the number of bytes of planes or moving obstacles that may be sent now. urgent: new ones."""
        room = min(self._tokens, self._left_bytes)
        return int(room if urgent else room - self._reserve)

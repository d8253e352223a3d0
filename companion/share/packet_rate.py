"""Bounds the packets that are taken from each sender, so that a flood of one does not displace those of others."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

from drivers.sharing.link import ReceivedPacket

NS: Final = 1_000_000_000
PACKETS_PER_S, BURST = 40.0, 60.0
"""Of one sender on one link; a true sender sends ten a second."""
ALL_PER_S, ALL_BURST = 400.0, 400.0
"""Of all together."""


@dataclass(slots=True)
class _Bucket:
    tokens: float
    filled_ns: int

    def take(self, now_ns: int, per_s: float, burst: float) -> bool:
        """Whether one more is allowed."""
        self.tokens = min(burst, self.tokens + per_s * max(0, now_ns - self.filled_ns) / NS)
        self.filled_ns = max(now_ns, self.filled_ns)
        allowed = self.tokens >= 1.0
        self.tokens -= float(allowed)
        return allowed


class PacketRate:
    """`allows` is called with each packet as it arrives. members: numbers of the accepted vehicles, empty: all."""

    def __init__(self, members: frozenset[int]) -> None:
        self._members = members
        self._senders: dict[tuple[str, int], _Bucket] = {}
        self._all = _Bucket(ALL_BURST, 0)
        # all keys from the beginning: another thread reads them
        self.dropped: Counter[str] = Counter(flood=0, unknown_sender=0)

    def allows(self, packet: ReceivedPacket) -> bool:
        """Whether a packet may be taken; others are counted."""
        if self._members and packet.sender is not None and packet.sender not in self._members:
            self.dropped["unknown_sender"] += 1  # before it takes from the rate of all
            return False
        # senders are numbers of 8 bits: the table is bounded
        key = packet.transport, packet.sender or 0
        bucket = self._senders.setdefault(key, _Bucket(BURST, packet.arrival_ns))
        now_ns = packet.arrival_ns
        allowed = bucket.take(now_ns, PACKETS_PER_S, BURST) and self._all.take(now_ns, ALL_PER_S, ALL_BURST)
        self.dropped["flood"] += not allowed
        return allowed

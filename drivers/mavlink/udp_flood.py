"""Drops floods of datagrams before they are parsed.

Reading a datagram takes microseconds, searching it for messages up to a hundred times as long. While the address of
the autopilot is known, other addresses may therefore send a limited number of datagrams: enough to detect a second
autopilot, another companion, or an autopilot with a new port, and too few to delay the attitude for the present
frame. Datagrams with a heartbeat have a number of their own: PX4 sends hundreds of datagrams a second, and its heartbeat at
the same phase of each second, which could always be that of the dropped ones."""

from __future__ import annotations

import re
from collections import OrderedDict
from typing import Final

from .address import SocketAddress

NS = 1_000_000_000
WINDOW_NS = NS // 2
PER_SOURCE, ALL_SOURCES = 64, 256
"""Greatest number of datagrams of one foreign address, and of all of them, that are parsed per window."""
HEARTBEATS, ALL_HEARTBEATS = 4, 32
"""The same for further datagrams with a heartbeat."""
_HEARTBEAT: Final = re.compile(rb"\xfd\x09.{5}\x00\x00\x00|\xfe\x09.{3}\x00", re.DOTALL)
"""Header of a HEARTBEAT in MAVLink 2 and 1."""
SEARCHED_BYTES = 1500
"""Only so much of a datagram is searched for it: 64 KiB would take 0.6 ms. Autopilots send no longer ones."""
TRUST_NS = 3 * NS
"""An address is not trusted any more if its last message of the autopilot is older: the autopilot may have a new one."""
MOST_TRUSTED = 4
"""Addresses that an autopilot may use at the same time, for example over two radios."""


class FloodFilter:
    """Filter of floods: `trust` the address of the autopilot, then test each datagram by `passes`.

    One thread at a time; `text` may be called from another one."""

    def __init__(self) -> None:
        self._trusted: OrderedDict[SocketAddress, int] = OrderedDict()
        self._passed: dict[SocketAddress, int] = {}
        self._beats: dict[SocketAddress, int] = {}
        self._all = 0
        self._begun_ns = 0
        self._dropped_now = 0
        self._from = ""
        self._text, self._text_ns = "", 0
        self.dropped = 0

    def trust(self, source: SocketAddress, now_ns: int) -> None:
        """Records that the autopilot has sent from this address."""
        self._trusted[source] = now_ns
        self._trusted.move_to_end(source)
        if len(self._trusted) > MOST_TRUSTED:
            self._trusted.popitem(last=False)

    def passes(self, source: SocketAddress, now_ns: int, datagram: bytes | memoryview = b"") -> bool:
        """True if a datagram from this address must be parsed. All pass while no address is trusted."""
        if source in self._trusted or not any(now_ns - t_ns < TRUST_NS for t_ns in self._trusted.values()):
            return True
        if now_ns - self._begun_ns >= WINDOW_NS:
            self._next_window(now_ns)
        count = self._passed.get(source, 0) + 1
        if count <= PER_SOURCE and self._all < ALL_SOURCES:
            self._passed[source] = count
            self._all += 1
            return True
        if self._beat_passes(source, datagram):
            return True
        self._dropped_now += 1
        self.dropped += 1
        self._from = f"{source[0]}:{source[1]}"
        return False

    def _beat_passes(self, source: SocketAddress, datagram: bytes | memoryview) -> bool:
        """Returns whether a datagram has a heartbeat that is within their number."""
        count = self._beats.get(source, 0) + 1
        if count > HEARTBEATS or sum(self._beats.values()) >= ALL_HEARTBEATS:
            return False
        if _HEARTBEAT.search(datagram, 0, SEARCHED_BYTES) is None:
            return False
        self._beats[source] = count
        return True

    def text(self, now_ns: int) -> str:
        """The flood of the last second, as text; empty: there is none."""
        if self._dropped_now and now_ns - self._begun_ns < 2 * WINDOW_NS:
            return self._words(self._dropped_now)
        return self._text if self._text and now_ns - self._text_ns < 2 * WINDOW_NS else ""

    def _next_window(self, now_ns: int) -> None:
        self._text, self._text_ns = self._words(self._dropped_now) if self._dropped_now else "", now_ns
        self._passed.clear()
        self._beats.clear()
        self._all = self._dropped_now = 0
        self._begun_ns = now_ns

    def _words(self, dropped: int) -> str:
        rate = round(dropped * NS / WINDOW_NS)
        return (
            f"about {rate} datagrams a second from {self._from} or others are dropped unread: they are not the "
            "autopilot's; close the port to them, or stop their sender"
        )

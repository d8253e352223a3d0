"""The newest heartbeats of the autopilot, by which late copies are found."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from .session_types import Vehicle

LATE_COPY_NS, _MOST = 10_000_000_000, 64
"""A network or a second route may deliver a heartbeat again for this long; greatest number of heartbeats that are kept for it."""


class Heartbeats:
    """The accepted heartbeats, byte by byte."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=_MOST)

    def add(self, data: bytes, arrival_ns: int) -> None:
        """Keeps an accepted heartbeat."""
        self._kept.append((arrival_ns, data))

    def is_late_copy(self, data: bytes, new: Vehicle, old: Vehicle | None) -> bool:
        """Returns whether a heartbeat was received before, byte by byte, and would bring its state back. new: the vehicle by this
        heartbeat; old: by the one before; None: there is none.

        Each message of an autopilot has the next number of 256, so that a true return to an earlier state is hardly ever such a
        copy; the next heartbeat then shows it."""
        if old is None or replace(new, heartbeat_ns=old.heartbeat_ns) == old:
            return False
        since_ns = new.heartbeat_ns - LATE_COPY_NS
        return any(data == before and at_ns > since_ns for at_ns, before in self._kept)

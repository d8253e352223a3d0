"""Messages that wait to be sent. Of obstacle distances only the newest ones wait: after a gap of the link older ones
are wrong. A message may have an end of its validity, and a command the state of the vehicle that it was decided by."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from ..suspended_time import LEAST_NS, suspended_ns
from .dialect import dialect
from .session_types import Vehicle

_POINT_ID = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE_3D
SCAN_IDS = frozenset({dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, _POINT_ID})
"""Obstacles around the vehicle."""
OBSTACLE_IDS = SCAN_IDS | {dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR}
_MOST = 256
NS = 1_000_000_000
VALID_NS = dict.fromkeys(OBSTACLE_IDS, NS * 15 // 100) | {dialect.MAVLINK_MSG_ID_COMMAND_LONG: NS // 2}
"""Longest time for which such a message may wait. Distances describe the present, and new ones follow at 10 Hz or more; a command
was decided by the flight mode of its time, and is repeated by its sender."""


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A message."""

    message: Any
    until_ns: int | None  # end of its validity
    decided_by: Vehicle | None  # heartbeat by which it was decided; None: each has none
    suspended_ns: int  # of the computer when it was posted

    def valid(self, now_ns: int, vehicle: Vehicle | None) -> bool:
        """Returns whether it may be sent. vehicle: by the newest heartbeat."""
        # the clock has stood still in a suspension, so that what was decided before it would still be valid
        suspended = suspended_ns() - self.suspended_ns >= LEAST_NS
        if self.until_ns is not None and (suspended or now_ns > self.until_ns):
            return False
        return self.decided_by is None or (vehicle is not None and not vehicle.contradicts(self.decided_by))


class Outbox:
    """Queue of messages: `post`, then `take`. If it is full, the oldest messages are dropped."""

    def __init__(self) -> None:
        self._waiting: deque[_Waiting] = deque(maxlen=_MOST)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def post(self, message: Any, now_ns: int, decided_by: Vehicle | None = None) -> None:
        """Adds a message. Waiting obstacle messages that it replaces are removed. decided_by: see `take`."""
        kind = message.get_msgId()
        if kind in OBSTACLE_IDS and not (self._waiting and _one_scan(self._waiting[-1].message, message)):
            kept = [waiting for waiting in self._waiting if not _replaced(waiting.message, message)]
            self._waiting.clear()
            self._waiting.extend(kept)
        valid_ns = VALID_NS.get(kind)
        until_ns = None if valid_ns is None else now_ns + valid_ns
        self._waiting.append(_Waiting(message, until_ns, decided_by, suspended_ns()))

    def take(self, now_ns: int, vehicle: Vehicle | None = None) -> list[Any]:
        """Returns all waiting messages that are still valid, in order, and removes all. vehicle: by the newest heartbeat;
        one that contradicts the heartbeat by which a message was decided makes that message invalid."""
        messages = [waiting.message for waiting in self._waiting if waiting.valid(now_ns, vehicle)]
        self._waiting.clear()
        return messages

    def take_only(self, ids: Collection[int], now_ns: int) -> tuple[list[Any], int]:
        """Returns the waiting messages with these ids that are still valid, and the number of the others, which are
        dropped."""
        waiting = len(self._waiting)
        kept = [m for m in self.take(now_ns) if m.get_msgId() in ids]
        return kept, waiting - len(kept)


def _one_scan(a: Any, b: Any) -> bool:
    """True if two messages are of one scan of points, which has one time."""
    return a.get_msgId() == b.get_msgId() == _POINT_ID and bool(a.time_boot_ms == b.time_boot_ms)


def _replaced(waiting: Any, new: Any) -> bool:
    """True if a waiting message has older obstacles of the same kind than a new one."""
    old_id, new_id = waiting.get_msgId(), new.get_msgId()
    if old_id in SCAN_IDS and new_id in SCAN_IDS:
        return not _one_scan(waiting, new)
    return old_id == new_id == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR and bool(waiting.orientation == new.orientation)

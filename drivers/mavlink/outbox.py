"""Messages that wait to be sent. Of obstacle distances only the newest ones wait: after a gap of the link older ones
are wrong."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import Any

DISTANCE_SENSOR_ID, OBSTACLE_DISTANCE_ID, OBSTACLE_DISTANCE_3D_ID = 132, 330, 11037
_SCANS = frozenset({OBSTACLE_DISTANCE_ID, OBSTACLE_DISTANCE_3D_ID})
OBSTACLE_IDS = _SCANS | {DISTANCE_SENSOR_ID}
_MOST = 256


class Outbox:
    """Queue of messages: `post`, then `take`. If it is full, the oldest messages are dropped."""

    def __init__(self) -> None:
        self._waiting: deque[Any] = deque(maxlen=_MOST)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def post(self, message: Any) -> None:
        """Adds a message. Waiting obstacle messages that it replaces are removed."""
        if message.get_msgId() in OBSTACLE_IDS and not (self._waiting and _one_scan(self._waiting[-1], message)):
            kept = [m for m in self._waiting if not _replaced(m, message)]
            self._waiting.clear()
            self._waiting.extend(kept)
        self._waiting.append(message)

    def take(self) -> list[Any]:
        """Returns all waiting messages, in order, and removes them."""
        messages = list(self._waiting)
        self._waiting.clear()
        return messages

    def take_only(self, ids: Collection[int]) -> tuple[list[Any], int]:
        """Returns the waiting messages with these ids, and the number of the others, which are dropped."""
        messages = self.take()
        kept = [m for m in messages if m.get_msgId() in ids]
        return kept, len(messages) - len(kept)


def _one_scan(a: Any, b: Any) -> bool:
    """True if two messages are of one scan of points, which has one time."""
    return a.get_msgId() == b.get_msgId() == OBSTACLE_DISTANCE_3D_ID and bool(a.time_boot_ms == b.time_boot_ms)


def _replaced(waiting: Any, new: Any) -> bool:
    """True if a waiting message has older obstacles of the same kind than a new one."""
    old_id, new_id = waiting.get_msgId(), new.get_msgId()
    if old_id in _SCANS and new_id in _SCANS:
        return not _one_scan(waiting, new)
    return old_id == new_id == DISTANCE_SENSOR_ID and bool(waiting.orientation == new.orientation)

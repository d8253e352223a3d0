"""The bounded queue between those that record and the thread that writes."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, Generic, TypeVar

_WAKE_BYTES: Final = 100_000
_WAKE_ITEMS: Final = 64
IDLE_S: Final = 0.2
"""Longest time until queued items are written."""
_AFTER_S: Final = 0.001
"""Delay before the work on a new frame: its subscribers wake up at the same time and would wait 1 to 2 ms for a
processor that compresses a chunk."""

Item = TypeVar("Item")


class RecordQueue(Generic[Item]):
    """Items with their sizes, for one reader.

    `lock` guards the queue, and the fields of its owner that change with it. It may be taken again by its holder. It is the last
    in the lock order: no other lock is taken while it is held."""

    def __init__(self, most_items: int, most_bytes: float) -> None:
        self.lock = threading.Condition()
        self._most_items, self._most_bytes = most_items, most_bytes
        self._queue: deque[Item] = deque()
        self._queued_bytes = 0
        self._deferred: list[Item] = []
        self._deferred_bytes = 0
        self._deferring = False
        self._stop = False

    @property
    def waiting(self) -> int:
        """Number of items that wait."""
        with self.lock:
            return len(self._queue) + len(self._deferred)

    def add(self, item: Item, size: int, *, always: bool = False) -> bool:
        """Adds an item; False: the queue is full. always: also where it is full."""
        with self.lock:
            full = (
                self.waiting >= self._most_items or self._queued_bytes + self._deferred_bytes + size > self._most_bytes
            )
            if full and not always:
                return False
            self._deferred.append(item)
            self._deferred_bytes += size
            if not self._deferring:
                self._hand_over()
            return True

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Passes the items added within the block to the reader at its end."""
        with self.lock:
            self._deferring = True
        try:
            yield
        finally:
            with self.lock:
                self._deferring = False
                self._hand_over()

    def stop(self) -> None:
        """Ends the queue: `take` returns what waits, then None."""
        with self.lock:
            self._hand_over()
            self._stop = True
            self.lock.notify()

    def take(self) -> tuple[list[Item], int] | None:
        """The queued items and their bytes, after a short wait; None at the end."""
        with self.lock:
            idle = not self._stop and not self._wake_due
            if idle and self.lock.wait(IDLE_S) and not self._stop:
                self.lock.wait(_AFTER_S)
            if not self._queue and self._stop:
                return None
            items, size = list(self._queue), self._queued_bytes
            self._queue.clear()
            self._queued_bytes = 0
            return items, size

    def _hand_over(self) -> None:
        """Passes the items to the reader. Wakes it for a frame or for many samples; for few samples it wakes by itself.
        The lock is held."""
        self._queue.extend(self._deferred)
        self._queued_bytes += self._deferred_bytes
        self._deferred.clear()
        self._deferred_bytes = 0
        if self._wake_due:
            self.lock.notify()

    @property
    def _wake_due(self) -> bool:
        return self._queued_bytes >= _WAKE_BYTES or len(self._queue) >= _WAKE_ITEMS

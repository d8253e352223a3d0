"""Bounds what sharing writes into the log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from google.protobuf.message import Message

NS: Final = 1_000_000_000
MOST_LOGGED_PER_S: Final = 100
Log = Callable[[str, Message, int], None]


class RecordLimit:
    """Records at most MOST_LOGGED_PER_S messages: a log has priority for what a replay needs.

    log: records a message (key of the table of topics, message, time). unrecorded: number of messages left out."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._second_ns = self._recorded = 0
        self.unrecorded = 0

    def record(self, key: str, message: Message, t_ns: int) -> None:
        """Records a message, or counts it."""
        if t_ns - self._second_ns >= NS:
            self._second_ns, self._recorded = t_ns, 0
        self._recorded += 1
        if self._recorded <= MOST_LOGGED_PER_S:
            self._log(key, message, t_ns)
        else:
            self.unrecorded += 1

"""Bytes of a line cut into MAVLink messages whose checksum is right.

The library's own stream parser throws away all bytes that a false start claimed, and with them true messages; here a
start that turns out false costs one byte."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

from .mavlink_dialect import dialect

MAVLINK1, MAVLINK2 = 0xFE, 0xFD
_SIGNED = 1


class MessageSplitter:
    """`feed` it as bytes come. counts: bytes of noise, messages unknown to the dialect (nobody can check them)."""

    def __init__(self) -> None:
        self._held = bytearray()
        self._unknown_end = 0
        self._decoder = dialect.MAVLink(None)
        self.counts: Counter[str] = Counter()

    def feed(self, data: bytes) -> list[Any]:
        """The messages completed by these bytes, in order."""
        self._held += data
        held, at = self._held, 0
        messages: list[Any] = []
        while at < len(held):
            end = _frame_end(held, at)
            if end is not None and end > len(held):
                break  # the rest is on its way
            message = self._decode(bytes(held[at:end])) if end is not None else None
            if message is None or end is None or message.get_type().startswith("UNKNOWN_"):
                self._step_over(message, at, end or at)
                at += 1
                continue
            messages.append(message)
            at = end
        del held[:at]
        self._unknown_end = max(0, self._unknown_end - at)
        return messages

    def _step_over(self, message: Any, at: int, end: int) -> None:
        """Counts the byte at `at`. Even of an unknown message only a byte is passed by: no checksum says that it is one,
        and a true message may begin inside of it."""
        if message is not None and at >= self._unknown_end:
            self.counts["unknown messages"] += 1
            self._unknown_end = end
        elif at >= self._unknown_end:
            self.counts["bytes of noise"] += 1

    def clear(self) -> None:
        """Forgets a message begun."""
        self._held.clear()
        self._unknown_end = 0

    def _decode(self, frame: bytes) -> Any:
        try:
            return self._decoder.decode(bytearray(frame))
        except (dialect.MAVError, struct.error):
            return None


def _frame_end(data: bytearray, at: int) -> int | None:
    """Where a frame that starts at `at` ends (beyond the data while its header is incomplete), None when none does."""
    if data[at] not in (MAVLINK1, MAVLINK2):
        return None
    if at + 3 > len(data):
        return len(data) + 1
    length = data[at + 1]
    if data[at] == MAVLINK1:
        return at + 8 + length
    if data[at + 2] & ~_SIGNED:
        return None  # incompatible flags that do not exist
    return at + 12 + length + (13 if data[at + 2] & _SIGNED else 0)

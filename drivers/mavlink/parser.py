"""Divides the bytes of a link into MAVLink messages with a correct checksum.

The stream parser of the library discards all bytes that a false start claimed, and with them valid messages. Here a
false start costs one byte."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

from fastcrc.crc16 import mcrf4xx

from .anomalies import LinkAnomaly
from .dialect import dialect

MAVLINK1, MAVLINK2 = dialect.PROTOCOL_MARKER_V1, dialect.PROTOCOL_MARKER_V2
_SIGNED, SIGNATURE_BYTES = dialect.MAVLINK_IFLAG_SIGNED, dialect.MAVLINK_SIGNATURE_BLOCK_LEN
_DECODER = dialect.MAVLink(None)


class Frame:
    """A message with a correct checksum and its decoded header. `message` decodes the payload, which takes ten times
    as long.

    The methods have the names of those of the dialect's messages. Frequent callers read `id`, `system`, `component`
    and `data`."""

    __slots__ = ("component", "crc_extra", "data", "id", "system")

    def __init__(self, data: bytes, message_id: int, system: int, component: int, crc_extra: int) -> None:
        self.data, self.id, self.system, self.component = data, message_id, system, component
        self.crc_extra = crc_extra

    def get_msgId(self) -> int:  # the dialect's word
        return self.id

    def get_srcSystem(self) -> int:
        return self.system

    def get_srcComponent(self) -> int:
        return self.component

    def get_msgbuf(self) -> bytes:
        return self.data

    def fields(self, fields: struct.Struct) -> tuple[Any, ...]:
        """Returns the first fields of the payload. Zeros at its end are not transmitted."""
        data = self.data
        begin, length = (6 if data[0] == MAVLINK1 else 10), data[1]
        if length >= fields.size:
            return fields.unpack_from(data, begin)
        return fields.unpack(data[begin : begin + length].ljust(fields.size, b"\0"))

    def message(self) -> Any:
        """Returns the dialect's message; None if the payload cannot be decoded."""
        try:
            return _DECODER.decode(bytearray(self.data))
        except (dialect.MAVError, struct.error):
            return None


class MessageSplitter:
    """Divides received bytes into messages.

    Attributes:
        counts: bytes of noise, and messages unknown to the dialect, whose checksum cannot be verified."""

    def __init__(self, counts: Counter[LinkAnomaly] | None = None) -> None:
        """Starts without partial message. counts: counter to use, which several splitters may share."""
        self._cached = b""
        self._unknown_end = 0
        self.counts: Counter[LinkAnomaly] = Counter() if counts is None else counts

    def feed(self, data: bytes) -> list[Any]:
        """Returns the messages completed by these bytes, in order."""
        return [message for frame in self.frames(data) if (message := frame.message()) is not None]

    def frames(self, data: bytes) -> list[Frame]:
        """Returns the messages completed by these bytes, in order, with their payload not decoded."""
        cached, at = self._cached + data if self._cached else data, 0
        found: list[Frame] = []
        size = len(cached)
        while at < size:
            end = _frame_end(cached, at)
            if end is not None:
                if end > size:
                    break  # the rest is on its way
                frame = self._checked(cached[at:end], at)
                if frame is not None:
                    found.append(frame)
                    at = end
                    continue
            if at >= self._unknown_end:
                self.counts[LinkAnomaly.NOISE_BYTES] += 1
            at += 1
        self._cached = cached[at:]
        if self._unknown_end:
            self._unknown_end = max(0, self._unknown_end - at)
        return found

    def _checked(self, data: bytes, at: int) -> Frame | None:
        """Returns the frame if its checksum is correct, otherwise None.

        After an unknown message the search continues at its second byte, as after noise: without a checksum it is not
        certain to be a message, and a valid one may begin inside of it."""
        if data[0] == MAVLINK1:
            message_id, system, component, end = data[5], data[3], data[4], len(data) - 2
        else:
            message_id, system, component = data[7] | data[8] << 8 | data[9] << 16, data[5], data[6]
            end = len(data) - 2 - (SIGNATURE_BYTES if data[2] & _SIGNED else 0)
        kind = dialect.mavlink_map.get(message_id)
        if kind is None:
            if at >= self._unknown_end:
                self.counts[LinkAnomaly.UNKNOWN_MESSAGE] += 1
                self._unknown_end = at + len(data)
            return None
        if mcrf4xx(data[1:end] + bytes((kind.crc_extra,))) != data[end] | data[end + 1] << 8:
            return None
        return Frame(data, message_id, system, component, kind.crc_extra)

    def clear(self) -> None:
        """Discards a partial message."""
        self._cached = b""
        self._unknown_end = 0


def _frame_end(data: bytes, at: int) -> int | None:
    """Returns the end of a frame that starts at `at`; None: no frame starts there. While its header is incomplete,
    the end is beyond the data."""
    start = data[at]
    if start not in (MAVLINK1, MAVLINK2):
        return None
    if at + 3 > len(data):
        return len(data) + 1
    length, flags = data[at + 1], data[at + 2]
    if start == MAVLINK1:
        return at + 8 + length
    if flags & ~_SIGNED:
        return None  # incompatible flags that do not exist
    return at + 12 + length + (SIGNATURE_BYTES if flags else 0)

"""Finds the next whole chunk of an MCAP file, where its records cannot be followed any more.

The length of a record is the only way to the next one: where a length or an opcode is damaged, everything after it would be
lost. A chunk is recognised by the name of its compression, and by its sizes and checksum."""

from __future__ import annotations

import re
import struct
from typing import BinaryIO, Final

from .chunk import MAX_CHUNK_BYTES, PARSE_ERRORS, unpacked

FRAME: Final = struct.Struct("<BQ")
"""Opcode and length before the content of each record."""
MAX_RECORD_BYTES: Final = 1 << 28
"""Size limit of a record in the file; a longer one is skipped."""
_COMPRESSION: Final = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")
_LONGEST: Final = 8
"""Bytes of the longer of both names, with its length."""
_BEFORE: Final = FRAME.size + 28
"""Bytes from the begin of a chunk to that name."""
FIRST_PART: Final = 1 << 12
MOST_PART: Final = 1 << 20
"""Bytes that are read and searched at a time, at first and at most: the next chunk is often near."""
_FREE_BYTES: Final = 1 << 28
_BYTES_PER_BYTE: Final = 8
"""Bytes that are read and decompressed in vain: in any file, and for each of its bytes. Damaged chunks of a real log take up to their
length and their decompressed size, once."""
_CONTENT_BYTES: Final = struct.Struct("<Q")
_BLOCK: Final = 1 << 12
"""Bytes that are read at a time where the disk has errors."""


class ChunkSearch:
    """The searches in one file. size: of the file.

    Each place where a chunk may begin is read and decompressed as far as it states, and such places may overlap: all together
    are examined up to a number of bytes that is proportional to the file."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._bytes_left = _FREE_BYTES + _BYTES_PER_BYTE * size

    @property
    def exhausted(self) -> bool:
        """Whether a search ended at the limit, and not at the end of the file."""
        return self._bytes_left < 0

    def next_chunk(self, begin: int) -> int | None:
        """The place of the first whole compressed chunk at or after `begin`; None: there is none, or the limit is reached. What the
        disk cannot read is passed over."""
        at, step = begin, FIRST_PART
        while at < self._size:
            part = _read(self._stream, at, step + _BEFORE + _LONGEST)
            for match in _COMPRESSION.finditer(part, _BEFORE):
                if self.exhausted:
                    return None
                place = at + match.start() - _BEFORE
                if self._is_chunk(place):
                    return place
            at, step = at + step, min(2 * step, MOST_PART)
        return None

    def _is_chunk(self, place: int) -> bool:
        if is_chunk(self._stream, place, self._size):
            return True
        self._bytes_left -= sum(_stated_bytes(self._stream, place, self._size) or (0, 0))
        return False


def is_chunk(stream: BinaryIO, place: int, size: int) -> bool:
    """Whether a whole compressed chunk begins there, with whatever opcode. size: of the file."""
    stated = _stated_bytes(stream, place, size)
    if stated is None:
        return False
    try:
        unpacked(_read(stream, place + FRAME.size, stated[0]), whole=True)
    except PARSE_ERRORS:
        return False
    return True


def _stated_bytes(stream: BinaryIO, place: int, size: int) -> tuple[int, int] | None:
    """Length and decompressed size of a chunk that begins there, as it states them; None: none begins there."""
    head = _read(stream, place, _BEFORE + _LONGEST)
    if _COMPRESSION.match(head, _BEFORE) is None:
        return None
    _, length = FRAME.unpack_from(head)
    (content,) = _CONTENT_BYTES.unpack_from(head, FRAME.size + 16)
    if length > min(MAX_RECORD_BYTES, size - place - FRAME.size) or content > MAX_CHUNK_BYTES:
        return None
    return int(length), int(content)


def _read(stream: BinaryIO, at: int, length: int) -> bytes:
    """Zeros where the disk cannot be read."""
    try:
        stream.seek(at)
        return stream.read(length)
    except OSError:
        if length <= _BLOCK:
            return bytes(length)
    return b"".join(_read(stream, at + k, min(_BLOCK, length - k)) for k in range(0, length, _BLOCK))

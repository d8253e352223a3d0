"""Finds the next whole chunk of an MCAP file, where its records cannot be followed any more.

The length of a record is the only way to the next one: where a length or an opcode is damaged, everything after it would be
lost. A chunk is recognised by the name of its compression, and by its sizes and checksum."""

from __future__ import annotations

import re
import struct
from typing import BinaryIO, Final

from .chunk import PARSE_ERRORS, unpacked

FRAME: Final = struct.Struct("<BQ")
"""Opcode and length before the content of each record."""
MAX_RECORD_BYTES: Final = 1 << 28
"""Size limit of a record in the file; a longer one is skipped."""
_COMPRESSION: Final = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")
_LONGEST: Final = 8
"""Bytes of the longer of both names, with its length."""
_BEFORE: Final = FRAME.size + 28
"""Bytes from the begin of a chunk to that name."""
_PART: Final = 1 << 20
"""Bytes that are read and searched at a time."""
_BLOCK: Final = 1 << 12
"""Bytes that are read at a time where the disk has errors."""


def next_chunk(stream: BinaryIO, begin: int, size: int) -> int | None:
    """The place of the first whole compressed chunk at or after `begin`; None: there is none. size: of the file. What the
    disk cannot read is passed over."""
    for at in range(begin, size, _PART):
        part = _read(stream, at, _PART + _BEFORE + _LONGEST)
        for match in _COMPRESSION.finditer(part, _BEFORE):
            place = at + match.start() - _BEFORE
            if is_chunk(stream, place, size):
                return place
    return None


def is_chunk(stream: BinaryIO, place: int, size: int) -> bool:
    """Whether a whole compressed chunk begins there, with whatever opcode. size: of the file."""
    head = _read(stream, place, _BEFORE + _LONGEST)
    if _COMPRESSION.match(head, _BEFORE) is None:
        return False
    _, length = FRAME.unpack_from(head)
    if length > min(MAX_RECORD_BYTES, size - place - FRAME.size):
        return False
    try:
        unpacked(_read(stream, place + FRAME.size, length), whole=True)
    except PARSE_ERRORS:
        return False
    return True


def _read(stream: BinaryIO, at: int, length: int) -> bytes:
    """Zeros where the disk cannot be read."""
    try:
        stream.seek(at)
        return stream.read(length)
    except OSError:
        if length <= _BLOCK:
            return bytes(length)
    return b"".join(_read(stream, at + k, min(_BLOCK, length - k)) for k in range(0, length, _BLOCK))

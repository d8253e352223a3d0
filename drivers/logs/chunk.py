"""The records of an MCAP chunk, unpacked within limits: what a file claims of itself is never believed.

A few kilobytes of zstd can unpack to gigabytes. Here a chunk that claims more than `MOST_CHUNK_BYTES` is refused before
it is unpacked, and unpacking ends as soon as there is more than the chunk claims."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Final

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Chunk

MAX_CHUNK_BYTES: Final = 1 << 26
"""Unpacked. Writers make chunks of about 1 MiB; a larger one holds a single large message."""
MAX_WINDOW_BYTES: Final = 1 << 27
"""Of a zstd frame: what the decompressor may allocate for it."""
_FIXED: Final = struct.Struct("<QQQI")
"""First and last time, unpacked size, checksum."""
PARSE_ERRORS: Final = (struct.error, McapError, UnicodeDecodeError, RuntimeError, zstandard.ZstdError)


def unpacked(payload: bytes, whole: bool) -> bytes:
    """The records of a chunk. payload: the content of the chunk's record. whole: False for the last chunk of a cut file,
    which gives what can be unpacked. Raises one of PARSE_ERRORS."""
    _, _, size, crc = _FIXED.unpack_from(payload)
    if size > MAX_CHUNK_BYTES:
        raise McapError(f"it claims to unpack to {size} bytes, more than the limit of {MAX_CHUNK_BYTES}")
    chunk = Chunk.read(ReadDataStream(io.BytesIO(payload)))
    data = _content(chunk, size, whole)
    if len(data) > size:
        raise McapError(f"it unpacks to more than the {size} bytes that it claims")
    if whole and (len(data) != size or (crc and zlib.crc32(data) != crc)):
        raise McapError("its checksum is wrong")
    return data


def _content(chunk: Chunk, size: int, whole: bool) -> bytes:
    """At most size + 1 bytes: one more than claimed shows that there is more."""
    match chunk.compression:
        case "":
            return chunk.data[: size + 1]
        case "zstd":
            decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW_BYTES)
            return decompressor.stream_reader(chunk.data).read(size + 1)
        case "lz4":
            return _lz4(chunk.data, size + 1) if whole else b""
    raise McapError(f"unknown compression {chunk.compression!r}")


def _lz4(data: bytes, most: int) -> bytes:
    unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)
    return unpacked

"""Decompresses the chunks of an MCAP file within limits: sizes stated in the file are not trusted.

A few kilobytes of zstd can decompress to gigabytes. A chunk that states more than `MAX_CHUNK_BYTES` is refused, and
decompression stops when the stated size is exceeded."""

from __future__ import annotations

import io
import struct
from typing import Final

import lz4.frame
import zstandard
from fastcrc.crc32 import iso_hdlc
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Chunk

MAX_CHUNK_BYTES: Final = 1 << 26
"""Decompressed size limit. Writers use chunks of about 1 MiB; a larger one contains a single large message."""
MAX_WINDOW_BYTES: Final = 1 << 27
"""Limit of the memory that the decompressor may allocate for a zstd frame."""
_FIXED: Final = struct.Struct("<QQQI")
"""First and last time, decompressed size, checksum."""
PARSE_ERRORS: Final = (
    struct.error,
    McapError,
    UnicodeDecodeError,
    RuntimeError,
    OverflowError,  # a length of more than 63 bits
    zstandard.ZstdError,
)


def parse_error_text(error: Exception) -> str:
    """The cause of one of PARSE_ERRORS; those of the libraries are empty, or name their own functions."""
    if isinstance(error, UnicodeDecodeError):
        return "a name in it is not text"
    if isinstance(error, struct.error) or not str(error):
        return "it ends within a field"
    return str(error)


def unpacked(payload: bytes, whole: bool) -> bytes:
    """The records of a chunk. payload: content of the chunk's record. whole: False for the last chunk of a truncated
    file, which is decompressed as far as possible. Raises one of PARSE_ERRORS."""
    _, _, size, crc = _FIXED.unpack_from(payload)
    if size > MAX_CHUNK_BYTES:
        raise McapError(f"it states a decompressed size of {size} bytes, more than the limit of {MAX_CHUNK_BYTES}")
    chunk = Chunk.read(ReadDataStream(io.BytesIO(payload)))
    data = _content(chunk, size, whole)
    if len(data) > size:
        raise McapError(f"it decompresses to more than the stated {size} bytes")
    if whole and (len(data) != size or (crc and iso_hdlc(data) != crc)):
        raise McapError("its checksum is wrong")
    return data


def stored_bytes(payload: bytes) -> int:
    """Length of the content of a chunk's record by its own fields. payload: of a chunk that `unpacked` accepts. The record may
    be longer: by fields of a newer format, or where its length is damaged."""
    (name_bytes,) = struct.unpack_from("<I", payload, _FIXED.size)
    size_at = _FIXED.size + 4 + int(name_bytes)
    (data_bytes,) = struct.unpack_from("<Q", payload, size_at)
    return size_at + 8 + int(data_bytes)


def _content(chunk: Chunk, size: int, whole: bool) -> bytes:
    """At most size + 1 bytes: one byte more than stated shows the excess."""
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

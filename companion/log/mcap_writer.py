"""A fast writer for MCAP files: messages are collected in one buffer; each chunk is compressed and written.

The mcap library's writer copies each image about six times and creates a compressor per chunk. This writer copies an
image once and keeps buffer and compressor. The chunk checksum is zlib's CRC-32, computed by fastcrc in a tenth of the
time. Header, schemas, channels and the closing part are the library's records."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO, Final

from fastcrc.crc32 import iso_hdlc
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Header, Schema, Statistics, SummaryOffset
from zstandard import ZstdCompressor

from drivers.logs.record_scanner import MAGIC

ZSTD_LEVEL: Final = 1
"""Default compression level; measurements of others: docs/research/service-measurements.md."""
_MESSAGE: Final = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time."""
_MESSAGE_HEAD: Final = 22
"""Bytes of that length without the message."""
_CHUNK: Final = struct.Struct("<BQQQQII4sQ")
"""Opcode, length, first and last time, uncompressed size and checksum, "zstd" with its length, compressed size."""
_INDEX: Final = struct.Struct("<BQHI")
_CHUNK_INDEX: Final = struct.Struct("<BQQQQQI")
"""Opcode, length, first and last time, offset and length of the chunk, bytes of the following offsets."""
_PLACE: Final = struct.Struct("<HQ")
"""A channel and the offset of its index."""
_CHUNK_SIZES: Final = struct.Struct("<QI4sQQ")
"""Length of all indexes, "zstd" with its length, compressed and uncompressed size."""
_START: Final = 1 << 16
MOST_GAP: Final = 16
"""Chunks after which the definitions are repeated: 7 kB of up to 16 MiB before compression, of about 16 s in a live log without images."""

Part = bytes | memoryview


class McapWriter:
    """An MCAP file being written: `start`, then channels and messages, then `finish`, which leaves the stream open.

    level: of zstandard; a lower level, also below 0, is faster and gives larger files."""

    def __init__(self, stream: BinaryIO, chunk_bytes: int, level: int = ZSTD_LEVEL) -> None:
        self._stream, self._chunk_bytes = stream, chunk_bytes
        self._compressor = ZstdCompressor(level=level)
        self._buffer = memoryview(bytearray(_START))
        self._filled = 0
        self._definitions = b""  # records of all schemas and channels
        self._gap = self._chunks_to_repeat = 1
        self._offset = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._indexes: dict[int, array[int]] = {}
        self._counts: dict[int, int] = {}
        self._chunks: list[bytes] = []
        self._first_ns = self._last_ns = self._messages = 0

    def start(self, library: str) -> None:
        """Writes the header. Raises OSError, as all writing methods do."""
        self._write(MAGIC)
        self._write(_record(Header("", library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Registers a message type; returns its number."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._define(_record(schema))
        return schema.id

    def register_channel(self, topic: str, message_encoding: str, schema_id: int) -> int:
        """Registers a channel; returns its number."""
        channel = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding=message_encoding, schema_id=schema_id, metadata={}
        )
        self._channels.append(channel)
        self._define(_record(channel))
        return channel.id

    def add_message(
        self, channel_id: int, log_time: int, parts: Sequence[Part], publish_time: int, sequence: int
    ) -> None:
        """Adds a message whose bytes are the concatenated parts."""
        size = 0
        for part in parts:
            size += len(part)
        at = self._room(_MESSAGE.size + size)
        _MESSAGE.pack_into(
            self._buffer, at, Opcode.MESSAGE, _MESSAGE_HEAD + size, channel_id, sequence, log_time, publish_time
        )
        end = at + _MESSAGE.size
        for part in parts:
            begin, end = end, end + len(part)
            self._buffer[begin:end] = part
        self._filled = end
        index = self._indexes.get(channel_id)
        if index is None:
            index = self._indexes[channel_id] = array("Q")
        index.append(log_time)
        index.append(at)
        if end > self._chunk_bytes:
            self._finish_chunk()

    def end_chunk(self) -> None:
        """Writes the messages since the last chunk as a chunk of their own."""
        if self._indexes:
            self._finish_chunk()

    def finish(self) -> None:
        """Writes the last chunk and the summary, which readers need for random access."""
        self.end_chunk()
        self._write(_record(DataEnd(0)))
        start = self._offset
        groups: tuple[tuple[int, Iterable[bytes]], ...] = (
            (Opcode.SCHEMA, map(_record, self._schemas)),
            (Opcode.CHANNEL, map(_record, self._channels)),
            (Opcode.STATISTICS, [_record(self._statistics())]),
            (Opcode.CHUNK_INDEX, self._chunks),
        )
        summary, offsets = b"", b""
        for opcode, records in groups:
            data = b"".join(records)
            if data:
                offsets += _record(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        footer = (start, start + len(summary))
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, *footer)
        self._write(summary + offsets)
        self._write(_record(Footer(*footer, zlib.crc32(head, zlib.crc32(summary + offsets)))))
        self._write(MAGIC)

    def _room(self, size: int) -> int:
        """Reserves `size` bytes in the buffer."""
        if self._filled + size > len(self._buffer):
            grown = memoryview(bytearray(2 * (self._filled + size)))
            grown[: self._filled] = self._buffer[: self._filled]
            self._buffer = grown
        return self._filled

    def _define(self, data: bytes) -> None:
        """Adds the record of a schema or channel to this chunk, and to the next one: messages can be read where a chunk before them is
        damaged and the file has no summary."""
        self._definitions += data
        self._gap = self._chunks_to_repeat = 1
        self._append(data)

    def _repeat_definitions(self) -> None:
        """Begins a chunk with all definitions where they are due: after 1, 2, 4, ... chunks, at last after each MOST_GAP."""
        self._chunks_to_repeat -= 1
        if self._chunks_to_repeat == 0:
            self._append(self._definitions)
            self._gap = self._chunks_to_repeat = min(2 * self._gap, MOST_GAP)

    def _append(self, data: bytes) -> None:
        at = self._room(len(data))
        self._buffer[at : at + len(data)] = data
        self._filled += len(data)

    def _write(self, data: Part) -> None:
        self._stream.write(data)
        self._offset += len(data)

    def _finish_chunk(self) -> None:
        """Compresses and writes the buffer as a chunk with its message indexes."""
        content, start = self._buffer[: self._filled], self._offset
        times = [index[::2] for index in self._indexes.values()]
        first_ns, last_ns = min(map(min, times)), max(map(max, times))
        data = self._compressor.compress(content)
        self._write(
            _CHUNK.pack(
                Opcode.CHUNK,
                _CHUNK.size - 9 + len(data),
                first_ns,
                last_ns,
                len(content),
                iso_hdlc(content),
                4,
                b"zstd",
                len(data),
            )
        )
        self._write(data)
        places, after = b"", self._offset
        for channel_id, index in self._indexes.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + len(index) // 2
            places += _PLACE.pack(channel_id, self._offset)
            packed = struct.pack(f"<{len(index)}Q", *index)
            self._write(_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(packed), channel_id, len(packed)) + packed)
        # encoded now: encoding a thousand chunk indexes at the end would delay a frame or two
        size = _CHUNK_INDEX.size - 9 + len(places) + _CHUNK_SIZES.size
        self._chunks.append(
            _CHUNK_INDEX.pack(Opcode.CHUNK_INDEX, size, first_ns, last_ns, start, after - start, len(places))
            + places
            + _CHUNK_SIZES.pack(self._offset - after, 4, b"zstd", len(data), len(content))
        )
        self._stream.flush()  # the chunk survives the end of this process
        self._first_ns = min(self._first_ns, first_ns) if self._messages else first_ns
        self._last_ns = max(self._last_ns, last_ns)
        self._messages += sum(map(len, times))
        self._filled, self._indexes = 0, {}
        self._repeat_definitions()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=self._messages,
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _record(record: Any) -> bytes:
    """A library record as bytes."""
    builder: Any = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())

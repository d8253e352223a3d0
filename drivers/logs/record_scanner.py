"""Records of an MCAP file in file order, from files that may be unfinished, cut or corrupt.

The stock readers trust the index at the end and their lengths; after a power cut there is no index, and a short read
goes unnoticed. Here every record is taken only when all of it is there, the last chunk of a cut file as far as it can
be unpacked, and a chunk with a wrong checksum is left out; each such place is told as a `Damage`.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Footer, Header, Message, Metadata, Schema, Statistics

from .chunk import PARSE_ERRORS, unpacked

MAGIC: Final = b"\x89MCAP0\r\n"
_FRAME: Final = struct.Struct("<BQ")
_FOOTER_BYTES: Final = _FRAME.size + 20
_MAX_RECORD_BYTES: Final = 1 << 28
"""In the file; a longer record is left out."""
_FIRST_RECORDS: Final = 100_000
"""Records in chunks that are read of any file, and one more for each byte of it. Real messages need several bytes each,
however well they compress."""
_FIRST_PRIVATE: Final = 0x80


@dataclass(frozen=True, slots=True)
class Damage:
    """A place that could not be read. fatal: nothing after it can be found either."""

    offset: int
    cause: str
    fatal: bool


@dataclass(frozen=True, slots=True)
class Logged:
    """A message with its channel and schema (None: the channel has none)."""

    channel: Channel
    schema: Schema | None
    message: Message


@dataclass(frozen=True, slots=True)
class Summary:
    """What the end of a finished file says about all of it."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    counts: dict[int, int]


Item = Logged | Attachment | Metadata | Damage


class NotMcap(ValueError):
    """The file does not begin as an MCAP file does."""


class McapScan:
    """One pass over a file. Raises OSError, and NotMcap when it is something else."""

    def __init__(self, path: Path) -> None:
        self._stream: BinaryIO = path.open("rb")
        try:
            self._size = self._stream.seek(0, io.SEEK_END)
            self._stream.seek(0)
            if self._stream.read(len(MAGIC)) != MAGIC:
                raise NotMcap("empty" if self._size == 0 else "does not begin with the MCAP magic")
            self.summary = self._read_summary()
        except BaseException:
            self._stream.close()
            raise
        self._records_left = _FIRST_RECORDS + self._size
        self.header: Header | None = None
        self.schemas: dict[int, Schema] = dict(self.summary.schemas) if self.summary else {}
        self.channels: dict[int, Channel] = dict(self.summary.channels) if self.summary else {}
        self._lost_channels: set[int] = set()

    def close(self) -> None:
        """May be called again."""
        self._stream.close()

    @property
    def share_read(self) -> float:
        """How far the pass has come, 0..1."""
        return 1.0 if self._stream.closed else self._stream.tell() / max(1, self._size)

    def items(self) -> Iterator[Item]:
        """All messages, attachments, metadata and damage from the beginning, in file order."""
        at = len(MAGIC)
        ended = False
        while at < self._size:
            self._stream.seek(at)
            frame = self._stream.read(_FRAME.size)
            if ended and frame[: len(MAGIC)] == MAGIC and at + len(MAGIC) == self._size:
                return
            if len(frame) < _FRAME.size:
                break
            opcode, length = _FRAME.unpack(frame)
            if opcode == 0 and self._only_zeros(at):
                break
            if not _known(opcode):
                yield Damage(at, f"no record begins with 0x{opcode:02x}", fatal=True)
                return
            if at + _FRAME.size + length > self._size:
                if opcode == Opcode.CHUNK and self._size - at <= _MAX_RECORD_BYTES:
                    yield from self._chunk(at, self._stream.read(self._size - at - _FRAME.size), whole=False)
                break
            ended = ended or opcode == Opcode.FOOTER
            if length > _MAX_RECORD_BYTES:
                yield Damage(
                    at, f"record left out: {length} bytes, more than the limit of {_MAX_RECORD_BYTES}", fatal=False
                )
            else:
                yield from self._record(at, opcode, length)
            if self._records_left < 0:
                most = _FIRST_RECORDS + self._size
                yield Damage(at, f"it holds more records than the limit of {most} for a file of this size", fatal=True)
                return
            at += _FRAME.size + length
        yield Damage(at, "the file ends there without its closing part", fatal=True)

    def _only_zeros(self, at: int) -> bool:
        """Whether nothing else follows: a last block that was not full, or room that a power cut left unwritten."""
        self._stream.seek(at)
        while part := self._stream.read(1 << 20):
            if part.count(0) != len(part):
                return False
        return True

    def _record(self, at: int, opcode: int, length: int) -> Iterator[Item]:
        if opcode == Opcode.CHUNK:
            yield from self._chunk(at, self._stream.read(length), whole=True)
        elif opcode in (Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA) or opcode in _IN_CHUNKS:
            try:
                item = self._parsed(at, opcode, self._stream.read(length))
            except PARSE_ERRORS as error:
                item = Damage(at, f"unreadable record: {error or type(error).__name__}", fatal=False)
            if item is not None:
                yield item

    def _parsed(self, at: int, opcode: int, payload: bytes) -> Item | None:
        """A record as an item; schemas and channels are kept. A repeated channel keeps its first meaning."""
        stream = ReadDataStream(io.BytesIO(payload))
        match opcode:
            case Opcode.HEADER:
                self.header = Header.read(stream)
            case Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas.setdefault(schema.id, schema)
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels.setdefault(channel.id, channel)
            case Opcode.ATTACHMENT:
                attachment: Attachment = Attachment.read(stream)
                return attachment
            case Opcode.METADATA:
                metadata: Metadata = Metadata.read(stream)
                return metadata
            case Opcode.MESSAGE:
                return self._logged(at, Message.read(stream, len(payload)))
        return None

    def _logged(self, at: int, message: Message) -> Item | None:
        channel = self.channels.get(message.channel_id)
        schema = self.schemas.get(channel.schema_id) if channel is not None else None
        if channel is not None and (schema is not None or channel.schema_id == 0):
            return Logged(channel, schema, message)
        if message.channel_id in self._lost_channels:
            return None
        self._lost_channels.add(message.channel_id)
        return Damage(at, f"messages of channel {message.channel_id}, whose description is lost", fatal=False)

    def _chunk(self, at: int, payload: bytes, whole: bool) -> Iterator[Item]:
        """What a chunk holds. A cut one: as far as it can be unpacked; the caller tells of the cut."""
        try:
            data = unpacked(payload, whole)
        except PARSE_ERRORS as error:
            if whole:
                yield Damage(at, f"chunk left out: {error or type(error).__name__}", fatal=False)
            return
        inside = 0
        while inside + _FRAME.size <= len(data):
            self._records_left -= 1
            if self._records_left < 0:
                return
            opcode, length = _FRAME.unpack_from(data, inside)
            begin = inside + _FRAME.size
            if begin + length > len(data):
                break
            if opcode in _IN_CHUNKS:
                try:
                    item = self._parsed(at, opcode, data[begin : begin + length])
                except PARSE_ERRORS as error:
                    item = Damage(at, f"unreadable record: {error or type(error).__name__}", fatal=False)
                if item is not None:
                    yield item
            inside = begin + length
        if whole and inside != len(data):
            yield Damage(at, "chunk ends within a record", fatal=False)

    def _read_summary(self) -> Summary | None:
        """The closing part, None when the file has none that can be read."""
        tail = _FOOTER_BYTES + len(MAGIC)
        if self._size < len(MAGIC) + tail:
            return None
        self._stream.seek(-tail, io.SEEK_END)
        end = self._stream.read(tail)
        opcode, length = _FRAME.unpack_from(end)
        if end[_FOOTER_BYTES:] != MAGIC or opcode != Opcode.FOOTER or length != _FOOTER_BYTES - _FRAME.size:
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(end[_FRAME.size :])))
        if not len(MAGIC) <= footer.summary_start < self._size - tail:
            return None
        if self._size - tail - footer.summary_start > _MAX_RECORD_BYTES:
            return None
        self._stream.seek(footer.summary_start)
        data = self._stream.read(self._size - tail - footer.summary_start)
        if footer.summary_crc and zlib.crc32(end[: _FRAME.size + 16], zlib.crc32(data)) != footer.summary_crc:
            return None
        try:
            return _summary(data)
        except PARSE_ERRORS:
            return None


_IN_CHUNKS: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


def _known(opcode: int) -> bool:
    return opcode >= _FIRST_PRIVATE or Opcode.HEADER <= opcode <= Opcode.DATA_END


def _summary(data: bytes) -> Summary:
    """Schemas, channels and counts of the closing part."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    counts: dict[int, int] = {}
    at = 0
    while at + _FRAME.size <= len(data):
        opcode, length = _FRAME.unpack_from(data, at)
        stream = ReadDataStream(io.BytesIO(data[at + _FRAME.size : at + _FRAME.size + length]))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            counts = dict(Statistics.read(stream).channel_message_counts)
        at += _FRAME.size + length
    return Summary(schemas, channels, counts)

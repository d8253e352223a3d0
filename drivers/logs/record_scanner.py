"""Reads the records of an MCAP file in file order, also from unfinished, truncated or corrupt files.

The standard readers trust the index at the end and the stated lengths; after a power failure there is no index, and a
short read is not detected. This reader takes a record only if it is complete, decompresses the last chunk of a
truncated file as far as possible, skips a chunk with a wrong checksum, and goes on at the next whole chunk where a record's
head is damaged; each such place is reported as a `Damage`.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Footer, Header, Message, Metadata, Schema

from ..regular_file import regular
from .chunk import PARSE_ERRORS, parse_error_text, stored_bytes, unpacked
from .chunk_search import FIRST_PART, FRAME, MAX_RECORD_BYTES, MOST_PART, ChunkSearch, is_chunk
from .summary import Summary, summary_of

MAGIC: Final = b"\x89MCAP0\r\n"
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message; its data follow."""
_FOOTER_BYTES: Final = FRAME.size + 20
_FIRST_RECORDS: Final = 100_000
"""Number of records in chunks that are read of any file, plus one per byte of the file. Real messages need several
bytes each."""
_FIRST_PRIVATE: Final = 0x80


def _not_mcap(begin: bytes) -> str:
    """Why the first bytes of a file are not those of an MCAP file. The magic contains a line end, so that it shows a copy
    in text mode."""
    if not begin:
        return "empty"
    if begin.startswith((b"\x89MCAP0\n", b"\x89MCAP0\r\r\n")):
        return (
            "it was an MCAP file, but a copy in text mode changed its line ends, which destroys it: copy it again in "
            "binary mode (ftp: binary; git: `*.mcap binary` in .gitattributes)"
        )
    return "does not begin with the MCAP magic"


@dataclass(frozen=True, slots=True)
class Damage:
    """An unreadable place."""

    offset: int
    cause: str
    end: bool = (
        False  # the file is cut there, or its summary is damaged: what is before it was read, or is another damage
    )


@dataclass(frozen=True, slots=True)
class Logged:
    """A message with its channel and schema (None: the channel has none)."""

    channel: Channel
    schema: Schema | None
    message: Message


Item = Logged | Attachment | Metadata | Damage


class NotMcap(ValueError):
    """The file does not begin with the MCAP magic."""


class McapScan:
    """One pass over a file. Raises OSError, and NotMcap for another kind of file.

    size: bytes of the file when it was opened."""

    def __init__(self, path: Path) -> None:
        self._stream: BinaryIO = regular(path).open("rb")
        try:
            self.size: Final = self._stream.seek(0, io.SEEK_END)
            self._stream.seek(0)
            begin = self._stream.read(len(MAGIC))
            if begin != MAGIC:
                raise NotMcap(_not_mcap(begin))
            self._summary_fault = ""
            self.summary = self._read_summary()
        except BaseException:
            self._stream.close()
            raise
        self._records_left = _FIRST_RECORDS + self.size
        self._search = ChunkSearch(self._stream, self.size)
        self._checked = len(MAGIC)  # end of the last chunk that was read; a damaged length may have led over later ones
        self.header: Header | None = None
        self.schemas: dict[int, Schema] = dict(self.summary.schemas) if self.summary else {}
        self.channels: dict[int, Channel] = dict(self.summary.channels) if self.summary else {}
        self._lost_channels: set[int] = set()

    def close(self) -> None:
        """Closes the file. May be called twice."""
        self._stream.close()

    @property
    def share_read(self) -> float:
        """Progress of the pass, 0..1."""
        return 1.0 if self._stream.closed else self._stream.tell() / max(1, self.size)

    def items(self) -> Iterator[Item]:
        """All messages, attachments, metadata and damages, in file order."""
        at: int | None = len(MAGIC)
        while at is not None:
            at = yield from self._records(at)

    def _records(self, at: int) -> Generator[Item, None, int | None]:
        """Reads records from `at` on, as far as one leads to the next. Returns the place of the chunk where to go on; None: the
        file ends, or nothing after it can be read."""
        ended = False
        while at < self.size:
            try:
                frame = self._read_at(at, FRAME.size)
            except OSError as error:
                return (yield from self._broken(at, f"the disk cannot be read there ({error.strerror})"))
            if ended and frame[: len(MAGIC)] == MAGIC and at + len(MAGIC) == self.size:
                yield from self._damaged_summary(at)
                return None
            if len(frame) < FRAME.size:
                break
            opcode, length = FRAME.unpack(frame)
            if opcode == 0 and self._only_zeros(at):
                break
            if opcode != Opcode.CHUNK and is_chunk(self._stream, at, self.size):
                yield Damage(at, f"a chunk begins with 0x{opcode:02x}")
                opcode = Opcode.CHUNK
            if not _known(opcode):
                return (yield from self._broken(at, f"no record begins with 0x{opcode:02x}"))
            if at + FRAME.size + length > self.size:
                return (yield from self._end(at, opcode))
            ended = ended or opcode == Opcode.FOOTER
            yield from self._record(at, opcode, length)
            if self._records_left < 0:
                most = _FIRST_RECORDS + self.size
                yield Damage(at, f"the file has more records than the limit of {most} for its size")
                return None
            at += FRAME.size + length
        return (yield from self._end(at))

    def _broken(self, at: int, cause: str) -> Generator[Item, None, int | None]:
        """A record whose head cannot be read. Returns the place of the next chunk."""
        found = self._next_chunk()
        yield Damage(at, f"{cause}{self._limit_text}")
        return found

    def _end(self, at: int, opcode: int = 0) -> Generator[Item, None, int | None]:
        """The records end there, or one that states a length beyond the end of the file begins: the file is truncated, or a length is
        damaged where a whole chunk was not read. Returns the place of that. opcode: of the record."""
        found = self._next_chunk()
        if found is None and not self._search.exhausted:
            if opcode == Opcode.CHUNK and self.size - at <= MAX_RECORD_BYTES:
                yield from self._record(at, opcode, self.size - at - FRAME.size, whole=False)
            yield Damage(at, _NO_END, end=True)
        else:
            yield Damage(at, f"the length of this record, or of one before it, is damaged{self._limit_text}")
        return found

    @property
    def _limit_text(self) -> str:
        """What is added to a damage after which nothing more is read."""
        return (
            "; too many places look like the beginning of a chunk: the rest is not read"
            if self._search.exhausted
            else ""
        )

    def _next_chunk(self) -> int | None:
        """The place of the next chunk that was not read. Each is returned once: reading it may fail where the search did not."""
        found = self._search.next_chunk(self._checked)
        if found is not None:
            self._checked = found + 1
        return found

    def _damaged_summary(self, at: int) -> Iterator[Item]:
        """The damage of the summary, which ends at `at`: readers that use the index refuse the file."""
        if self._summary_fault:
            text = f"the summary at its end is damaged ({self._summary_fault})"
            yield Damage(at - _FOOTER_BYTES, text, end=True)

    def _only_zeros(self, at: int) -> bool:
        """Whether the rest is zeros: a partial block, or space that a power failure left unwritten."""
        most = FIRST_PART
        while at < self.size:
            try:
                part = self._read_at(at, most)
            except OSError:
                return False
            if part.count(0) != len(part) or not part:
                return False
            at, most = at + len(part), min(2 * most, MOST_PART)
        return True

    def _read_at(self, at: int, length: int) -> bytes:
        """Raises OSError for a damaged disk."""
        self._stream.seek(at)
        return self._stream.read(length)

    def _record(self, at: int, opcode: int, length: int, whole: bool = True) -> Iterator[Item]:
        if length > MAX_RECORD_BYTES:
            text = f"record skipped: {length} bytes, more than the limit of {MAX_RECORD_BYTES}"
            yield Damage(at, text)
            return
        if opcode not in _READ:
            return
        try:
            payload = self._read_at(at + FRAME.size, length)
        except OSError as error:
            yield Damage(at, f"record skipped: the disk cannot be read there ({error.strerror})")
            return
        if opcode == Opcode.CHUNK:
            yield from self._chunk(at, payload, whole)
        else:
            try:
                item = self._parsed(at, opcode, memoryview(payload))
            except PARSE_ERRORS as error:
                item = Damage(at, f"unreadable record: {parse_error_text(error)}")
            if item is not None:
                yield item

    def _parsed(self, at: int, opcode: int, payload: memoryview) -> Item | None:
        """A record as an item; schemas and channels are stored. A repeated channel keeps its first definition."""
        if opcode == Opcode.MESSAGE:
            return self._logged(at, _message(payload))
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
        return None

    def _logged(self, at: int, message: Message) -> Item | None:
        channel = self.channels.get(message.channel_id)
        schema = self.schemas.get(channel.schema_id) if channel is not None else None
        if channel is not None and (schema is not None or channel.schema_id == 0):
            return Logged(channel, schema, message)
        if message.channel_id in self._lost_channels:
            return None
        self._lost_channels.add(message.channel_id)
        return Damage(at, f"messages of channel {message.channel_id}, whose description is lost")

    def _chunk(self, at: int, payload: bytes, whole: bool) -> Iterator[Item]:
        """The content of a chunk; of a truncated one as far as it can be decompressed, the caller reports the
        truncation."""
        try:
            data = unpacked(payload, whole)
        except PARSE_ERRORS as error:
            if whole:
                yield Damage(at, f"chunk skipped: {parse_error_text(error)}")
            return
        if whole:
            self._checked = at + FRAME.size + stored_bytes(payload)
        records, inside = memoryview(data), 0
        while inside + FRAME.size <= len(data):
            self._records_left -= 1
            if self._records_left < 0:
                return
            opcode, length = FRAME.unpack_from(data, inside)
            begin = inside + FRAME.size
            if begin + length > len(data):
                break
            if opcode in _IN_CHUNKS:
                try:
                    item = self._parsed(at, opcode, records[begin : begin + length])
                except PARSE_ERRORS as error:
                    item = Damage(at, f"unreadable record: {parse_error_text(error)}")
                if item is not None:
                    yield item
            inside = begin + length
        if whole and inside != len(data):
            yield Damage(at, "chunk ends within a record")

    def _read_summary(self) -> Summary | None:
        """The summary; None when the file has no readable one. Notes why one that is there is not readable."""
        tail = _FOOTER_BYTES + len(MAGIC)
        if self.size < len(MAGIC) + tail:
            return None
        try:
            end = self._read_at(self.size - tail, tail)
        except OSError:  # a damaged disk, which the pass reports
            return None
        opcode, length = FRAME.unpack_from(end)
        if end[_FOOTER_BYTES:] != MAGIC or opcode != Opcode.FOOTER or length != _FOOTER_BYTES - FRAME.size:
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(end[FRAME.size :])))
        if footer.summary_start == 0:  # permitted
            return None
        try:
            return self._summary_from(footer, self.size - tail, end[: FRAME.size + 16])
        except OSError as error:
            self._summary_fault = f"the disk cannot be read there: {error.strerror}"
        except PARSE_ERRORS as error:
            self._summary_fault = parse_error_text(error)
        return None

    def _summary_from(self, footer: Footer, end: int, footer_head: bytes) -> Summary:
        """The summary from its start to `end`. footer_head: the part of the footer that its checksum contains. Raises
        OSError, and one of PARSE_ERRORS."""
        if not len(MAGIC) <= footer.summary_start < end:
            raise McapError(f"it begins at byte {footer.summary_start}, outside of the file")
        if end - footer.summary_start > MAX_RECORD_BYTES:
            raise McapError(f"it is longer than the limit of {MAX_RECORD_BYTES} bytes")
        data = self._read_at(footer.summary_start, end - footer.summary_start)
        if footer.summary_crc and zlib.crc32(footer_head, zlib.crc32(data)) != footer.summary_crc:
            raise McapError("wrong checksum")
        return summary_of(data)


_NO_END: Final = "the file ends there without its summary"
_IN_CHUNKS: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_READ: Final = (Opcode.CHUNK, Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA, *_IN_CHUNKS)
"""Records with content; others are for random access."""


def _known(opcode: int) -> bool:
    return opcode >= _FIRST_PRIVATE or Opcode.HEADER <= opcode <= Opcode.DATA_END


def _message(payload: memoryview) -> Message:
    """The message of a record, whose data are copied once: most of a log are depth images. The library's reader copies them
    twice, and takes ten times as long for the head. Raises struct.error for a record that ends within its head."""
    channel_id, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(payload)
    return Message(
        channel_id=channel_id,
        sequence=sequence,
        log_time=log_time,
        publish_time=publish_time,
        data=bytes(payload[_MESSAGE_HEAD.size :]),
    )

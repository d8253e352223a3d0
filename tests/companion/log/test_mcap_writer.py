"""The log's own MCAP writer against the mcap library: the same messages, read by the library's own reader."""

from __future__ import annotations

import io

import numpy as np
import pytest
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, MessageIndex, Schema, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from companion.log.mcap_writer import McapWriter
from core.types import DepthFrame
from drivers.logs.codec import depth_message, depth_parts

CHUNK = 5000
Written = list[tuple[int, int, bytes, int, int]]


def messages(seed: int, count: int) -> Written:
    """(channel, log time, bytes, publish time, sequence), their times out of order, some larger than a chunk."""
    rng = np.random.default_rng(seed)
    sizes = rng.choice([0, 1, 40, 700, 20_000], count, p=[0.05, 0.2, 0.4, 0.3, 0.05])
    return [
        (int(rng.integers(1, 4)), int(rng.integers(1, 1 << 62)), rng.bytes(int(size)), int(rng.integers(1 << 62)), k)
        for k, size in enumerate(sizes)
    ]


def ours(content: Written, ended_every: int = 1000) -> bytes:
    stream = io.BytesIO()
    writer = McapWriter(stream, CHUNK)
    writer.start("test")
    schema = writer.register_schema("a.Kind", "protobuf", b"what it is")
    for k in range(3):
        assert writer.register_channel(f"/topic{k}", "protobuf", schema) == k + 1
    for channel, log_time, data, publish_time, sequence in content:
        half = len(data) // 2
        writer.add_message(channel, log_time, (data[:half], memoryview(data)[half:]), publish_time, sequence)
        if sequence % ended_every == ended_every - 1:
            writer.end_chunk()
            writer.end_chunk()
    writer.finish()
    return stream.getvalue()


def the_library(content: Written) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)
    writer.start("", "test")
    schema = writer.register_schema("a.Kind", "protobuf", b"what it is")
    for k in range(3):
        writer.register_channel(f"/topic{k}", "protobuf", schema)
    for channel, log_time, data, publish_time, sequence in content:
        writer.add_message(channel, log_time, data, publish_time, sequence)
    writer.finish()
    return stream.getvalue()


def records(data: bytes) -> list[McapRecord]:
    """Chunks as they are, checksums checked; without the places of groups that are empty."""
    found = StreamReader(io.BytesIO(data), emit_chunks=True, validate_crcs=True).records
    return [r for r in found if not isinstance(r, SummaryOffset) or r.group_length]


def placeless(record: McapRecord) -> object:
    """A record without what the level of compression changes: sizes and places."""
    if isinstance(record, Chunk):
        return (
            "chunk",
            record.message_start_time,
            record.message_end_time,
            record.uncompressed_crc,
            record.uncompressed_size,
        )
    if isinstance(record, ChunkIndex):
        return (
            "index",
            record.message_start_time,
            record.message_end_time,
            record.message_index_length,
            sorted(record.message_index_offsets),
        )
    return type(record).__name__ if isinstance(record, SummaryOffset | Footer) else record


@pytest.mark.parametrize("count", [0, 1, 300])
def test_without_repeated_definitions_the_file_is_that_of_the_library_but_for_the_compression(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(McapWriter, "_repeat_definitions", lambda writer: None)
    content = messages(3, count)
    assert list(map(placeless, records(ours(content)))) == list(map(placeless, records(the_library(content))))


def test_definitions_are_repeated_seldom_and_as_they_are() -> None:
    """So that damaged chunks cost their own messages only, where the file has no summary."""
    found = StreamReader(io.BytesIO(ours(messages(3, 600), ended_every=10)), emit_chunks=True).records
    contents = [breakup_chunk(record) for record in found if isinstance(record, Chunk)]
    definitions = [[r for r in content if isinstance(r, Schema | Channel)] for content in contents]
    assert len(definitions[0]) == 4
    assert len(definitions) > 40
    assert [k for k, records in enumerate(definitions) if records] == [0, 1, 3, 7, 15, *range(31, len(definitions), 16)]
    assert all(records in ([], definitions[0]) for records in definitions)


def test_a_reader_finds_every_message_by_the_closing_part() -> None:
    content = messages(4, 300)
    data = ours(content)
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert isinstance(summary.statistics, Statistics)
    assert summary.statistics.message_count == 300
    found = [(c.id, m.log_time, m.data, m.publish_time, m.sequence) for _, c, m in reader.iter_messages()]
    assert found == sorted(content, key=lambda m: m[1])
    one = [m.sequence for _, _, m in reader.iter_messages(topics=["/topic1"], log_time_order=False)]
    assert sorted(one) == [m[4] for m in content if m[0] == 2]


@pytest.mark.parametrize("ended_every", [1000, 7])
def test_each_place_of_the_indexes_is_consistent(ended_every: int) -> None:
    """Also of chunks that were ended early, and twice."""
    data = ours(messages(5, 300), ended_every)
    assert sum(1 for _ in make_reader(io.BytesIO(data), validate_crcs=True).iter_messages()) == 300
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    for chunk in summary.chunk_indexes:
        end = chunk.chunk_start_offset + chunk.chunk_length
        indexed = 0
        for channel, at in chunk.message_index_offsets.items():
            assert end <= at < end + chunk.message_index_length
            stream = ReadDataStream(io.BytesIO(data[at + 9 :]))
            index = MessageIndex.read(stream)
            assert index.channel_id == channel
            indexed += len(index.records)
        assert indexed > 0


def test_messages_before_a_large_one_in_a_chunk_are_kept() -> None:
    """The buffer grows for it."""
    content = [(1, 10, b"a" * 100, 11, 0), (2, 20, b"b" * 300_000, 21, 1)]
    found = make_reader(io.BytesIO(ours(content)), validate_crcs=True).iter_messages()
    assert [(c.id, m.log_time, m.data, m.publish_time, m.sequence) for _, c, m in found] == content


def test_an_image_in_parts_has_the_bytes_of_its_message() -> None:
    rng = np.random.default_rng(6)
    for width, height in ((1, 1), (7, 3), (160, 120), (640, 480)):
        depth_mm = rng.integers(0, 65536, (height, width), dtype=np.uint16)
        depth_mm.setflags(write=False)
        frame = DepthFrame(camera="front", sequence=3, t_exposure_ns=5 * 10**9 + 7, t_arrival_ns=6, depth_mm=depth_mm)
        assert b"".join(depth_parts(frame)) == depth_message(frame).SerializeToString(deterministic=True)

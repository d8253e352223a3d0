"""Writing logs: what a reader finds in them, and what they refuse."""

from __future__ import annotations

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader

from companion.log.log_file import LIBRARY
from companion.log.log_writer import LogWriter, schema_bytes, write_recording
from companion.log.provenance import run_info
from drivers.base import BadData
from drivers.logs.reader import McapRecording
from drivers.logs.record_scanner import Logged, McapScan
from drivers.logs.topics import TOPICS

from ..small_recordings import INFO, MS, START_NS, Events, flight, frame


def test_the_stock_reader_reads_a_log(whole):
    with whole.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().library == LIBRARY
        summary = reader.get_summary()
        topics = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
        off = ("tracks", "team", "neighbours")  # [tracking] and [share] are off by default
        written = [topic for key, topic in TOPICS.items() if key not in off]
        assert topics == {topic.of("front"): topic.schema for topic in written}
        assert len(summary.chunk_indexes) > 1
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
    assert all(index.compression == "zstd" for index in summary.chunk_indexes)


def test_schemas_hold_all_they_depend_on():
    for topic in TOPICS.values():
        known: set[str] = set()
        for file in FileDescriptorSet.FromString(schema_bytes(topic.message)).file:
            assert set(file.dependency) <= known, "dependencies come first"
            known.add(file.name)
        assert topic.message.DESCRIPTOR.file.name in known


def test_messages_stand_at_their_arrival_with_the_frames_number(whole):
    for item in McapScan(whole).items():
        assert isinstance(item, Logged)
        if item.channel.topic == "/camera/front/depth":
            assert item.message.log_time == START_NS + item.message.sequence * 100 * MS + 47 * MS
            assert item.message.publish_time == START_NS + item.message.sequence * 100 * MS + 7 * MS


def test_a_log_gets_its_name_when_it_is_whole(tmp_path):
    log = LogWriter(tmp_path / "a.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.active"]
    log.begin(run_info("live"), (INFO,))
    log.finish()
    log.finish()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_a_log_that_failed_keeps_what_was_written_under_its_active_name(tmp_path):
    class Broken(Exception):
        pass

    def write() -> None:
        with LogWriter(tmp_path / "a.mcap") as log:
            log.begin(run_info("live"), (INFO,))
            raise Broken

    with pytest.raises(Broken):
        write()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap.active"]


@pytest.mark.parametrize(
    ("t_ns", "sequence", "camera", "arguments"),
    [
        (-1, 0, "front", "stamp -1 ns"),
        (5, -1, "front", "sequence -1"),
        (5, 1 << 32, "front", "sequence"),
        (5, 0, "a/b", "'a/b'"),
    ],
)
def test_what_a_log_cannot_hold_is_refused(tmp_path, t_ns, sequence, camera, arguments):
    log = LogWriter(tmp_path / "a.mcap")
    with pytest.raises(ValueError, match=arguments):
        log.write("depth", frame_message(), t_ns, camera, sequence)
    log.finish()


def frame_message():
    from drivers.logs.codec import depth_message

    return depth_message(frame(0, START_NS))


def test_a_source_that_breaks_off_leaves_a_whole_log(tmp_path):
    class Cut(Events):
        def events(self):
            yield from flight(2)
            raise BadData("source: cut there; use another copy")

    with pytest.raises(BadData, match="cut there"):
        write_recording(Cut([]), tmp_path / "a.mcap", run_info("import"))
    with McapRecording(tmp_path / "a.mcap") as recording:
        assert len(list(recording.events())) == len(flight(2))

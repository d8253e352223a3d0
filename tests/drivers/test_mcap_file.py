"""Logs as a source: complete, cut at any byte, corrupt, of other software."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from companion.log.log_writer import LogWriter, schema_bytes
from companion.log.provenance import run_info
from companion.log.recover import recover
from core.types import DepthFrame
from drivers.base import BadData, DeviceNotFound, DriverError, Event
from drivers.logs.codec import attitude_message, camera_from_message, camera_message, depth_message
from drivers.logs.reader import McapRecording
from drivers.logs.record_scanner import Damage, Logged, McapScan
from drivers.logs.topics import TOPICS
from tests.nightly import first

from ..companion.small_recordings import INFO, MS, START_NS, attitude, flight, frame, write_flight


def read(path: Path) -> tuple[list[Event], str | None]:
    """The events of a log and what was wrong with it."""
    events: list[Event] = []
    try:
        with McapRecording(path) as recording:
            for event in recording.events():
                events.append(event)
    except BadData as error:
        return events, str(error)
    return events, None


def same(a: Event, b: Event) -> bool:
    if isinstance(a, DepthFrame) and isinstance(b, DepthFrame):
        labels = ("camera", "sequence", "t_exposure_ns", "t_arrival_ns")
        return all(getattr(a, n) == getattr(b, n) for n in labels) and np.array_equal(a.depth_mm, b.depth_mm)
    return a == b


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    return write_flight(tmp_path_factory.mktemp("log") / "flight.mcap")


def test_events_return_in_the_order_of_their_arrival(whole):
    events, problem = read(whole)
    assert problem is None
    assert len(events) == len(flight())
    assert all(same(a, b) for a, b in zip(events, flight(), strict=True))


def test_a_recording_has_its_cameras_and_its_making(whole):
    with McapRecording(whole) as recording:
        assert recording.cameras == (INFO,)
        assert recording.run.source == "simulated"
        assert len(recording.snapshot.attitudes) == 0
        assert [m.key for m in recording.messages("run", "state")] == ["run", "state", "run"]
        shares = [recording.share_read for _ in recording.events()]
        assert shares == sorted(shares)
        assert recording.share_read == 1.0


def test_a_pass_can_be_ended_and_begun_again(whole):
    recording = McapRecording(whole)
    next(recording.events())
    recording.close()
    recording.close()
    assert len(list(recording.events())) == len(flight())


def test_a_log_cut_at_any_byte_gives_what_is_before_the_cut(tmp_path):
    expected = flight(60)  # several blocks of the compression
    data = write_flight(tmp_path / "long.mcap", expected).read_bytes()
    cut = tmp_path / "cut.mcap"
    delivered = []
    for size in [*range(0, len(data), len(data) // 50), *range(len(data) - 12, len(data))]:
        cut.write_bytes(data[:size])
        events, problem = read(cut)
        assert problem is not None, f"cut at {size} of {len(data)} bytes"
        assert "cut.mcap" in problem
        assert all(same(a, b) for a, b in zip(events, expected, strict=False)), f"cut at {size}"
        delivered.append(len(events))
    assert delivered == sorted(delivered)
    assert delivered[0] == 0
    assert delivered[-1] == len(expected)
    assert len(set(delivered)) > 3, "a cut chunk is unpacked as far as it goes"


def test_a_cut_log_names_the_place_and_the_remedy(whole, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-100])
    _, problem = read(cut)
    assert "damaged at byte" in problem
    assert f"`companion recover {cut}`" in problem


class BadSector(io.FileIO):
    """A file on a disk that cannot be read in one place."""

    def __init__(self, path: Path, begin: int, end: int) -> None:
        super().__init__(path)
        self._begin, self._end = begin, end

    def readinto(self, buffer: Any) -> int:
        view, at = memoryview(buffer).cast("B"), self.tell()
        if self._begin <= at < self._end:
            raise OSError(5, "Input/output error")
        return super().readinto(view[: self._begin - at] if at < self._begin < at + len(view) else view)


@pytest.mark.parametrize("place", ["chunk", "frame", "summary"])
def test_a_place_that_the_disk_cannot_read_costs_its_record_only(place, tmp_path, monkeypatch):
    """The first error of the disk ended replay and recovery of the whole log."""
    whole = tmp_path / "flight.mcap"
    with LogWriter(whole) as log:
        log.begin(run_info("live"), (INFO,), t_ns=START_NS)
        for number, event in enumerate(flight(100)):
            log.event(event)
            if number % 100 == 99:
                log.sync()
    data = whole.read_bytes()
    chunks = [i.chunk_start_offset for i in make_reader(whole.open("rb")).get_summary().chunk_indexes]
    begin = {"chunk": chunks[2] + 100, "frame": chunks[-1] + 3, "summary": len(data) - 12}[place]
    opened = Path.open

    def open_file(path: Path, mode: str = "r", **options: Any) -> Any:
        if path == whole and mode == "rb":
            return io.BufferedReader(BadSector(whole, begin, begin + 4))
        return opened(path, mode, **options)

    expected, _ = read(whole)
    monkeypatch.setattr(Path, "open", open_file)
    result = recover(whole, tmp_path / "recovered.mcap")
    if place == "summary":  # all messages are there
        assert result.output is None
        assert len(read(whole)[0]) == len(expected)
        return
    assert "the disk cannot be read there (Input/output error)" in result.damages[0].cause
    found, damage = read(tmp_path / "recovered.mcap")
    assert damage is None
    assert 0.5 * len(expected) < len(found) < len(expected)
    assert all(any(same(a, b) for b in expected) for a in found[::50])
    _, damage = read(whole)
    assert damage is not None
    assert "companion recover" in damage


def test_a_log_of_a_killed_run_is_read(tmp_path):
    """Nothing was closed: what had reached the disk is there."""
    log = LogWriter(tmp_path / "killed.mcap")
    log.begin(run_info("live"), (INFO,), t_ns=START_NS)
    events = flight(300)
    for event in events:
        log.event(event)
    killed = tmp_path / "copy.mcap.active"
    killed.write_bytes(log.active_path.read_bytes())
    found, problem = read(killed)
    assert problem is not None
    assert 100 < len(found) < len(events)
    assert all(same(a, b) for a, b in zip(found, events, strict=False))
    assert not log.path.exists()
    log.finish()
    assert log.path.exists()
    assert not log.active_path.exists()
    assert read(log.path)[1] is None


def test_a_log_that_ends_with_zeros_is_cut_there(tmp_path):
    """Some file systems leave zeros behind what was written when the power fails."""
    log = LogWriter(tmp_path / "killed.mcap")
    log.begin(run_info("live"), (INFO,), t_ns=START_NS)
    events = flight(300)
    for event in events:
        log.event(event)
    log.abandon()
    content = log.active_path.read_bytes()
    killed = tmp_path / "copy.mcap.active"
    killed.write_bytes(content + bytes(3000))
    found, problem = read(killed)
    assert f"damaged at byte {len(content)}" in problem
    assert "ends there without its summary" in problem
    assert 100 < len(found) < len(events)
    assert all(same(a, b) for a, b in zip(found, events, strict=False))
    killed.write_bytes(killed.read_bytes() + b"\0" * 9 + b"!")
    assert "no record begins with 0x00" in read(killed)[1]


@pytest.mark.parametrize("seed", first(20, range(60)))
def test_a_flipped_byte_is_never_taken_for_data(whole, tmp_path, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(whole.read_bytes())
    data[int(rng.integers(8, len(data)))] ^= 1 << int(rng.integers(0, 8))
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    try:
        events, _ = read(bad)
    except DriverError:
        return
    assert all(same(a, b) for a, b in zip(events, flight(), strict=False))


@pytest.mark.parametrize("seed", first(5, range(20)))
def test_noise_after_the_magic_is_an_error_of_ours(tmp_path, seed):
    noise = np.random.default_rng(seed).integers(0, 256, 4000, dtype=np.uint8).tobytes()
    path = tmp_path / "noise.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + noise)
    with pytest.raises(DriverError, match=r"noise\.mcap"):
        McapRecording(path)


def test_a_chunk_that_claims_to_unpack_to_a_terabyte_is_left_out(whole, tmp_path):
    data = bytearray(whole.read_bytes())
    at = 8 + 9 + int.from_bytes(data[9:17], "little")
    assert data[at] == 0x06, "the first record after the header is a chunk"
    data[at + 9 + 16 : at + 9 + 24] = (1 << 40).to_bytes(8, "little")
    path = tmp_path / "bomb.mcap"
    path.write_bytes(data)
    damages = [item for item in McapScan(path).items() if isinstance(item, Damage)]
    assert "1099511627776 bytes" in damages[0].cause


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(DeviceNotFound, match="the file does not exist"):
        McapRecording(tmp_path / "none.mcap")


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r", b"PK\x03\x04 a zip, by its look", b"\x89PNG\r\n\x1a\n"])
def test_a_file_that_is_no_mcap(tmp_path, content):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(BadData, match="not an MCAP file"):
        McapRecording(path)


def foreign(path: Path, topics: dict[str, tuple[str, str]]) -> Path:
    """An MCAP of other topics: name -> (schema, encoding)."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4)
        writer.start()
        for topic, (schema, encoding) in topics.items():
            channel = writer.register_channel(topic, encoding, writer.register_schema(schema, "ros2msg", b"x"))
            writer.add_message(channel, 5, b"12345", 5)
        writer.finish()
    return path


def test_a_foreign_log_is_refused_with_what_it_lacks_and_has(shared_data):
    with pytest.raises(BadData, match="not a recording of this software") as refusal:
        McapRecording(shared_data / "mcap" / "keelson_ais_protobuf.mcap")
    text = str(refusal.value)
    assert "lacks depth (foxglove.RawImage on /camera/<name>/depth)" in text
    assert "keelson.primitives.TimestampedBytes" in text
    assert len(text) < 1500


def test_a_ros_2_log_with_depth_is_pointed_to_the_import(tmp_path):
    path = foreign(tmp_path / "ros.mcap", {"/cam/depth/image_rect_raw": ("sensor_msgs/msg/Image", "cdr")})
    with pytest.raises(BadData, match=r"companion import .*ros\.mcap") as refusal:
        McapRecording(path)
    assert "/cam/depth/image_rect_raw" in str(refusal.value)


def test_a_log_without_topics_is_refused(tmp_path):
    with pytest.raises(BadData, match="it has no topics"):
        McapRecording(foreign(tmp_path / "empty.mcap", {}))


def handmade(path: Path, messages: list[tuple[str, str, object]]) -> Path:
    """A log of (key, camera, message) as they are, without what a log should open with."""
    with LogWriter(path) as log:
        for i, (key, camera, message) in enumerate(messages):
            log.write(key, message, START_NS + i * MS, camera=camera, sequence=i)
    return path


def test_depth_without_a_camera_description_is_refused(tmp_path):
    path = handmade(tmp_path / "bare.mcap", [("depth", "front", depth_message(frame(0, START_NS)))])
    with pytest.raises(BadData, match=r"/camera/front/info is missing"):
        McapRecording(path)


def test_the_bias_of_a_camera_is_logged_and_older_logs_have_none():
    info = dataclasses.replace(INFO, bias_per_m=0.004)
    message = camera_message(info)
    assert camera_from_message(message) == info
    message.ClearField("bias_per_m")
    assert camera_from_message(message) == dataclasses.replace(info, bias_per_m=0.0)


def test_intrinsics_that_do_not_fit_are_refused(tmp_path):
    message = camera_message(INFO)
    message.fx_px = 5000.0
    path = handmade(tmp_path / "fx.mcap", [("camera_info", "front", message)])
    with pytest.raises(BadData, match=r"/camera/front/info: intrinsics: fx=5000.*calibrated at another resolution"):
        McapRecording(path)


def test_samples_that_do_not_fit_are_left_out_and_reported(tmp_path):
    nan = attitude_message(attitude(START_NS))
    nan.q_ned_frd.x = float("nan")
    small = depth_message(dataclasses.replace(frame(1, START_NS), depth_mm=np.ones((20, 20), np.uint16)))
    wrong = RawImage()
    wrong.CopyFrom(depth_message(frame(2, START_NS)))
    wrong.encoding = "rgb8"
    path = handmade(
        tmp_path / "odd.mcap",
        [
            ("camera_info", "front", camera_message(INFO)),
            ("attitude", "", nan),
            ("attitude", "", attitude_message(attitude(START_NS))),
            ("depth", "front", small),
            ("depth", "front", wrong),
            ("depth", "front", depth_message(frame(3, START_NS))),
        ],
    )
    events, problem = read(path)
    assert [type(e).__name__ for e in events] == ["AttitudeSample", "DepthFrame", "DepthFrame", "DepthFrame"]
    # an image that cannot be used is not forgotten: its exposure comes as one unknown pixel, which is blind
    assert [e.depth_mm.shape for e in events[1:]] == [(1, 1), (1, 1), (INFO.intrinsics.height, INFO.intrinsics.width)]
    assert not events[1].depth_mm.any()
    assert "3 messages are invalid and were left out (an image among them is blind), the first:" in problem
    assert "/vehicle/attitude: attitude at" in problem
    assert "nan" in problem


def test_undecodable_bytes_are_left_out_and_reported(tmp_path):
    path = tmp_path / "garbled.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for key, data in (("camera_info", camera_message(INFO).SerializeToString()), ("attitude", b"\xff\xff\xff")):
            topic = TOPICS[key]
            schema = writer.register_schema(topic.schema, "protobuf", schema_bytes(topic.message))
            writer.add_message(writer.register_channel(topic.of("front"), "protobuf", schema), 5, data, 5)
        writer.finish()
    events, problem = read(path)
    assert events == []
    assert "/vehicle/attitude" in problem


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("chunked", [True, False])
def test_logs_that_other_tools_wrote_again_are_read(whole, tmp_path, compression, chunked):
    """Other chunks, other compression: the content counts."""
    path = tmp_path / "again.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked, chunk_size=3000)
        writer.start()
        channels: dict[int, int] = {}
        for item in McapScan(whole).items():
            assert isinstance(item, Logged)
            c, s, m = item.channel, item.schema, item.message
            if c.id not in channels:
                schema = writer.register_schema(s.name, s.encoding, s.data)
                channels[c.id] = writer.register_channel(c.topic, c.message_encoding, schema)
            writer.add_message(channels[c.id], m.log_time, m.data, m.publish_time, m.sequence)
        writer.finish()
    events, problem = read(path)
    assert problem is None
    assert all(same(a, b) for a, b in zip(events, flight(), strict=True))


def test_an_unchunked_log_cut_within_a_message_does_not_deliver_it(whole, tmp_path):
    path = tmp_path / "plain.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start()
        for key, camera, message in (
            ("camera_info", "front", camera_message(INFO)),
            ("depth", "front", depth_message(frame(0, START_NS))),
            ("depth", "front", depth_message(frame(1, START_NS + MS))),
        ):
            topic = TOPICS[key]
            schema = writer.register_schema(topic.schema, "protobuf", schema_bytes(topic.message))
            channel = writer.register_channel(topic.of(camera), "protobuf", schema)
            writer.add_message(channel, START_NS, message.SerializeToString(), START_NS)
    data = path.read_bytes()
    path.write_bytes(data[:-10])
    events, problem = read(path)
    assert [e.t_exposure_ns for e in events] == [START_NS]
    assert problem is not None

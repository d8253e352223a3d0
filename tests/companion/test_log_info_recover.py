"""Writing logs, telling what is in them, making damaged ones whole."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shlex
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from companion.cli import main
from companion.log.info import print_info
from companion.log.log_content import read_log_info
from companion.log.log_file import LIBRARY, FileInUseError, is_being_written, open_locked
from companion.log.log_writer import LogWriter, schema_bytes, write_recording
from companion.log.provenance import run_info
from companion.log.recover import recover
from companion.log.repair import repair_file
from companion.pipeline.pipeline import Pipeline
from core.types import AttitudeSample
from drivers.base import BadData, DriverError
from drivers.logs.reader import McapRecording
from drivers.logs.record_scanner import Damage, Logged, McapScan
from drivers.logs.topics import TOPICS

from .made_up import INFO, MS, START_NS, EasyExtractor, Events, attitude, flight, frame, write_flight


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A flight with prisms, long enough for several chunks."""
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    pipeline = Pipeline((INFO,), EasyExtractor)
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (INFO,), pipeline.state(), START_NS)
        for key in ("mavlink", "clock", "health"):  # of a live run only
            log.write(key, TOPICS[key].message(), START_NS)
        for event in flight(400):
            log.event(event)
            for output in pipeline.handle(event):
                log.output(output)
    return path


# ---- writing ----------------------------------------------------------------------------------------------------


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


# ---- info -------------------------------------------------------------------------------------------------------


def test_info_shows_topics_rates_and_gaps(tmp_path, capsys):
    events = [e for e in flight(30) if not (isinstance(e, AttitudeSample) and 6_000 <= e.t_ns / MS < 6_500)]
    path = write_flight(tmp_path / "gap.mcap", events)
    assert main(["info", str(path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    topics = {t["topic"]: t for t in report["topics"]}
    assert topics["/camera/front/depth"]["messages"] == 30
    assert topics["/camera/front/depth"]["rate_hz"] == pytest.approx(10.0)
    assert topics["/camera/front/depth"]["gaps"] == 0
    assert topics["/vehicle/attitude"]["gaps"] == 1
    assert topics["/vehicle/attitude"]["longest_interval_s"] == pytest.approx(0.52)
    assert report["cameras"][0]["width_px"] == 64
    assert report["duration_s"] == pytest.approx(7.985 - 4.965)
    assert report["damage"] == []
    assert main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    assert "/vehicle/attitude: gaps: 1, the longest 0.520 s at 1.020 s" in text
    assert "camera front: 64x48" in text


def test_info_shows_the_noise_and_the_bias_of_a_camera(tmp_path, capsys):
    path = tmp_path / "flight.mcap"
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (replace(INFO, bias_per_m=0.004),), t_ns=START_NS)
    assert main(["info", str(path)]) == 0
    assert f"depth noise {INFO.ke_per_m:g}/m, bias 0.004/m" in capsys.readouterr().out
    assert main(["info", "--json", str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["cameras"][0]["bias_per_m"] == 0.004


def test_info_counts_decisions_and_blind_frames(tmp_path, capsys):
    pipeline = Pipeline((INFO,), EasyExtractor)
    path = tmp_path / "blind.mcap"
    events = [frame(0, START_NS), attitude(START_NS + 50 * MS), frame(1, START_NS + 50 * MS)]
    with LogWriter(path) as log:
        log.begin(run_info("replay"), (INFO,), t_ns=START_NS)
        for event in events:
            log.event(event)
            for output in pipeline.handle(event):
                log.output(output)
    facts = read_log_info(path)
    assert dict(facts.decisions) == {"no_attitude": 1, "used": 1}
    assert (facts.valid, dict(facts.invalid)) == (1, {"no_attitude": 1})
    assert main(["info", str(path)]) == 0
    assert "prisms: 1 valid frames; 1 blind: no_attitude (no attitude had arrived)" in capsys.readouterr().out


def test_info_reports_damage_and_foreign_files(whole, tmp_path, shared_data, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-1000])
    assert main(["info", str(cut)]) == 1
    assert "`companion recover" in capsys.readouterr().err
    assert main(["info", str(shared_data / "mcap" / "keelson_ais_protobuf.mcap")]) == 0
    text = capsys.readouterr().out
    assert "not a log of this software" in text
    assert len(text.splitlines()) < 60
    assert main(["info", str(tmp_path / "none.mcap")]) == 1


@pytest.mark.parametrize("length", [8, 60])
def test_recover_is_not_advised_where_nothing_is_readable(whole, tmp_path, length, capsys):
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:length])
    for command in ("info", "recover"):
        assert main([command, str(path)]) == 1
        captured = capsys.readouterr()
        assert "`companion recover" not in captured.err
        assert "se another copy of the file" in captured.err
        assert "not a log of this software" not in captured.out


def test_a_log_that_is_being_written_is_not_called_damaged(tmp_path, capsys):
    log = LogWriter(tmp_path / "flight.mcap")
    log.begin(run_info("live"), (INFO,), t_ns=START_NS)
    log.sync()
    assert main(["info", str(log.active_path)]) == 1
    assert "a process is writing it; what it had written was read" in capsys.readouterr().err
    assert main(["recover", str(log.active_path)]) == 1
    assert "a process is writing it, and completes it at its end" in capsys.readouterr().err
    assert main(["recover", str(log.active_path), "-o", str(tmp_path / "copy.mcap")]) == 1
    assert sorted(tmp_path.iterdir()) == [log.active_path]
    info = read_log_info(log.active_path)
    log.finish()  # the file has another name now
    print_info(info)
    assert "/run" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["-x.mcap", "my 'b;c\n\u98de\u884c.mcap"])
def test_the_named_command_is_one_that_a_shell_runs(whole, tmp_path, name, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(name).write_bytes(whole.read_bytes()[:-1000])
    for arguments in (["info", "--", name], ["replay", "--", name]):
        assert main(arguments) == 1
        command = re.search("`companion (recover .*?)` recovers", capsys.readouterr().err, re.DOTALL)
        assert command is not None
        assert main([*shlex.split(command[1]), "-o", "out.mcap"]) == 0
        Path("out.mcap").unlink()


def test_a_name_with_a_minus_is_answered_with_the_remedy(whole, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("-x.mcap").write_bytes(whole.read_bytes())
    assert main(["info", "-x.mcap"]) == 2
    assert "give the file as ./-x.mcap" in capsys.readouterr().err
    assert main(["info", "./-x.mcap"]) == 0


def test_info_keeps_the_types_of_a_topic_apart(tmp_path, capsys):
    """Messages of the second type were decoded as the first, and the file was called damaged."""
    path = tmp_path / "two.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="merged")
        ours = writer.register_schema("osape.v1.FrameDecision", "protobuf", b"")
        other = writer.register_schema("my.Decision", "jsonschema", b"{}")
        topic = TOPICS["decision"].of("front")
        channels = [
            writer.register_channel(topic, encoding, k) for encoding, k in (("protobuf", ours), ("json", other))
        ]
        for i in range(5):
            writer.add_message(channels[0], i, TOPICS["decision"].message(used=True).SerializeToString(), i)
            writer.add_message(channels[1], i, b'{"used": 1}', i)
        writer.finish()
    assert main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    assert "decisions: 5 used" in out
    assert len(re.findall(rf"{topic} +5 .*(?:osape.v1.FrameDecision|my.Decision)", out)) == 2


def test_info_counts_messages_that_cannot_be_decoded(tmp_path, capsys):
    """Each gave a line, which advised to recover a file that `companion recover` calls complete."""
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="odd")
        schema = writer.register_schema("osape.v1.FrameDecision", "protobuf", b"")
        channel = writer.register_channel(TOPICS["decision"].of("front"), "protobuf", schema)
        for i in range(50):
            writer.add_message(channel, i, b"\xff", i)
        writer.finish()
    assert main(["info", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "/camera/front/decision: 50 messages cannot be decoded, the first: " in line
    assert "recover" not in line
    assert main(["info", "--json", str(path)]) == 1
    (damage,) = json.loads(capsys.readouterr().out)["damage"]
    assert "50 messages cannot be decoded" in damage


def test_locks_work_as_nfs_has_them(tmp_path, monkeypatch):
    """NFS makes of a lock one of fcntl: an exclusive one needs a descriptor for writing, a shared one for reading. Otherwise it
    answers EBADF, which counts as a file system without locks: a log would not be known as being written."""
    flock, refused = fcntl.flock, []

    def of_nfs(stream, operation: int) -> None:
        mode = fcntl.fcntl(stream, fcntl.F_GETFL) & os.O_ACCMODE
        if mode == (os.O_RDONLY if operation & fcntl.LOCK_EX else os.O_WRONLY):
            refused.append(operation)
            raise OSError(errno.EBADF, "Bad file descriptor")
        flock(stream, operation)

    monkeypatch.setattr(fcntl, "flock", of_nfs)
    with LogWriter(tmp_path / "20260101-000000.000.mcap") as log:
        log.begin(run_info("live"), (INFO,))
        log.sync()
        assert is_being_written(log.active_path)
        assert "another process writes" in repair_file(log.active_path)
        with pytest.raises(FileInUseError):
            open_locked(log.active_path, replace=True)
    assert not is_being_written(log.path)
    unfinished = log.path.rename(log.active_path)
    assert "messages recovered" in repair_file(unfinished)
    assert not refused


@pytest.mark.parametrize("command", ["info", "recover"])
def test_of_many_faults_the_first_are_printed(command, tmp_path, capsys):
    path = tmp_path / "many.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(profile="", library="many")
        channel = writer.register_channel("/a", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    content = path.read_bytes()
    bad = struct.pack("<BQ", 5, 3) + b"\0\0\0"  # a message that ends within its head
    end = content.index(struct.pack("<BQ", 15, 4))  # the end of the data
    path.write_bytes(content[:end] + 30 * bad)
    assert main([command, str(path)]) == (1 if command == "info" else 0)
    ended = capsys.readouterr()
    lines = [line for line in (ended.err + ended.out).splitlines() if "damage" in line]
    assert len(lines) == 11
    assert "and 21 more damages (--json lists all)" in lines[-1]


def test_info_of_a_log_without_messages(tmp_path, capsys):
    path = tmp_path / "empty.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    assert main(["info", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["duration_s"] is None
    assert main(["info", str(path)]) == 0


# ---- recover ----------------------------------------------------------------------------------------------------


def payloads(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    """Topic, log time, publish time, number and content of each message. A frame's number is only in its record."""
    found = []
    for item in McapScan(path).items():
        if isinstance(item, Logged):
            m = item.message
            found.append((item.channel.topic, m.log_time, m.publish_time, m.sequence, m.data))
    return found


@pytest.mark.parametrize("share", [0.2, 0.4, 0.6, 0.9, 0.999])
def test_a_cut_log_becomes_whole(whole, tmp_path, share, capsys):
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(len(data) * share)])
    assert main(["recover", str(cut), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    out = tmp_path / "cut.recovered.mcap"
    assert report["output"] == str(out)
    assert not [item for item in McapScan(out).items() if isinstance(item, Damage)]
    expected = payloads(whole)
    found = payloads(out)
    assert report["messages"] == len(found)
    assert found == expected[: len(found)]
    assert len(found) > 0.8 * share * len(expected)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.mcap", "cut.recovered.mcap"]


def test_a_corrupt_chunk_is_left_out_and_the_rest_kept(whole, tmp_path, capsys):
    data = bytearray(whole.read_bytes())
    data[len(data) // 2] ^= 0x10
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    result = recover(bad)
    assert len(result.damages) == 1
    assert not result.damages[0].end
    lost = len(payloads(whole)) - result.messages
    assert 0 < lost < result.messages
    assert payloads(result.output)[-1] == payloads(whole)[-1]
    assert main(["info", str(result.output)]) == 0


def test_a_lost_first_chunk_does_not_lose_the_channels(whole, tmp_path):
    """They are described there, and again at the end of the file."""
    data = bytearray(whole.read_bytes())
    data[3000] ^= 0x10
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    assert recover(bad).messages > 100


def test_a_killed_log_gets_its_own_name(tmp_path):
    log = LogWriter(tmp_path / "flight.mcap")
    log.begin(run_info("live"), (INFO,), t_ns=START_NS)
    for event in flight(300):
        log.event(event)
    active = tmp_path / "f2.mcap.active"
    active.write_bytes(log.active_path.read_bytes())
    log.finish()
    assert recover(active).output == tmp_path / "f2.mcap"
    with pytest.raises(ValueError, match="exists; give -o another name"):
        recover(active)
    with McapRecording(tmp_path / "f2.mcap") as recording:
        assert len(list(recording.events())) > 100


def test_a_whole_log_is_left_alone(whole, tmp_path, capsys):
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(whole.read_bytes())
    assert main(["recover", str(copy)]) == 0
    assert "nothing to recover" in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["copy.mcap"]


def with_damaged_summary(whole: Path, path: Path) -> Path:
    """A copy whose messages are whole, and of whose summary one byte is wrong."""
    data = bytearray(whole.read_bytes())
    (start,) = struct.unpack_from("<Q", data, len(data) - 28)
    data[start + (len(data) - 28 - start) // 2] ^= 0xFF
    path.write_bytes(data)
    return path


def test_a_damaged_summary_is_repaired(whole, tmp_path, capsys):
    """Readers that use the index at the end, such as Foxglove's, refuse such a file."""
    path = with_damaged_summary(whole, tmp_path / "x.mcap")
    assert main(["recover", str(path)]) == 0
    text = capsys.readouterr().out
    assert "the summary at its end is damaged" in text
    with (tmp_path / "x.recovered.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == sum(
            1 for _ in McapScan(whole).items()
        )


@pytest.mark.parametrize("arguments", [["info"], ["replay"], ["export", "-f", "csv", "-o", "OUT"]])
def test_each_command_reports_a_damaged_summary(whole, tmp_path, arguments, capsys):
    """After it has read everything, with status 1."""
    path = with_damaged_summary(whole, tmp_path / "x.mcap")
    command, *options = [str(tmp_path / "out.csv") if a == "OUT" else a for a in arguments]
    assert main([command, str(path), *options]) == 1
    captured = capsys.readouterr()
    assert "the summary at its end is damaged" in captured.out + captured.err


@pytest.mark.parametrize("crc", [True, False])
def test_a_file_without_a_summary_is_complete(tmp_path, crc, capsys):
    """The format permits it."""
    path = tmp_path / "x.mcap"
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            index_types=IndexType.NONE,
            use_statistics=False,
            use_summary_offsets=False,
            repeat_channels=False,
            repeat_schemas=False,
            enable_crcs=crc,
        )
        writer.start()
        channel = writer.register_channel("a", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    assert main(["recover", str(path)]) == 0
    assert "is complete (1 message)" in capsys.readouterr().out


def test_attachments_and_metadata_are_kept(tmp_path):
    path = tmp_path / "extra.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.add_metadata("about", {"who": "me"})
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"hello")
        writer.flush()
    result = recover(path)
    assert (result.messages, result.others) == (1, 2)
    with result.output.open("rb") as stream:
        reader = make_reader(stream)
        assert [a.data for a in reader.iter_attachments()] == [b"hello"]
        assert [m.metadata for m in reader.iter_metadata()] == [{"who": "me"}]


@pytest.mark.parametrize("content", [b"", b"no log", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(500)])
def test_where_nothing_is_readable_nothing_is_written(tmp_path, content, capsys):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    with pytest.raises(DriverError):
        recover(path)
    assert main(["recover", str(path)]) == 1
    assert capsys.readouterr().err.startswith("companion: error: ")
    assert [p.name for p in tmp_path.iterdir()] == ["bad.mcap"]


@pytest.mark.parametrize("command", ["info", "replay", "recover", "export -f csv -o out", "view -o out"])
def test_a_directory_is_no_log(command, tmp_path, capsys):
    """`cannot be opened (Is a directory); check the path and its permissions`."""
    name, *options = command.split()
    assert main([name, str(tmp_path), *options]) == 1
    assert f"{tmp_path}: a directory; give one of its logs" in capsys.readouterr().err


def test_an_unreadable_file_is_not_overwritten(whole):
    with pytest.raises(ValueError, match="the same file"):
        recover(whole, whole)


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("flight.mcap", " exists; give -o another name, or --replace"),
        ("notes.txt", ": exists and is not a log"),
        ("folder", ": is a directory"),
        ("link", " exists; give -o another name"),
    ],
)
def test_what_exists_is_not_overwritten(whole, tmp_path, name, cause, capsys):
    """It replaced every file that -o named."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-100])
    (tmp_path / "flight.mcap").write_bytes(whole.read_bytes())
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("nowhere")
    before = sorted(tmp_path.iterdir())
    assert main(["recover", str(cut), "-o", str(tmp_path / name)]) == 1
    assert f"{tmp_path / name}{cause}" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "flight.mcap").read_bytes() == whole.read_bytes()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_copy_that_another_process_makes_is_left_to_it(whole, tmp_path):
    """The repair of the service and `companion recover` wrote into one file, and the first of both renamed it."""
    cut = tmp_path / "cut.mcap.active"
    cut.write_bytes(whole.read_bytes()[:-100])
    with open_locked(tmp_path / "cut.mcap.active.recovering", replace=True) as other:
        other.write(b"begun")
        other.flush()
        with pytest.raises(FileInUseError, match="another process writes it"):
            recover(cut)
        assert (tmp_path / "cut.mcap.active.recovering").read_bytes() == b"begun"
    assert recover(cut).messages > 100


@pytest.mark.parametrize("command", ["info", "recover", "replay", "import"])
def test_a_link_to_itself_is_a_file_that_cannot_be_opened(tmp_path, command, capsys):
    loop = tmp_path / "loop.mcap"
    loop.symlink_to(loop)
    arguments = [command, str(loop), *(["-o", str(tmp_path / "out.mcap")] if command == "import" else [])]
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert error.startswith("companion: error: ")
    assert str(loop) in error


# ---- the front --------------------------------------------------------------------------------------------------


def test_help_names_all_commands(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(
        name in text for name in ("demo", "import", "replay", "view", "info", "recover", "check-config", "warmup")
    )


@pytest.mark.parametrize("arguments", [[], ["fly"], ["replay"], ["info"], ["replay", "a", "--tolerance", "7"]])
def test_wrong_use_is_status_2(arguments, capsys):
    assert main(arguments) == 2
    assert "error" in capsys.readouterr().err


def test_the_version_is_reported(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("osape-companion ")

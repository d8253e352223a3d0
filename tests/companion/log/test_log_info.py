"""`companion info`: the content of logs, and the damage of those that are not whole."""

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
from mcap.writer import Writer

from companion.cli import main
from companion.log.info import print_info
from companion.log.log_content import read_log_info
from companion.log.log_file import FileInUseError, open_locked
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.repair import repair_file
from companion.pipeline.pipeline import Pipeline
from core.types import AttitudeSample
from drivers.logs.topics import TOPICS
from drivers.logs.written import is_being_written

from ..small_recordings import INFO, MS, START_NS, EasyExtractor, attitude, flight, frame, write_flight


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


@pytest.mark.parametrize("words", [["replay", "--", "-x.mcap"], ["info", "my 'b;c\n\u98de\u884c.mcap"]])
def test_the_named_command_is_one_that_a_shell_runs(whole, tmp_path, words, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(words[-1]).write_bytes(whole.read_bytes()[:-1000])
    assert main(words) == 1
    command = re.search("`companion (recover .*?)` recovers", capsys.readouterr().err, re.DOTALL)
    assert command is not None
    assert main([*shlex.split(command[1]), "-o", "out.mcap"]) == 0


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

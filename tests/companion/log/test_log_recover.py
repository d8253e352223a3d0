"""`companion recover`: damaged and unfinished logs become whole."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from companion.cli import main
from companion.log.log_file import FileInUseError, open_locked
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recover import recover
from drivers.base import DriverError
from drivers.logs.reader import McapRecording
from drivers.logs.record_scanner import Damage, Logged, McapScan
from tests.nightly import nightly

from ..small_recordings import INFO, START_NS, flight


def payloads(path: Path) -> list[tuple[str, int, int, int, bytes]]:
    """Topic, log time, publish time, number and content of each message. A frame's number is only in its record."""
    found = []
    for item in McapScan(path).items():
        if isinstance(item, Logged):
            m = item.message
            found.append((item.channel.topic, m.log_time, m.publish_time, m.sequence, m.data))
    return found


@pytest.mark.parametrize("share", [0.2, 0.6, 0.999, *nightly(0.4, 0.9)])
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


@pytest.mark.parametrize("arguments", [["info"], ["export", "-f", "csv", "-o", "OUT"], *nightly(["replay"])])
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

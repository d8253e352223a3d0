"""Logs in which the head of a record is damaged, which leads to the next record: what follows is read nevertheless."""

from __future__ import annotations

import io
import itertools
import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.opcode import Opcode

from companion.log.log_directory import files_of, make_room
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recover import recover
from companion.log.repair import leftovers, repair_file
from drivers.logs import chunk_search
from drivers.logs.chunk_search import FRAME
from drivers.logs.record_scanner import MAGIC, Damage, Logged, McapScan

from ..companion.small_recordings import INFO, START_NS, flight
from .test_mcap_file import BadSector
from .test_mcap_limits import CHANNEL, MESSAGE, chunk, file_of

pytestmark = pytest.mark.unit


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of many chunks that was not finished."""
    log = LogWriter(tmp_path_factory.mktemp("log") / "20260101-000000.000.mcap")
    log.begin(run_info("live"), (INFO,), t_ns=START_NS)
    log.sync()
    for number, event in enumerate(flight(100)):
        log.event(event)
        if number % 50 == 49:
            log.sync()
    log.abandon()
    return log.active_path


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Place and length of the chunk records."""
    found, at = [], 8
    while at < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == Opcode.CHUNK:
            found.append((at, 9 + length))
        at += 9 + length
    return found


def messages(path: Path) -> list[bytes]:
    scan = McapScan(path)
    try:
        return [item.message.data for item in scan.items() if isinstance(item, Logged)]
    finally:
        scan.close()


def flipped(path: Path, source: Path, place: int, bits: int) -> Path:
    data = bytearray(source.read_bytes())
    data[place] ^= bits
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("byte", range(9))
@pytest.mark.parametrize("bits", [0x01, 0x10, 0x80])
def test_a_damaged_head_costs_its_chunk_only(byte: int, bits: int, killed: Path, tmp_path: Path) -> None:
    """One flipped bit in the opcode or the length of a chunk ended the recovery of the whole log."""
    whole = messages(killed)
    of_chunks = chunks(killed.read_bytes())
    place = of_chunks[3][0]
    bad = flipped(tmp_path / "bad.mcap", killed, place + byte, bits)
    found = messages(bad)
    assert len(whole) - 50 <= len(found) < len(whole) or found == whole, "the length alone is not needed"
    assert found[:104] == whole[:104]
    assert found[-50:] == whole[-50:]
    assert set(found) <= set(whole)


@pytest.mark.parametrize(("chunk_number", "kept"), [(1, 854), (5, 854), (-2, 854)])
def test_a_repair_keeps_what_follows_a_damaged_head(chunk_number: int, kept: int, killed: Path, tmp_path: Path) -> None:
    """The copy ended at the damaged head, and the original with all later messages was deleted."""
    place = chunks(killed.read_bytes())[chunk_number][0]
    bad = flipped(tmp_path / killed.name, killed, place + 5, 0x20)
    content = bad.read_bytes()
    result = repair_file(bad)
    copy, original = sorted(tmp_path.iterdir())
    assert len(messages(copy)) == kept
    assert original.name == f"{copy.name}.damaged"
    assert original.read_bytes() == content
    assert f"{original.name} is the original, kept because it is damaged at byte {place}" in result
    assert {f.path for f in files_of(tmp_path)} == {copy, original}
    assert leftovers(tmp_path, "") == []
    assert make_room(tmp_path, 0, "") != []
    assert list(tmp_path.iterdir()) == [], "the budget deletes both"


@pytest.mark.parametrize("bit", range(8))
def test_a_chunk_with_a_damaged_opcode_is_read(bit: int, killed: Path, tmp_path: Path) -> None:
    """As a record that is not read, or a private one, it was passed over without a report, and the repair deleted the original."""
    place = chunks(killed.read_bytes())[3][0]
    bad = flipped(tmp_path / killed.name, killed, place, 1 << bit)
    assert f"it is damaged at byte {place} (a chunk begins with 0x{Opcode.CHUNK ^ 1 << bit:02x})" in repair_file(bad)
    copy, _ = sorted(tmp_path.iterdir())
    assert messages(copy) == messages(killed)


@pytest.mark.parametrize("tail", [bytes(1 << 20), bytes(5), b""], ids=["zeros", "less than a head", "nothing"])
def test_a_length_that_leads_to_the_end_of_the_file_does_not_lose_what_follows(
    tail: bytes, killed: Path, tmp_path: Path
) -> None:
    """The end, or zeros that a power failure left there, was taken for the end of the records, and the original was deleted."""
    data = bytearray(killed.read_bytes())
    place = chunks(data)[3][0]
    struct.pack_into("<Q", data, place + 1, len(data) - place - 9)
    bad = tmp_path / killed.name
    bad.write_bytes(data + tail)
    assert "is the original, kept because it is damaged" in repair_file(bad)
    copy, _ = sorted(tmp_path.iterdir())
    assert messages(copy) == messages(killed)


def test_a_chunk_that_the_search_can_read_and_the_pass_cannot_is_tried_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A damaged disk may read a place now and then."""
    path = file_of(tmp_path / "a.mcap", [chunk(CHANNEL + MESSAGE, "zstd"), bytes([0x7F])])

    def read_at(scan: McapScan, at: int, length: int) -> bytes:
        if length > 9:
            raise OSError(5, "Input/output error")
        return path.read_bytes()[at : at + length]

    monkeypatch.setattr(McapScan, "_read_at", read_at)
    scan = McapScan(path)
    found = list(itertools.islice(scan.items(), 10))
    scan.close()
    assert len(found) == 4
    assert all(isinstance(item, Damage) for item in found)


def test_a_length_that_leads_over_whole_chunks_does_not_lose_them(killed: Path, tmp_path: Path) -> None:
    data = bytearray(killed.read_bytes())
    (begin, length), (later, _) = chunks(data)[3], chunks(data)[7]
    struct.pack_into("<Q", data, begin + 1, later + 20 - begin - 9)
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    result = recover(bad)
    assert result.output is not None
    assert sorted(messages(result.output)) == sorted(messages(killed))
    assert [d.end for d in result.damages] == [False, True]
    assert length < later - begin


def test_a_record_may_be_longer_than_its_known_fields(tmp_path: Path) -> None:
    """A newer format may add fields at the end of a record."""
    one = chunk(CHANNEL + MESSAGE, "zstd")
    longer = struct.pack("<BQ", Opcode.CHUNK, len(one) - 9 + 4) + one[9:] + b"more"
    path = file_of(tmp_path / "a.mcap", [longer, longer])
    assert len(messages(path)) == 2


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_the_next_chunk_is_found_at_any_place(
    compression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also across the border of two parts of the search; what is no whole chunk is passed over."""
    monkeypatch.setattr(chunk_search, "FIRST_PART", 64)
    monkeypatch.setattr(chunk_search, "MOST_PART", 64)
    good = chunk(CHANNEL + MESSAGE, compression)
    wrong = bytearray(good)
    wrong[36 - 3] ^= 1  # its checksum
    for gap in range(70):
        path = file_of(tmp_path / f"{gap}.mcap", [bytes([0x7F]), bytes(wrong), bytes(gap), good])
        scan = McapScan(path)
        items = list(scan.items())
        scan.close()
        assert [type(item) for item in items] == [Damage, Logged, Damage], gap


def test_behind_a_bad_sector_in_a_head_the_log_goes_on(
    killed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = chunks(killed.read_bytes())[3][0] + 2
    opened = Path.open

    def open_file(path: Path, mode: str = "r", **options: Any) -> Any:
        if path == killed and mode == "rb":
            return io.BufferedReader(BadSector(killed, begin, begin + 4))
        return opened(path, mode, **options)

    whole = messages(killed)
    monkeypatch.setattr(Path, "open", open_file)
    result = recover(killed, tmp_path / "recovered.mcap")
    assert "the disk cannot be read there" in result.damages[0].cause
    assert result.messages >= len(whole) - 100
    assert messages(tmp_path / "recovered.mcap")[-50:] == whole[-50:]


def test_a_damaged_chunk_costs_its_messages_only(killed: Path, tmp_path: Path) -> None:
    """The first chunk with a message of a topic contained the description of its channel, which no later one repeated: all images of
    an unfinished log were lost with it."""
    whole, data = messages(killed), killed.read_bytes()
    of_chunks = chunks(data)
    kept = []
    for number, (begin, length) in enumerate(of_chunks):
        bad = tmp_path / f"{number}.mcap"
        bad.write_bytes(data[: begin + length - 5] + bytes(5) + data[begin + length :])
        kept.append(len(messages(bad)))
    assert sum(len(whole) - n for n in kept) == len(whole)
    assert max(len(whole) - n for n in kept) < len(whole) / 4


def test_a_lost_beginning_costs_the_messages_up_to_the_next_description(killed: Path, tmp_path: Path) -> None:
    """As where a power failure left the first blocks unwritten: descriptions are repeated after 1, 2, 4, 8 and each 16 chunks."""
    whole, data = messages(killed), killed.read_bytes()
    of_chunks = chunks(data)
    assert len(of_chunks) > 12
    begin = of_chunks[0][0]
    for lost in range(1, 9):
        end = of_chunks[lost - 1][0] + of_chunks[lost - 1][1]
        bad = tmp_path / f"{lost}.mcap"
        bad.write_bytes(data[:begin] + bytes(end - begin) + data[end:])
        found = messages(bad)
        assert found == whole[-len(found) :]
        assert len(whole) - len(found) <= 50 * (2 * lost + 2)


def with_wrong_record(opcode: Opcode, content: bytes) -> bytes:
    return MAGIC + FRAME.pack(opcode, len(content)) + content


@pytest.mark.parametrize(
    ("opcode", "content", "cause"),
    [
        (Opcode.HEADER, struct.pack("<I", 99) + b"x", "it ends within a field"),
        (Opcode.CHANNEL, b"\0", "it ends within a field"),
        (Opcode.HEADER, struct.pack("<I2sI", 2, b"\xff\xfe", 0), "a name in it is not text"),
    ],
)
def test_the_cause_of_an_unreadable_record_is_named(opcode, content, cause, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(with_wrong_record(opcode, content))
    damages = [item for item in McapScan(path).items() if isinstance(item, Damage)]
    assert damages[0] == Damage(len(MAGIC), f"unreadable record: {cause}")

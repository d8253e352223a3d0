"""Small files that unpack to very much: refused with a message, within bounded memory."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode

from drivers.logs import chunk_search
from drivers.logs.chunk import MAX_CHUNK_BYTES
from drivers.logs.record_scanner import Damage, Logged, McapScan

MAGIC = b"\x89MCAP0\r\n"
MIB = 1 << 20
PEAK = """
import re, sys
from pathlib import Path
from companion.cli import main
status = main([sys.argv[1], sys.argv[2]])
print(status, re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""
"""Prints the exit status and the peak of resident memory, kB. Unlike getrusage, VmHWM does not count what the parent had."""


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


CHANNEL = record(Opcode.CHANNEL, struct.pack("<HH", 1, 0) + text("/a") + text("json") + struct.pack("<I", 0))
MESSAGE = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5))


def chunk(data: bytes, compression: str, size: int | None = None, crc: bool = True) -> bytes:
    """A chunk record. size: what it claims to unpack to; None: the truth."""
    packed = zstandard.ZstdCompressor().compress(data) if compression == "zstd" else lz4.frame.compress(data)
    claims = len(data) if size is None else size
    head = struct.pack("<QQQI", 5, 5, claims, zlib.crc32(data) if crc else 0)
    return record(Opcode.CHUNK, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def file_of(path: Path, chunks: Iterable[bytes]) -> Path:
    path.write_bytes(MAGIC + record(Opcode.HEADER, text("") + text("")) + b"".join(chunks))
    return path


def damages(path: Path) -> list[str]:
    scan = McapScan(path)
    try:
        return [item.cause for item in scan.items() if isinstance(item, Damage)]
    finally:
        scan.close()


def zeros_of_a_gibibyte(path: Path) -> Path:
    """66 kB: two chunks that unpack to 1 GiB each, as they say."""
    packer = zstandard.ZstdCompressor().compressobj()
    packed = b"".join(packer.compress(bytes(16 * MIB)) for _ in range(64)) + packer.flush()
    head = struct.pack("<QQQI", 5, 5, 1 << 30, 0)
    one = record(Opcode.CHUNK, head + text("zstd") + struct.pack("<Q", len(packed)) + packed)
    return file_of(path, [one, one])


def many_messages(path: Path) -> Path:
    """66 kB of chunks within the limit of size, each of two million empty messages."""
    one = chunk(CHANNEL + MESSAGE * ((MAX_CHUNK_BYTES - len(CHANNEL)) // len(MESSAGE)), "zstd")
    return file_of(path, [one] * (66_000 // len(one)))


@pytest.mark.parametrize(
    ("command", "build", "cause"),
    [
        ("info", zeros_of_a_gibibyte, "1073741824 bytes"),
        ("recover", many_messages, "more records than"),
        pytest.param("recover", zeros_of_a_gibibyte, "1073741824 bytes", marks=pytest.mark.slow),
        pytest.param("info", many_messages, "more records than", marks=pytest.mark.slow),
    ],
)
def test_a_small_file_that_unpacks_to_gigabytes_needs_little_memory(command, build, cause, tmp_path) -> None:
    path = build(tmp_path / "bomb.mcap")
    assert path.stat().st_size < 100_000
    done = subprocess.run(
        [sys.executable, "-c", PEAK, command, str(path)], capture_output=True, text=True, check=False, timeout=300
    )
    printed = done.stdout + done.stderr
    assert cause in printed
    status, peak_kb = done.stdout.splitlines()[-1].split()
    assert int(status) == (1 if command == "info" or build is zeros_of_a_gibibyte else 0)
    assert int(peak_kb) < 600_000
    assert "Traceback" not in printed


def test_a_chunk_at_the_limit_is_read(tmp_path) -> None:
    payload = bytes(MAX_CHUNK_BYTES - len(CHANNEL) - len(MESSAGE))
    message = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5) + payload)
    scan = McapScan(file_of(tmp_path / "a.mcap", [chunk(CHANNEL + message, "zstd")]))
    found = [item for item in scan.items() if isinstance(item, Logged)]
    scan.close()
    assert [len(item.message.data) for item in found] == [len(payload)]


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("crc", [True, False])
def test_a_chunk_that_unpacks_to_more_than_it_claims_is_left_out(compression, crc, tmp_path) -> None:
    data = CHANNEL + MESSAGE * 100
    bad = chunk(data + bytes(20 * MIB), compression, size=len(data), crc=crc)
    causes = damages(file_of(tmp_path / "a.mcap", [bad, chunk(CHANNEL + MESSAGE, compression)]))
    assert "chunk skipped" in causes[0]
    assert "decompresses to more" in causes[0]


@pytest.mark.parametrize("length", [1 << 63, (1 << 64) - 1])
def test_a_chunk_whose_length_is_damaged_is_left_out(length: int, tmp_path: Path) -> None:
    """A length of more than 63 bits raised OverflowError, and neither `info` nor `recover` read the rest of the file."""
    good = chunk(CHANNEL + MESSAGE, "zstd")
    place = good.index(struct.pack("<I", 4) + b"zstd") + 8
    bad = good[:place] + struct.pack("<Q", length) + good[place + 8 :]
    path = file_of(tmp_path / "a.mcap", [good, bad, good])
    scan = McapScan(path)
    items = list(scan.items())
    scan.close()
    assert [type(item) for item in items] == [Logged, Damage, Logged, Damage]


def test_lz4_is_read_and_a_cut_or_wrong_one_is_left_out(tmp_path) -> None:
    good = chunk(CHANNEL + MESSAGE * 3, "lz4")
    scan = McapScan(file_of(tmp_path / "a.mcap", [good]))
    assert sum(isinstance(item, Logged) for item in scan.items()) == 3
    scan.close()
    broken = bytearray(good)
    broken[-9] ^= 0xFF
    assert any("chunk skipped" in cause for cause in damages(file_of(tmp_path / "b.mcap", [bytes(broken)])))


def test_a_frame_with_a_window_of_two_gibibytes_is_left_out(tmp_path) -> None:
    parameters = zstandard.ZstdCompressionParameters(window_log=31)
    packer = zstandard.ZstdCompressor(compression_params=parameters).compressobj()  # without the size of its content
    packed = packer.compress(CHANNEL + MESSAGE) + packer.flush()
    head = struct.pack("<QQQI", 5, 5, len(CHANNEL + MESSAGE), 0)
    one = record(Opcode.CHUNK, head + text("zstd") + struct.pack("<Q", len(packed)) + packed)
    assert any("chunk skipped" in cause for cause in damages(file_of(tmp_path / "a.mcap", [one])))


def test_a_record_of_a_gigabyte_in_a_file_with_a_hole_is_left_out(tmp_path) -> None:
    path = tmp_path / "hole.mcap"
    begin = MAGIC + record(Opcode.HEADER, text("") + text(""))
    with path.open("wb") as stream:
        stream.write(begin + struct.pack("<BQ", Opcode.ATTACHMENT, 1 << 32))
        stream.seek(1 << 32, 1)
        stream.write(chunk(CHANNEL + MESSAGE, "zstd"))
    scan = McapScan(path)
    items = list(scan.items())
    scan.close()
    assert any(isinstance(item, Damage) and "4294967296 bytes" in item.cause for item in items)
    assert sum(isinstance(item, Logged) for item in items) == 1


def false_heads(count: int, bytes_each: int = 60) -> list[bytes]:
    """Beginnings of chunks, each of which states that it goes on to the end of the file."""
    found = []
    for left in range(count * bytes_each - 9, 0, -bytes_each):
        head = struct.pack("<BQQQQI", Opcode.CHUNK, left, 5, 5, 100, 1) + text("zstd") + struct.pack("<Q", left - 48)
        found.append(head.ljust(bytes_each, b"\0"))
    return found


def bombs(count: int) -> list[bytes]:
    """Chunks of 2 kB that unpack to 64 MiB, with a wrong checksum."""
    packed = zstandard.ZstdCompressor().compress(bytes(MAX_CHUNK_BYTES))
    head = struct.pack("<QQQI", 5, 5, MAX_CHUNK_BYTES, 7) + text("zstd") + struct.pack("<Q", len(packed))
    return [record(Opcode.CHUNK, head + packed)] * count


@pytest.mark.parametrize("build", [lambda: false_heads(3000), lambda: bombs(60)], ids=["overlapping", "bombs"])
def test_the_search_for_chunks_reads_and_unpacks_a_bounded_number_of_bytes(
    build: Callable[[], list[bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It examined every place as far as it states: the time grew with the square of the file."""
    examined = [0]
    unpack = chunk_search.unpacked

    def counted(payload: bytes, whole: bool) -> bytes:
        examined[0] += len(payload) + struct.unpack_from("<Q", payload, 16)[0]
        return unpack(payload, whole)

    monkeypatch.setattr(chunk_search, "unpacked", counted)
    monkeypatch.setattr(chunk_search, "_FREE_BYTES", 4 * MAX_CHUNK_BYTES)
    path = file_of(tmp_path / "a.mcap", [chunk(CHANNEL + MESSAGE, "zstd"), bytes([0x7F]), *build()])
    scan = McapScan(path)
    items = list(scan.items())
    scan.close()
    assert examined[0] < 6 * MAX_CHUNK_BYTES + 8 * scan.size
    assert [type(item) for item in items] == [Logged, Damage]
    assert isinstance(items[1], Damage)
    assert not items[1].end, "the rest may hold messages: a repair keeps the original"
    assert items[1].cause.endswith("the rest is not read")


@pytest.mark.parametrize("between", [0x00, 0x7F])
def test_many_damaged_places_take_a_bounded_number_of_bytes_each(
    between: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After each, up to 1 MiB was read, to find the next chunk or the end of zeros: 0.8 MB took 50 s."""
    one = bytes([between]) + chunk(CHANNEL + MESSAGE, "zstd")
    path = file_of(tmp_path / "a.mcap", [one] * 1000)
    scan, read = McapScan(path), [0]
    stream = scan._stream

    class Counted:
        """The file; counts what is read."""

        def seek(self, *place: int) -> int:
            return stream.seek(*place)

        def read(self, most: int) -> bytes:
            data = stream.read(most)
            read[0] += len(data)
            return data

    monkeypatch.setattr(scan, "_stream", Counted())
    monkeypatch.setattr(scan, "_search", chunk_search.ChunkSearch(Counted(), scan.size))
    assert sum(isinstance(item, Logged) for item in scan.items()) == 1000
    assert read[0] < 1000 * (2 * chunk_search.FIRST_PART + 10 * len(one))
    stream.close()

"""Files written past the page cache: the same bytes as any file, and what was flushed outlives the process."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from companion.direct_file import BLOCK, DirectFile

pytestmark = pytest.mark.nojit
SIZES = (0, 1, 9, 700, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK, 70_001)


def pieces(seed: int, count: int = 60) -> list[bytes]:
    """None of their bytes is zero, so that what was filled up can be told from what was given."""
    rng = np.random.default_rng(seed)
    return [rng.integers(1, 256, int(rng.choice(SIZES)), dtype=np.uint8).tobytes() for _ in range(count)]


def test_a_file_has_the_bytes_that_were_given(tmp_path: Path) -> None:
    for seed, buffer_bytes in ((1, BLOCK), (2, 4 * BLOCK), (3, 1 << 20)):
        path = tmp_path / f"{seed}"
        given = b""
        rng = np.random.default_rng(seed)
        with DirectFile(path, buffer_bytes) as file:
            for piece in pieces(seed):
                assert file.write(memoryview(piece)) == len(piece)
                given += piece
                assert file.tell() == len(given)
                if rng.random() < 0.5:
                    file.flush()
                    written = path.read_bytes()
                    assert written[: len(given)] == given
                    rest = written[len(given) :]
                    assert len(rest) < BLOCK
                    assert not any(rest)
        assert path.read_bytes() == given
        assert file.closed
        file.close()
        with pytest.raises(ValueError, match="closed"):
            file.write(b"more")


def test_truncate_takes_off_the_zeros_and_writing_goes_on(tmp_path: Path) -> None:
    with DirectFile(tmp_path / "a") as file:
        file.write(b"x" * 5000)
        assert file.truncate() == 5000
        assert (tmp_path / "a").read_bytes() == b"x" * 5000
        file.write(b"y" * 5000)
    assert (tmp_path / "a").read_bytes() == b"x" * 5000 + b"y" * 5000


def test_a_file_that_is_there_is_emptied(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 100_000)
    with DirectFile(tmp_path / "a") as file:
        file.write(b"new")
    assert (tmp_path / "a").read_bytes() == b"new"


KILLED = textwrap.dedent("""
    import sys
    from pathlib import Path
    from companion.direct_file import DirectFile
    file = DirectFile(Path(sys.argv[1]))
    file.write(b"x" * 300_001)
    file.flush()
    file.write(b"y")
    print("flushed", flush=True)
    sys.stdin.read()
""")


def test_what_was_flushed_is_there_after_a_kill(tmp_path: Path) -> None:
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path / "a")], env=env, stdin=pipe, stdout=pipe
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"flushed\n"
        writer.send_signal(signal.SIGKILL)
    written = (tmp_path / "a").read_bytes()
    assert written.rstrip(b"\0") == b"x" * 300_001
    assert len(written) - 300_001 < BLOCK


def test_where_direct_writes_are_refused_the_page_cache_takes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As tmpfs does before Linux 6.6: at the opening."""
    real = os.open

    def refuses(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_DIRECT:
            raise OSError(errno.EINVAL, "Invalid argument")
        return real(path, flags, mode)

    monkeypatch.setattr(os, "open", refuses)
    with DirectFile(tmp_path / "a") as file:
        assert not file.direct
        for piece in pieces(4):
            file.write(piece)
            file.flush()
    assert (tmp_path / "a").read_bytes() == b"".join(pieces(4))


def test_a_write_that_is_cut_short_within_a_sector_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What remains has no place that a direct write can begin at: the file system refuses it, if it refuses any."""
    real = os.pwrite
    left = [1]

    def cuts_short(descriptor: int, data: memoryview, offset: int) -> int:
        if not left or len(data) < 8 * BLOCK:
            return real(descriptor, data, offset)
        left.pop()
        with (tmp_path / "a").open("r+b") as other:
            other.seek(offset)
            return other.write(data[:1000])

    monkeypatch.setattr(os, "pwrite", cuts_short)
    given = b"".join(pieces(5))
    with DirectFile(tmp_path / "a", 64 * BLOCK) as file:
        file.write(given)
        file.flush()
        assert not left
    assert (tmp_path / "a").read_bytes() == given


FILLING = """
    import os, resource, signal, sys
    from pathlib import Path
    from companion.direct_file import DirectFile

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # an error then, as a full disk is
    file = DirectFile(Path(sys.argv[1]))
    file.write(b"x" * 50_000)
    file.flush()
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
    file.write(b"y" * 100_000)
    for step in (file.flush, file.close):
        try:
            step()
        except OSError as error:
            print(error.strerror)
    print(file.closed)
    try:
        os.fstat(file.fileno())
    except OSError as error:
        print(error.strerror)
"""


def test_a_write_that_fails_is_told_and_the_file_can_be_closed(tmp_path: Path) -> None:
    """In a process of its own: the limit and its signal are a process' as a whole."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(FILLING), str(tmp_path / "a")],
        capture_output=True, text=True, check=True, timeout=60.0,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["File too large", "File too large", "True", "Bad file descriptor"]
    assert (tmp_path / "a").read_bytes().startswith(b"x" * 50_000)


def test_a_file_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        DirectFile(tmp_path / "none" / "a")

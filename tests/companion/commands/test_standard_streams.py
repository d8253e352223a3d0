"""Commands whose standard streams are closed, full, or of another encoding."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process
ROOT = Path(__file__).resolve().parents[3]
LOG = ROOT / "tests" / "data" / "window.mcap"


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Runs a line in which $COMPANION is the command and $LOG a log."""
    values = {"COMPANION": f"{sys.executable} -m companion", "LOG": str(LOG), "PATH": "/usr/bin:/bin"} | environment
    return subprocess.run(["sh", "-c", line], cwd=ROOT, env=values, capture_output=True, timeout=120.0, check=False)


@pytest.mark.parametrize("words", ["info $LOG --json", "--version"])
def test_a_command_without_stdout_ends_as_with_one(words: str) -> None:
    """It ended with a traceback: Python has no object for a stream that is closed at its start."""
    ended = shell(f"$COMPANION {words} >&-")
    assert (ended.returncode, ended.stderr) == (0, b"")


def test_no_file_takes_the_descriptor_of_a_closed_stream() -> None:
    """The output of a library would be written into it."""
    code = "import companion.standard_streams as s; s.prepare(); import os; print(os.open('/dev/null', 0))"
    ended = shell(f'{sys.executable} -c "{code}" <&- 2>&-')
    assert int(ended.stdout) > 2


def test_a_reader_that_has_ended_causes_no_message() -> None:
    ended = shell("{ sleep 0.2; $COMPANION info $LOG; } | true")
    assert ended.stderr == b""


def test_without_any_stream_the_status_remains() -> None:
    assert shell("$COMPANION info none.mcap <&- >&- 2>&-").returncode == 1


@pytest.mark.parametrize(
    ("words", "unbuffered"),
    [
        ("--version", ""),
        ("info $LOG", ""),
        ("info $LOG", "1"),
        ("run --help", "1"),
    ],
)
def test_a_full_disk_under_stdout_is_reported(words: str, unbuffered: str) -> None:
    """Python reported it after the command, with a message of its own and status 120."""
    ended = shell(f"$COMPANION {words} > /dev/full", PYTHONUNBUFFERED=unbuffered)
    assert ended.returncode == 1
    assert ended.stderr == b"companion: error: No space left on device while writing; check the free space\n"


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_each_name_can_be_printed(encoding: str, tmp_path: Path) -> None:
    """Names of files can hold bytes that are no text."""
    name = bytes(tmp_path) + b"/fl\xc3\xbcg\xff.mcap"
    (tmp_path / "x").write_bytes(LOG.read_bytes())
    subprocess.run([b"mv", bytes(tmp_path / "x"), name], check=True)
    ended = shell(f"$COMPANION info {tmp_path}/fl*.mcap", PYTHONIOENCODING=f"{encoding}:strict")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith(bytes(tmp_path) + b"/fl")

"""Pipes in place of files: each of these commands waited for ever."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main

from ..importers.test_import_formats import write_tum
from ..recordings import write_folder

PIPE = "a pipe, socket or device; save its content as a file"


def pipe(path: Path) -> Path:
    """A pipe whose writers write nothing and end, so that a command that reads it does not wait."""
    path.unlink(missing_ok=True)
    os.mkfifo(path)

    def end_at_once() -> None:
        while True:
            os.close(os.open(path, os.O_WRONLY))

    threading.Thread(target=end_at_once, daemon=True).start()
    return path


@pytest.mark.parametrize("command", ["info", "recover", "replay", "view", "check-config"])
def test_a_pipe_is_no_log_and_no_configuration(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = pipe(tmp_path / "pipe.mcap")
    output = ["-o", str(tmp_path / "out")] if command == "view" else []
    assert main([command, str(path), *output]) == 1
    assert f"({PIPE})" in capsys.readouterr().err


@pytest.mark.parametrize(
    "name", ["in.mcap", "frames.csv", "intrinsics.json", "depth/000003.png", "a.tlog", "a.ulg", "a.bin"]
)
def test_a_pipe_is_no_part_of_a_recording(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_folder(tmp_path / "rec")
    path = pipe(folder / name)
    source = path if name == "in.mcap" else folder
    assert main(["import", str(source), "-o", str(tmp_path / "out.mcap")]) == 1
    err = capsys.readouterr().err
    assert f"{path}: cannot be " in err
    assert f"({PIPE})" in err


def test_a_pipe_is_no_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_tum(tmp_path / "rec")
    path = pipe(folder / "groundtruth.txt")
    assert main(["import", str(folder), "-o", str(tmp_path / "out.mcap")]) == 1
    assert f"{path}: cannot be read ({PIPE})" in capsys.readouterr().err


def test_a_pipe_is_no_log_of_a_fleet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`no log (*.mcap) found`."""
    pytest.importorskip("pyarrow")
    path = pipe(tmp_path / "pipe.mcap")
    assert main(["batch", str(path), "-o", str(tmp_path / "out")]) == 1
    assert f"{path}: {PIPE}" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["info", "recover", "replay"])
def test_a_log_that_may_not_be_read_is_named_with_the_remedy(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`recover` named the free space."""
    (path := tmp_path / "a.mcap").touch()
    opened = Path.open

    def refused(self: Path, *args: Any, **kwargs: Any) -> Any:
        if self == path:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return opened(self, *args, **kwargs)

    monkeypatch.setattr(Path, "open", refused)
    assert main([command, str(path)]) == 1
    assert (
        f"{path}: cannot be opened (Permission denied); check the path and its permissions" in capsys.readouterr().err
    )


def test_a_directory_is_no_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It said to delete it first."""
    assert main(["keys", "--signing", str(tmp_path)]) == 1
    assert f"{tmp_path} is a directory; give the name of a file" in capsys.readouterr().err

"""What a camera process prints: it never waits for a reader, and the log names the camera."""

from __future__ import annotations

import io
import json
import logging
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from companion.cameras.process_output import MOST_CHARACTERS, MOST_LINES, forward

from ..watched_camera import CAMERA

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[3]
SERVICE = textwrap.dedent("""
    import json, os, sys, time
    from pathlib import Path
    from companion.cameras.supervisor import CameraSupervisor
    from companion.config.camera import CameraConfig
    from companion.live.journal import log_to_stderr

    journal = log_to_stderr()
    frames = []
    camera = CameraSupervisor(CameraConfig(name="front", kind="simulated"), lambda info: None, frames.append,
                              command=(sys.executable, sys.argv[1], "well:0"))
    camera.open()
    end_s = time.monotonic() + 60.0
    while len(frames) < 5 and time.monotonic() < end_s:
        time.sleep(0.01)
    Path(sys.argv[2]).write_text(json.dumps([len(frames), camera.status.starts]))
    camera.close()
    os._exit(0)
""")
"""A service with one camera. Its output is a pipe without a reader."""


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_camera_that_prints_much_is_not_held_up_by_a_reader_that_has_stopped(tmp_path: Path, stream: str) -> None:
    """Its process waited for the reader of the service's output: the camera was silent, and restarted for ever."""
    noise = (
        f'import sys; [print("a library that prints much", k, file=sys.{stream}, flush=True) for k in range(20_000)]\n'
    )
    script, result = tmp_path / "camera.py", tmp_path / "result.json"
    script.write_text(noise + CAMERA)
    service = subprocess.Popen(
        [sys.executable, "-c", SERVICE, script, result],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"},
    )
    with service:
        assert service.wait(120.0) == 0
        frames, starts = json.loads(result.read_text())
        assert frames >= 5
        assert starts == 1


def test_the_log_names_the_camera(caplog: pytest.LogCaptureFixture) -> None:
    forward("front", io.BytesIO(b"first\n\nTraceback \xff\nlast without end"))
    assert caplog.messages == [
        "camera front: its process printed: first",
        "camera front: its process printed: Traceback \\xff",
        "camera front: its process printed: last without end",
    ]
    assert {record.levelno for record in caplog.records} == {logging.WARNING}


def test_lines_beyond_a_number_are_counted_and_long_ones_cut(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.cameras.process_output.WINDOW_S", 1e9)
    forward("front", io.BytesIO(b"x" * 5000 + b"\n" + b"line\n" * 1000))
    assert len(caplog.messages) == MOST_LINES + 1
    assert caplog.messages[0] == f"camera front: its process printed: {'x' * MOST_CHARACTERS}"
    printed = -(-5000 // MOST_CHARACTERS) + 1000
    assert caplog.messages[-1] == f"camera front: {printed - MOST_LINES} more lines of its process were dropped"

"""`companion run` stopped during its start leaves no process behind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.waiting import PATIENCE_S, until

from ..live_service import ROOT
from ..small_core import make_own_state

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
"""


def children(pid: int) -> dict[int, str]:
    """Pid -> command line of the processes that this one started."""
    found = {}
    for entry in Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]) if entry.name.isdigit() else 0
            if parent == pid:
                found[int(entry.name)] = (entry / "cmdline").read_text()
        except (OSError, IndexError):
            continue  # it has just ended
    return found


@contextmanager
def compiling(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], dict[int, str]]]:
    """A service that compiles its kernels and runs a camera, with its children."""
    config = tmp_path / "live.toml"
    config.write_text(CONFIG)
    (tmp_path / "run").mkdir()
    (tmp_path / "cache").mkdir()
    environment = os.environ | {
        "RUNTIME_DIRECTORY": str(tmp_path / "run"),
        "STATE_DIRECTORY": str(tmp_path / "state"),
        "CACHE_DIRECTORY": str(tmp_path / "cache"),
        "NUMBA_CACHE_DIR": str(tmp_path / "kernels"),  # nothing is compiled yet
        "PYTHONPATH": str(ROOT),
    }
    make_own_state(tmp_path / "kernels")
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", "run", "-c", str(config)],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    children_of_it: dict[int, str] = {}

    def compiles_and_films() -> bool:
        children_of_it.update(children(process.pid))
        return {"run_child", "cameras.worker"} <= {
            w for w in ("run_child", "cameras.worker") for c in children_of_it.values() if w in c
        }

    try:
        assert until(compiles_and_films, every_s=0.1)  # all processes are read each time
        yield process, children_of_it
    finally:
        process.kill()
        for pid in running(children_of_it):
            os.kill(pid, signal.SIGKILL)


def running(pids: Iterable[int]) -> list[int]:
    return [pid for pid in pids if Path(f"/proc/{pid}").exists()]


def test_a_signal_while_kernels_are_compiled_ends_the_service_with_its_children(tmp_path: Path) -> None:
    """SIGINT has the same handler: test_service_alone.py."""
    with compiling(tmp_path) as (process, children_of_it):
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, output
        assert output.endswith("stopped\n")
        assert "Traceback" not in output
        assert until(lambda: not running(children_of_it))  # the one that compiles ends after its parent


def test_killed_while_kernels_are_compiled_it_leaves_no_child_that_compiles_on(tmp_path: Path) -> None:
    """Started by hand, no systemd ends what a killed service leaves, and compiling takes a processor for minutes."""
    with compiling(tmp_path) as (process, children_of_it):
        process.kill()
        process.wait()
        assert until(lambda: not running(children_of_it))


def test_systemd_is_asked_for_more_time_before_what_takes_long(tmp_path: Path) -> None:
    """Imports and kernels may take longer than the unit's timeout on a slow computer; here the start fails at the folders."""
    (tmp_path / "live.toml").write_text(CONFIG)
    (tmp_path / "file").write_text("")
    environment = os.environ | {
        "RUNTIME_DIRECTORY": str(tmp_path / "file" / "run"),
        "NOTIFY_SOCKET": f"@osape-companion-test-{os.getpid()}",
        "PYTHONPATH": str(ROOT),
    }
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notifications:
        notifications.bind("\0" + environment["NOTIFY_SOCKET"][1:])
        notifications.setblocking(False)
        done = subprocess.run(
            [sys.executable, "-m", "companion", "run", "-c", str(tmp_path / "live.toml")],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 1
        assert "RUNTIME_DIRECTORY" in done.stderr
        assert notifications.recv(4096) == b"EXTEND_TIMEOUT_USEC=180000000"

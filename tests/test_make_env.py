"""The script that makes the environment of a checkout (.ci/make-env), with a Python that installs nothing."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

pytestmark = pytest.mark.process

# answers the check of its version; "installs" a package, then waits until the test has read the line of it
PIP = """#!/bin/sh
[ "$1" = -c ] && exit 0
case "$*" in *--requirement*) ;; *) exit 0 ;; esac
echo "Collecting numpy==2.4.6 (from -r requirements.lock (line 4))"
echo "  Downloading numpy-2.4.6.whl (16.8 MB)"
read -r answer <"$FIFO"
echo "Installing collected packages: numpy"
exit "$answer"
"""


@pytest.mark.parametrize("status", [0, 1])
def test_each_package_is_shown_while_pip_runs(status: int, tmp_path: Path) -> None:
    """The awk of Debian showed nothing for minutes: it waits for a full block of input."""
    python, fifo = tmp_path / "env" / "bin" / "python", tmp_path / "fifo"
    python.parent.mkdir(parents=True)
    python.write_text(PIP)
    python.chmod(0o755)
    os.mkfifo(fifo)
    command = ["timeout", "30", "bash", str(ROOT / ".ci" / "make-env"), str(tmp_path / "env"), "requirements.lock"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"FIFO": str(fifo)}) as process:
        assert process.stdout is not None
        shown = [process.stdout.readline() for _ in range(2)]
        assert shown[1] == "  package 1: numpy==2.4.6\n"
        fifo.write_text(f"{status}\n")
        rest = process.stdout.read()
    assert "  unpacking them\n" in rest
    assert process.returncode == status

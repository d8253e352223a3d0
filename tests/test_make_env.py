"""The script that makes the environment of a checkout (.ci/make-env), with a Python that installs nothing."""

from __future__ import annotations

import os
import subprocess
import sys
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


@pytest.mark.parametrize(("version", "again"), [((3, 10), True), ((3, 11), False), ((3, 14), False), ((3, 15), True)])
def test_an_environment_of_an_unsupported_python_is_made_again(
    version: tuple[int, int], again: bool, tmp_path: Path
) -> None:
    """It was kept where its Python was too new, and pip failed each time."""
    python, other = tmp_path / "env" / "bin" / "python", tmp_path / "python3"
    python.parent.mkdir(parents=True)
    python.write_text(
        f'#!/bin/sh\n[ "$1" = -c ] && exec {sys.executable} -c "import sys; sys.version_info = {version}; $2"\n'
    )
    other.write_text('#!/bin/sh\n[ "$1" = -c ] && echo 3.13\nexit 0\n')
    for command in (python, other):
        command.chmod(0o755)
    line = ["bash", str(ROOT / ".ci" / "make-env"), str(tmp_path / "env"), "requirements.lock"]
    shown = subprocess.run(line, env=os.environ | {"PYTHON": str(other)}, capture_output=True, text=True, check=False)
    assert ("making the environment" in shown.stdout) == again
    assert python.exists() != again


def found(folder: Path, **versions: str) -> subprocess.CompletedProcess[str]:
    """What .ci/find-python answers where only these commands exist: name -> version, with " no venv" behind it."""
    for name, version in versions.items():
        command = folder / name.replace("_", ".")
        number, _, lacks_venv = version.partition(" ")
        command.write_text(f'#!/bin/sh\ncase "$2" in *venv*) exit {int(bool(lacks_venv))} ;; esac\necho {number}\n')
        command.chmod(0o755)
    command_line = ["/bin/bash", str(ROOT / ".ci" / "find-python")]
    return subprocess.run(command_line, env={"PATH": str(folder)}, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("version", ["3.11", "3.14"])
def test_a_supported_python_is_found(version: str, tmp_path: Path) -> None:
    assert found(tmp_path, python3=version).stdout == f"{tmp_path}/python3\n"


@pytest.mark.parametrize("other", ["3.10", "3.15", "3.12 no venv"])
def test_the_python_of_the_system_may_be_another_one(other: str, tmp_path: Path) -> None:
    assert found(tmp_path, python3=other, python3_13="3.13").stdout == f"{tmp_path}/python3.13\n"


@pytest.mark.parametrize(
    ("versions", "expected"),
    [
        ({}, "no python3 was found"),
        ({"python3": "3.10"}, "python3 is 3.10 (not supported)"),
        ({"python3": "3.15"}, "python3 is 3.15 (not supported)"),
        ({"python3": "3.12 no venv"}, "sudo apt install python3.12-venv"),
    ],
)
def test_what_to_install_is_named(versions: dict[str, str], expected: str, tmp_path: Path) -> None:
    answer = found(tmp_path, **versions)
    assert (answer.returncode, answer.stdout) == (1, "")
    assert expected in answer.stderr
    assert "sudo apt install python3-venv" in answer.stderr

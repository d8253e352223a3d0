"""The boards that fly are 64-bit ARM: all that the service needs comes as a wheel for them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / ".ci" / "check_aarch64.py"
NO_INDEX = 3


@pytest.mark.slow  # it needs the network
def test_every_dependency_has_a_wheel_for_the_boards() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT), "3.11"], capture_output=True, text=True, check=False)
    if done.returncode == NO_INDEX:
        pytest.skip("no package index can be reached")
    assert done.returncode == 0, done.stderr
    for name in ("numpy", "numba", "llvmlite", "scipy", "opencv_python_headless", "pyzmq", "depthai"):
        assert f" {name}-" in done.stdout

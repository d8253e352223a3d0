"""Installs the packages of the extra `peers` of pyproject.toml, one by one. Run by `make bench`.

A package without a wheel for this computer is reported and left out; the section that uses it says so."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.hardware_info import CHECKOUT

Command = Callable[[Sequence[str]], int]
"""Runs a command and returns its status."""


def peers(pyproject: Path) -> list[str]:
    """The requirements of the extra."""
    extras = tomllib.loads(pyproject.read_text())["project"]["optional-dependencies"]
    return list(extras["peers"])


def install(requirements: Sequence[str], constraints: Sequence[Path], command: Command) -> list[str]:
    """Installs wheels only; returns the requirements for which that failed."""
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
    for file in constraints:
        pip += ["--constraint", str(file)]
    return [requirement for requirement in requirements if command([*pip, requirement]) != 0]


def main() -> int:
    """0: all are there; 1: one is left out, and will be tried again the next time."""
    requirements = peers(CHECKOUT / "pyproject.toml")
    print(f"installing what is compared with: {', '.join(requirements)} (1.2 GB, once)", file=sys.stderr)
    constraints = [CHECKOUT / ".ci" / name for name in ("constraints.txt", "constraints-peers.txt")]
    left_out = install(requirements, constraints, subprocess.call)
    for requirement in left_out:
        print(f"{requirement}: no wheel for this machine, or no network; its rows are left out", file=sys.stderr)
    return 1 if left_out else 0


if __name__ == "__main__":
    sys.exit(main())

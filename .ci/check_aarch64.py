"""Checks that all dependencies have wheels for 64-bit ARM. Only the package index is downloaded.

    python .ci/check_aarch64.py [3.11 3.12 3.13 3.14]

Asks pip to resolve the dependencies, with the camera libraries, for CPython on aarch64 with the glibc of Raspberry Pi OS 12
(2.36) or Ubuntu 22.04 (2.35), as on a board. Status 0: all exist; 1: one is missing, named by pip; 3: no index can be
reached."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from urllib.parse import urlsplit

ROOT = Path(__file__).resolve().parent.parent
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
GLIBC = (17, 24, 26, 27, 28, 31, 34, 35)
CAMERAS = ("oak", "zed", "v4l2")


def requirements() -> list[str]:
    """Of the service, with every camera's library."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    own = ("osape-client",)  # in this checkout, without compiled parts
    return [
        *(r for r in project["dependencies"] if not r.startswith(own)),
        *(r for extra in CAMERAS for r in extras[extra]),
    ]


def wheels(version: str) -> list[str]:
    """File names of the wheels for a version of Python. Raises RuntimeError with pip's words, ConnectionError without
    an index."""
    platforms = [f"manylinux_2_{minor}_aarch64" for minor in GLIBC] + ["manylinux2014_aarch64", "linux_aarch64"]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [
            sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--only-binary=:all:",
            "--target", folder, "--implementation", "cp", "--python-version", version, "--report", str(report),
            "--constraint", str(ROOT / ".ci" / "constraints.txt"),
            *(word for p in platforms for word in ("--platform", p)), *requirements(),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            errors = "\n".join(line for line in done.stderr.splitlines() if line.startswith("ERROR"))
            raise RuntimeError(errors) if index_reachable() else ConnectionError(errors)
        installed = json.loads(report.read_text())["install"]
    return sorted(Path(urlsplit(i["download_info"]["url"]).path).name for i in installed)


def index_reachable() -> bool:
    """Whether pip finds at least one small package for this machine itself."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--dry-run",
        "--ignore-installed",
        "--no-deps",
        "pyserial",
    ]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def main(versions: list[str]) -> int:
    """The status of the command."""
    for version in versions or VERSIONS:
        try:
            found = wheels(version)
        except ConnectionError as error:
            print(f"no index can be reached:\n{error}", file=sys.stderr)
            return 3
        except RuntimeError as error:
            print(f"Python {version} on aarch64 lacks a wheel:\n{error}", file=sys.stderr)
            return 1
        native = [name for name in found if name.endswith("aarch64.whl")]
        print(f"Python {version} on aarch64: {len(found)} wheels, {len(native)} of them native: {', '.join(native)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

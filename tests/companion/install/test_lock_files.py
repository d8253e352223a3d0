"""The lock files: complete, of the constraints' versions, with hashes, and without the address of a package index."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SERVICE, DEMO, DEVELOPMENT = (
    ROOT / f"{name}.lock" for name in ("requirements", "requirements-demo", "requirements-dev")
)
NOT_LOCKED = {"peers", "realsense", "s3"}
"""Extras for the comparison with other projects, and for libraries that only the owner of a device or of a bucket needs."""
ENTRY = re.compile(r"^([A-Za-z0-9._-]+)==(\S+)[^\\\n]*((?: \\\n    --hash=sha256:[0-9a-f]{64})*)$", re.MULTILINE)


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(path: Path) -> dict[str, tuple[str, int]]:
    """Package -> its version and how many hashes it has."""
    return {normal(m[1]): (m[2], m[3].count("--hash=")) for m in ENTRY.finditer(path.read_text())}


def named(requirements: list[str]) -> set[str]:
    return {normal(re.split(r"[<>=\[; ]", r)[0]) for r in requirements} - {
        "osape-companion",
        "osape-client",
    }  # of this checkout


@pytest.mark.parametrize("path", [SERVICE, DEMO, DEVELOPMENT])
def test_every_line_is_a_version_with_hashes(path: Path) -> None:
    text = path.read_text()
    entries = locked(path)
    assert len(entries) == len(re.findall(r"^[A-Za-z][^ ]*==", text, re.MULTILINE))
    assert all(count > 0 for _, count in entries.values())
    rest = ENTRY.sub("", text)
    assert [line for line in rest.splitlines() if line and not line.startswith("#")] == []
    assert "://" not in text


@pytest.mark.parametrize("path", [SERVICE, DEMO, DEVELOPMENT])
def test_the_versions_are_those_of_the_constraints(path: Path) -> None:
    lines = (ROOT / ".ci" / "constraints.txt").read_text().splitlines()
    wanted = {normal(n): v for n, _, v in (line.partition("==") for line in lines if not line.startswith("#"))}
    entries = {name: version for name, (version, _) in locked(path).items()}
    assert {n: v for n, v in entries.items() if n in wanted} == {n: v for n, v in wanted.items() if n in entries}
    elsewhere = {"cffi", "pycparser", "colorama"}  # of other interpreters and systems
    assert entries.keys() - wanted.keys() <= elsewhere


def test_the_requirements_of_the_project_are_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    build = named(project["build-system"]["requires"])
    runtime, extras = project["project"]["dependencies"], project["project"]["optional-dependencies"]
    service = named([*runtime, *extras["oak"], *extras["v4l2"]])
    everything = named([*runtime, *(r for name, rs in extras.items() if name not in NOT_LOCKED for r in rs)])
    assert service | build <= locked(SERVICE).keys()
    assert named([*runtime, *extras["view"]]) | build <= locked(DEMO).keys()
    assert everything | build <= locked(DEVELOPMENT).keys()


def test_make_installs_with_hashes_only() -> None:
    recipe, script = (ROOT / "Makefile").read_text(), (ROOT / ".ci" / "make-env").read_text()
    for lock in (DEMO, DEVELOPMENT):
        assert f".ci/make-env $(VENV) {lock.name}" in recipe
    installs = [line for line in (recipe + script).splitlines() if "pip install" in line]
    assert any("--require-hashes" in line for line in installs)
    assert all("--require-hashes" in line or "--no-deps --no-build-isolation" in line for line in installs)

"""Files of the project that comments, docstrings and documents name exist."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMED = re.compile(
    r"(?<![\w/.-])(?<!\]\()((?:core|drivers|companion|clients|benchmarks|tests|docs|configs|systemd|examples)/[\w/.-]+\.(?:py|md|proto|toml))\b"
)
OWN_FILES = {
    "tests/companion/kernels/test_jit_cache.py",
    "tests/companion/kernels/test_kernel_manifest.py",
    "tests/test_named_files.py",
}
"""Tests that name files of projects which they make."""
HISTORY = ("docs/research/", "CHANGELOG.md")
"""What was measured and changed then names files of then."""


def named_in(file: str) -> list[str]:
    """The named files that neither exist in the project nor beside the file."""
    text = (ROOT / file).read_text("utf-8")
    names = (match.group(1) for match in NAMED.finditer(text))
    return [name for name in names if not (ROOT / name).exists() and not (ROOT / file).parent.joinpath(name).exists()]


def sources() -> list[str]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    kinds = (".py", ".md", ".toml", ".proto", ".js", ".cpp", ".hpp", "Makefile")
    return [f for f in listed if f.endswith(kinds) and not f.startswith(HISTORY) and f not in OWN_FILES]


def test_every_named_file_exists() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone of the repository")
    missing = [f"{file}: {name}" for file in sources() for name in named_in(file)]
    assert missing == [], "\n".join(missing)


def test_a_name_that_leads_nowhere_is_found() -> None:
    found = NAMED.findall("see core/stages/none.py, /etc/osape-companion/config.toml and docs/none.md; not x/core/a.py")
    assert found == ["core/stages/none.py", "docs/none.md"]

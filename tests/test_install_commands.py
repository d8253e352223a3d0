"""Commands that messages and documents give for the installation of libraries."""

from __future__ import annotations

import os
import re
import sys
import tomllib
from pathlib import Path

import pytest

from drivers.optional_library import install_command

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [f for part in ("core", "drivers", "companion", "clients/python") for f in (ROOT / part).rglob("*.py")]


def test_the_libraries_are_those_of_the_extras() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    known = {requirement for extra in extras.values() for requirement in extra}
    named = {r for f in SOURCES for r in re.findall(r"['\"]([a-z][\w-]*>=[0-9][^'\"]*)['\"]", f.read_text())}
    assert len(named) >= 12
    assert named <= known


def test_nothing_is_installed_by_a_name_that_is_on_no_index() -> None:
    """Anybody could register it there."""
    texts = [*SOURCES, *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "configs").glob("*.toml")]
    wrong = re.compile(r"pip install [^\n]*\bosape-(?:companion|client)\b(?!/)")
    assert [str(f.relative_to(ROOT)) for f in texts if wrong.search(f.read_text())] == []


def test_messages_name_a_command_and_not_an_extra() -> None:
    """An extra can be installed by the name of the distribution only, which is on no index."""
    wrong = re.compile(r"install the extra")
    assert [str(f.relative_to(ROOT)) for f in SOURCES if wrong.search(f.read_text())] == []


@pytest.mark.parametrize(("writable", "prefix"), [(True, ""), (False, "sudo ")])
def test_the_command_is_for_this_environment(writable: bool, prefix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: writable)
    assert install_command("depthai>=3.0,<4") == f"{prefix}{sys.executable} -m pip install 'depthai>=3.0,<4'"


def test_no_page_replaces_the_checkout_in_its_environment_by_a_copy() -> None:
    """`pip install '.[batch]'` in the environment of `make env`: later changes of the checkout had no effect."""
    texts = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    copies = re.compile(r"pip install (?!-e|--editable)[^\n]*'\.\[")
    assert [str(f.relative_to(ROOT)) for f in texts if copies.search(f.read_text())] == []

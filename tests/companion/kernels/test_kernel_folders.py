"""Where the directories of compiled kernels are, which of them are deleted, and that none of another user is used."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

import pytest

import companion.kernels.jit_cache as jit_cache
import companion.kernels.state_folders as state_folders
from companion.kernels.jit_cache import VARIABLE, use_own_cache
from companion.kernels.manifest import (
    add_groups,
    missing_groups,
)
from companion.kernels.source_state import source_key
from companion.kernels.state_folders import prune

from ..small_core import kernels, made, sources
from .conftest import GiveTo

pytestmark = pytest.mark.process
ANOTHER_USER = 12345


def test_old_states_are_forgotten(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    oldest, older, newest = made(base, 90, 60, 30)
    monkeypatch.setattr(state_folders, "MAX_STATES", 3)
    foreign_files = [base / "core_0123456789abcdef", base / "kernels-notes", base / "notes.txt"]
    for foreign in foreign_files[:2]:
        foreign.mkdir()
    foreign_files[2].write_text("not ours")
    current = use_own_cache()
    assert current is not None
    assert [f.exists() for f in (oldest, older, newest, current, *foreign_files)] == [False, *[True] * 6]


def test_what_another_process_uses_stays(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_folders, "MAX_STATES", 3)
    folders = made(base, *range(1, 7))
    with (folders[4] / "in-use").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        prune(folders[5])
    assert [f.exists() for f in folders] == [True, True, False, False, True, True]


def test_the_users_cache_is_the_usual_place(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(base))
    assert use_own_cache() == base / "osape-companion" / f"kernels-{source_key(jit_cache.ROOT)}"


@pytest.mark.parametrize("home", ["", "/", "a file"])
def test_without_a_home_beside_the_sources(
    base: Path, home: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "a file").write_text("")
    root = sources(tmp_path / "project", factor=2)
    monkeypatch.chdir(tmp_path / "project")
    monkeypatch.delenv(VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "a file") if home == "a file" else home)
    monkeypatch.setattr(jit_cache, "ROOT", root)
    folder = use_own_cache()
    assert folder is not None
    assert folder.parent == root / "core" / "__pycache__"
    assert sorted(p.name for p in root.iterdir()) == ["core", "drivers"]


def test_a_temporary_directory_stands_in_for_one_that_cannot_be_written(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba refuses to import a kernel where it cannot write: every command ended with a traceback."""
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    folder = use_own_cache()
    assert folder is not None
    assert folder.is_relative_to(tmp_path)
    assert os.environ[VARIABLE] == str(folder)
    assert jit_cache.unwritable_text() == f"compiled kernels cannot be stored in {tmp_path / 'file' / 'cache'}"
    assert jit_cache.no_place_text() == ""


def test_where_nothing_can_be_written_the_remedy_is_named(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    assert use_own_cache() is None
    assert str(tmp_path / "file" / "cache") in jit_cache.no_place_text()
    assert f"set {VARIABLE}" in jit_cache.no_place_text()


def test_without_a_usable_runtime_directory_the_usual_temporary_one_stands_in(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A container started with --user may not write that of the image, and `companion run` makes one that is missing only
    later."""
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "missing"))
    folder = use_own_cache()
    assert folder is not None
    assert folder.parents[1] == tmp_path


def test_a_directory_that_another_user_has_made_is_not_used(
    base: Path, tmp_path: Path, give_to: GiveTo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder that all users can write, such as /tmp, its name can be guessed, and kernels are machine code."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    foreign = base / f"kernels-{source_key(jit_cache.ROOT)}"
    (foreign / "core.outer-0").mkdir(parents=True)
    (foreign / "core.outer-0" / "outer.nbi").write_text("")
    add_groups(foreign, ["extractor"])
    foreign.chmod(0o777)
    give_to(ANOTHER_USER, foreign)
    folder = use_own_cache()
    assert folder is not None
    assert folder.parents[1] == tmp_path
    assert kernels(folder) == set()
    assert missing_groups(folder, ["extractor"]) == ["extractor"]


def test_a_link_that_another_user_has_made_is_not_followed(
    base: Path, tmp_path: Path, give_to: GiveTo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its maker can turn it to another directory after the check."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    own = tmp_path / "own"
    own.mkdir()
    foreign = base / f"kernels-{source_key(jit_cache.ROOT)}"
    foreign.symlink_to(own)
    give_to(ANOTHER_USER, foreign)
    folder = use_own_cache()
    assert folder is not None
    assert folder.parents[1] == tmp_path
    assert list(own.iterdir()) == []


def test_old_directories_of_another_user_are_left_alone(
    base: Path, tmp_path: Path, give_to: GiveTo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link in the place of its lock made root create, or lock, any file of the system."""
    monkeypatch.setattr(state_folders, "MAX_STATES", 1)
    foreign, old = made(base, 90, 60)
    (foreign / "in-use").unlink()
    (foreign / "in-use").symlink_to(tmp_path / "nologin")
    give_to(ANOTHER_USER, foreign)
    assert use_own_cache() is not None
    assert [f.exists() for f in (foreign, old, tmp_path / "nologin")] == [True, False, False]

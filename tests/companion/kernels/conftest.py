"""What tests of compiled kernels share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import companion.kernels.jit_cache as jit_cache
import companion.kernels.state_folders as state_folders
from companion.kernels.jit_cache import VARIABLE

from ..small_core import closures_of, run, sources

GiveTo = Callable[[int, Path], None]


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, as if numba were not loaded yet, of an installation without compiled kernels; what is locked in it
    is let go at the end."""
    folder = tmp_path / "cache"
    folder.mkdir()
    monkeypatch.setattr(jit_cache, "SHARED", tmp_path / "of-the-installation")
    monkeypatch.setenv(VARIABLE, str(folder))
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setattr(state_folders, "_held", [])
    monkeypatch.setattr(jit_cache, "_unwritable", [])
    monkeypatch.setattr(jit_cache, "import_closures", closures_of)
    return folder


@pytest.fixture
def give_to(monkeypatch: pytest.MonkeyPatch) -> GiveTo:
    """Shows a path as made by a user, a link and not its target: only root could give it away."""
    owners: dict[str, int] = {}
    stat = Path.stat

    def stat_of(path: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        found = stat(path, follow_symlinks=follow_symlinks)
        owner = owners.get(os.path.realpath(path) if follow_symlinks else str(path), found.st_uid)
        (mode, inode, device, links, _, *others), names = found.__reduce__()[1]
        return os.stat_result((mode, inode, device, links, owner, *others), names)

    monkeypatch.setattr(Path, "stat", stat_of)
    return lambda owner, path: owners.update({str(path): owner})


@pytest.fixture(scope="module")
def small_core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the small core, `project`, and a cache with its compiled kernels, `cache`. Tests use copies."""
    folder = tmp_path_factory.mktemp("small-core")
    assert run(sources(folder / "project", factor=2), folder / "cache") == "21"
    return folder

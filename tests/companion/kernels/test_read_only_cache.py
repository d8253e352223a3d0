"""Kernels of a cache that cannot be written are used, with those for other arguments beside them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion.kernels.jit_cache as jit_cache
import companion.kernels.state_folders as state_folders
from companion.kernels.jit_cache import VARIABLE
from companion.kernels.manifest import (
    add_groups,
)
from companion.kernels.module_folder import delete_kernels
from companion.kernels.source_state import source_key

from ..small_core import KEYED, sources, state_of

pytestmark = pytest.mark.process

NAMED = """
import os
import companion  # takes a temporary directory for its own sources
os.environ[{variable!r}] = {cache!r}
"""
READ_ONLY = """
import os
import sys
from pathlib import Path
folder = Path(os.environ[jit_cache.VARIABLE])
assert jit_cache.use_own_cache() == folder  # a child process finds it too
sys.path.insert(0, {root!r})
from core.outer import outer
results = outer(10), outer(1.5)
print(*results, sum(outer.stats.cache_hits.values()), folder.parent.parent.name, len(list(folder.rglob("outer*.nbc"))))
"""


def python_without_privileges(code: str, cache: Path, temporary: Path) -> subprocess.CompletedProcess[str]:
    """Runs code with a cache and a folder for temporary files; modes of files hold for root too."""
    environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_DISABLE_JIT", "PYTHONPATH")}
    environment |= {VARIABLE: str(cache), "TMPDIR": str(temporary)}
    code = NAMED.format(variable=VARIABLE, cache=str(cache)) + code
    bound = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override"] if os.geteuid() == 0 else []
    return subprocess.run(
        [*bound, sys.executable, "-B", "-c", code],
        env=environment,
        cwd=jit_cache.ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def set_mode(folder: Path, mode: int) -> None:
    """Of all directories; files keep theirs."""
    for path in [*folder.rglob("*"), folder]:
        if path.is_dir():
            path.chmod(mode)


@pytest.fixture
def read_only(small_core: Path, tmp_path: Path) -> Iterator[Path]:
    """A cache that cannot be written, with the compiled kernels of `project` beside it."""
    root = shutil.copytree(small_core / "project", tmp_path / "project")
    cache = shutil.copytree(small_core / "cache", tmp_path / "read-only")
    add_groups(state_of(root, cache), ["extractor"])
    set_mode(cache, 0o555)
    yield cache
    set_mode(cache, 0o755)


def test_kernels_of_a_directory_that_cannot_be_written_are_used(read_only: Path, tmp_path: Path) -> None:
    """Those for other arguments are compiled beside the links, which go with the process or, of a killed one, with the next."""
    root, temporary = tmp_path / "project", tmp_path / "temporary"
    (temporary / "osape-companion-kernels-4194305-of-a-killed-process").mkdir(parents=True)
    before = {file: file.stat().st_mtime_ns for file in read_only.rglob("*")}
    done = python_without_privileges((KEYED + READ_ONLY).format(root=str(root)), read_only, temporary)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["21", "4.0", "1", "temporary", "2"]
    assert list(temporary.iterdir()) == []
    assert {file: file.stat().st_mtime_ns for file in read_only.rglob("*")} == before


def test_kernels_beside_which_another_user_has_made_a_directory_are_used(read_only: Path, tmp_path: Path) -> None:
    """As root does with `sudo -E`: numba refused to import the kernels of that directory."""
    root, temporary = tmp_path / "project", tmp_path / "temporary"
    temporary.mkdir()
    for folder in (read_only, read_only / f"kernels-{source_key(root)}"):
        folder.chmod(0o755)
    done = python_without_privileges((KEYED + READ_ONLY).format(root=str(root)), read_only, temporary)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["21", "4.0", "1", "temporary", "2"]


def test_two_starts_delete_what_a_killed_process_left(tmp_path: Path) -> None:
    """The second found nothing there, made no links and compiled all kernels."""
    gone = tmp_path / "osape-companion-kernels-4194305-gone"
    kept = tmp_path / "osape-companion-kernels-4194305-kept"
    gone.symlink_to("nowhere")  # listed, and not there: the other process has deleted it
    kept.mkdir()
    assert state_folders.make_temporary(tmp_path).is_dir()
    assert not kept.exists()


def test_without_all_kernels_a_directory_that_cannot_be_written_is_not_used(read_only: Path, tmp_path: Path) -> None:
    """Kernels are compiled into a temporary directory, which goes with the process."""
    root, temporary = sources(tmp_path / "project", factor=3), tmp_path / "temporary"
    temporary.mkdir()
    done = python_without_privileges((KEYED + READ_ONLY).format(root=str(root)), read_only, temporary)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["31", "5.5", "0", "temporary", "2"]
    assert list(temporary.iterdir()) == []


def test_deleting_a_linked_kernel_deletes_the_link(tmp_path: Path) -> None:
    """A damaged kernel is compiled again, and the directory that cannot be written is not touched."""
    kernel = tmp_path / "level.pool-34.py311.1.nbc"
    kernel.write_bytes(b"damaged")
    (tmp_path / "copy" / "core.level").mkdir(parents=True)
    link = tmp_path / "copy" / "core.level" / kernel.name
    link.symlink_to(kernel)
    assert delete_kernels(tmp_path / "copy") == 1
    assert not link.is_symlink()
    assert kernel.exists()

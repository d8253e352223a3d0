"""A damaged cache of compiled kernels is found before it is loaded, and made again."""

from __future__ import annotations

import logging
import os
import shutil
from pathlib import Path

import pytest

import companion.kernels.compilation as compilation
import companion.kernels.loading as loading
import companion.kernels.manifest as manifest_module
import companion.kernels.warmup as warmup
from companion.kernels.manifest import (
    MANIFEST,
    Manifest,
    add_groups,
    discard_damaged,
    missing_groups,
    read_manifest,
    write_manifest,
)
from companion.kernels.module_folder import kernels_in

KERNELS = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x
"""
GROUPS = ("extractor",)
CODE, INDEX, OTHER = "core.a-1/a.f-0.py311.1.nbc", "core.a-1/a.f-0.py311.nbi", "core.b-2/b.g-0.py311.nbi"


def made(folder: Path) -> dict[str, Path]:
    """Three files of two modules with their manifest, and one that is none of numba's."""
    files = {name: folder / name for name in (CODE, INDEX, OTHER, "core.a-1/notes.txt")}
    for name, file in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(name.encode() * 100)
    add_groups(folder, GROUPS)
    return files


def changed(file: Path, content: bytes) -> None:
    """As a fault of the disk does it: the time of the last change stays."""
    before = file.stat()
    file.write_bytes(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def replaced_by_numba(file: Path, content: bytes) -> None:
    """numba adds a signature to a function that is cached."""
    later_ns = file.stat().st_mtime_ns + 1_000_000
    file.write_bytes(content)
    os.utime(file, ns=(later_ns, later_ns))


def test_whole_kernels_are_not_damaged(tmp_path: Path) -> None:
    files = made(tmp_path)
    assert discard_damaged(tmp_path) == 0
    assert all(file.exists() for file in files.values())
    assert missing_groups(tmp_path, ("extractor", "world")) == ["world"]


def test_groups_are_added(tmp_path: Path) -> None:
    made(tmp_path)
    add_groups(tmp_path, ["world"])
    assert missing_groups(tmp_path, ("extractor", "world")) == []


def test_a_power_failure_leaves_no_entry_of_kernels_that_are_not_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The manifest may be on the disk before kernels that were written earlier: the next start would load what is left of
    them."""
    write_manifest(tmp_path, Manifest())
    groups: list[list[str]] = []
    monkeypatch.setattr(os, "sync", lambda: groups.append(missing_groups(tmp_path, GROUPS)))
    add_groups(tmp_path, GROUPS)
    assert groups == [["extractor"]]
    assert missing_groups(tmp_path, GROUPS) == []


@pytest.mark.parametrize("content", [b"", b"\0" * 2600, CODE.encode() * 99 + CODE.encode()[:-1] + b"d"])
def test_the_module_of_changed_content_is_deleted(tmp_path: Path, content: bytes) -> None:
    files = made(tmp_path)
    changed(files[CODE], content)
    assert discard_damaged(tmp_path) == 2
    assert {name for name, f in files.items() if f.exists()} == {OTHER, "core.a-1/notes.txt"}
    assert missing_groups(tmp_path, GROUPS) == ["extractor"]
    assert discard_damaged(tmp_path) == 0
    changed(files[OTHER], b"x")
    assert discard_damaged(tmp_path) == 1  # its entry has stayed


def test_a_missing_file_is_compiled_by_a_child(tmp_path: Path) -> None:
    """The service would compile it in its own process, which leaves about 1 GB allocated."""
    files = made(tmp_path)
    files[CODE].unlink()
    assert discard_damaged(tmp_path) == 1
    assert missing_groups(tmp_path, GROUPS) == ["extractor"]
    assert not files[INDEX].exists()


def test_a_kernel_that_numba_wrote_later_is_taken_in(tmp_path: Path) -> None:
    file = made(tmp_path)[OTHER]
    replaced_by_numba(file, b"of two signatures now")
    assert discard_damaged(tmp_path) == 0
    add_groups(tmp_path, GROUPS)
    changed(file, b"of two signatures noW")
    assert discard_damaged(tmp_path) == 1


def test_a_kernel_that_another_process_writes_meanwhile_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two commands compile at once. The one replaces a file after the other has read it, and before its manifest is
    written."""
    file = made(tmp_path)[OTHER]
    write = write_manifest

    def write_late(folder: Path, manifest: Manifest) -> None:
        replaced_by_numba(file, b"of two signatures now")
        write(folder, manifest)

    with monkeypatch.context() as patch:
        patch.setattr(manifest_module, "write_manifest", write_late)
        add_groups(tmp_path, GROUPS)
    assert discard_damaged(tmp_path) == 0


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\n{}", b"[" * 100_000, b'\n{"groups": ["extractor"]}'])
def test_with_a_damaged_manifest_no_cached_kernel_is_used(tmp_path: Path, content: bytes) -> None:
    files = made(tmp_path)
    (tmp_path / MANIFEST).write_bytes(content)
    assert missing_groups(tmp_path, GROUPS) == ["extractor"]
    assert discard_damaged(tmp_path) == 3
    assert [name for name, f in files.items() if f.exists()] == ["core.a-1/notes.txt"]
    assert read_manifest(tmp_path) == Manifest(groups=[])


def test_a_single_changed_character_damages_the_manifest(tmp_path: Path) -> None:
    made(tmp_path)
    text = (tmp_path / MANIFEST).read_text()
    (tmp_path / MANIFEST).write_text(text.replace("extractor", "extractoR"))
    assert discard_damaged(tmp_path) == 3


@pytest.mark.parametrize("late_s", [-1, 10])
def test_a_copied_directory_with_other_times_is_not_damaged(tmp_path: Path, late_s: int) -> None:
    """As cp -r, a container image or an archive make it: all kernels would be compiled again. Archives, and some file
    systems, keep whole seconds."""
    made(tmp_path / "old")
    copy = shutil.copytree(tmp_path / "old", tmp_path / "copy")
    for file in kernels_in(copy):
        seconds = file.stat().st_mtime_ns // 10**9 + late_s
        os.utime(file, (seconds, seconds))
    assert discard_damaged(copy) == 0
    if late_s < 0:
        changed(copy / CODE, b"half")
        assert discard_damaged(copy) == 2


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The directory of a state with two compiled files; loading them is left out."""
    (tmp_path / "small_kernels.py").write_text(KERNELS)
    state = tmp_path / "cache" / "kernels-0123456789abcdef"
    state.mkdir(parents=True)
    write_manifest(state, Manifest())
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(state))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setattr(compilation, "CHILD", "from small_kernels import twice; assert twice(3) == 6")
    monkeypatch.setattr(loading, "run_kernels", lambda groups: None)
    warmup.warm_up()
    return state


def test_a_start_makes_a_damaged_kernel_again(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    (file,) = cache.rglob("*twice*.nbc")
    content = file.read_bytes()
    changed(file, content[:-8] + bytes(8))
    with caplog.at_level(logging.WARNING):
        loading.make_ready("extractor")
    assert "damaged: 2 files deleted" in caplog.text
    assert file.stat().st_size == len(content)
    caplog.clear()
    loading.make_ready("extractor")
    assert caplog.text == ""


def test_a_command_makes_a_damaged_kernel_again(cache: Path) -> None:
    (file,) = cache.rglob("*twice*.nbi")
    changed(file, bytes(file.stat().st_size))
    assert warmup.ensure_compiled("extractor") == 2
    assert len(kernels_in(cache)) == 2
    assert warmup.ensure_compiled("extractor") == 0

"""A damaged cache of compiled kernels is found before it is loaded, and made again."""

from __future__ import annotations

import gc
import json
import logging
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import companion.kernels.loading as loading
import companion.kernels.warmup as warmup
from companion.kernels.cache_state import mark_complete
from companion.kernels.jit_cache import COMPLETE, VARIABLE, Link, seed
from companion.kernels.manifest import MANIFEST, copy_entries, damaged_kernels, delete_kernels, write_manifest
from companion.kernels.source_state import KERNELS_OUTSIDE_CORE

KERNELS = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x

@njit(cache=True)
def thrice(x):
    return 3 * x
"""


def made(folder: Path) -> dict[str, Path]:
    """Three files of two functions, and one that is none of numba's."""
    (folder / "core").mkdir(parents=True)
    names = ("a.f-3.py311.nbi", "a.f-3.py311.1.nbc", "a.g-9.py311.nbi", "notes.txt")
    files = {name: folder / "core" / name for name in names}
    for name, file in files.items():
        file.write_bytes(name.encode() * 100)
    return files


def changed(file: Path, content: bytes) -> None:
    """As a fault of the disk does it: the time of the last change stays."""
    before = file.stat()
    file.write_bytes(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_whole_kernels_are_not_damaged(tmp_path: Path) -> None:
    made(tmp_path)
    assert damaged_kernels(tmp_path) == []  # without a manifest
    write_manifest(tmp_path)
    assert damaged_kernels(tmp_path) == []


def test_a_power_failure_leaves_no_mark_for_kernels_that_are_not_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mark may be on the disk before kernels that were written earlier: the next start would load what is left of them."""
    made(tmp_path)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    marks: list[list[Path]] = []
    monkeypatch.setattr(os, "sync", lambda: marks.append(list(tmp_path.glob(f"{COMPLETE}*"))))
    mark_complete("world")
    assert marks == [[]]
    assert (tmp_path / f"{COMPLETE}world").exists()
    assert (tmp_path / MANIFEST).exists()


@pytest.mark.parametrize("content", [b"", b"\0" * 1700, b"a.f-3.py311.1.nbc" * 99 + b"a.f-3.py311.1.nbd"])
def test_changed_content_is_found_and_its_function_deleted(tmp_path: Path, content: bytes) -> None:
    files = made(tmp_path)
    write_manifest(tmp_path)
    changed(files["a.f-3.py311.1.nbc"], content)
    damaged = damaged_kernels(tmp_path)
    assert damaged == [files["a.f-3.py311.1.nbc"]]
    assert delete_kernels(damaged) == 2
    assert {name for name, f in files.items() if f.exists()} == {"a.g-9.py311.nbi", "notes.txt"}
    write_manifest(tmp_path)
    assert damaged_kernels(tmp_path) == []


def test_damage_stays_known_when_the_manifest_is_written_again(tmp_path: Path) -> None:
    files = made(tmp_path)
    write_manifest(tmp_path)
    changed(files["a.g-9.py311.nbi"], b"a.g-9.py311.nbj" * 100)
    write_manifest(tmp_path)
    assert damaged_kernels(tmp_path) == [files["a.g-9.py311.nbi"]]


def test_a_kernel_that_numba_wrote_later_is_taken_in(tmp_path: Path) -> None:
    files = made(tmp_path)
    write_manifest(tmp_path)
    later_ns = (tmp_path / MANIFEST).stat().st_mtime_ns + 10**9
    file = files["a.g-9.py311.nbi"]
    file.write_bytes(b"of two signatures now")
    os.utime(file, ns=(later_ns, later_ns))
    assert damaged_kernels(tmp_path) == []
    write_manifest(tmp_path)
    changed(file, b"of two signatures noW")
    assert damaged_kernels(tmp_path) == [file]


def test_a_kernel_that_another_process_writes_meanwhile_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two commands compile at once. The one replaces a file after the other has read it, and before its manifest is
    written. The file system's clock is a tick behind the system's."""
    time_ns = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: time_ns() + 10_000_000)
    file = made(tmp_path)["a.g-9.py311.nbi"]
    dump = json.dump

    def dump_late(*args: Any) -> None:
        file.with_suffix(".part").write_bytes(b"of two signatures now")
        file.with_suffix(".part").replace(file)
        dump(*args)

    monkeypatch.setattr(json, "dump", dump_late)
    write_manifest(tmp_path)
    assert damaged_kernels(tmp_path) == []


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[1]",
        b'{"a": 1}',
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"core/a.f-3.py311.nbi": [1e999, 1, ""]}',
        b'{"core/a.\\u0000": [1, 1, ""]}',
    ],
)
def test_with_a_damaged_manifest_no_cached_kernel_is_used(tmp_path: Path, content: bytes) -> None:
    files = made(tmp_path)
    write_manifest(tmp_path)
    (tmp_path / MANIFEST).write_bytes(content)
    assert len(damaged_kernels(tmp_path)) == 3
    write_manifest(tmp_path)
    assert damaged_kernels(tmp_path) == []
    assert files["notes.txt"].exists()


def test_linked_kernels_keep_their_entries(tmp_path: Path) -> None:
    files = made(tmp_path / "old")
    write_manifest(tmp_path / "old")
    changed(files["a.g-9.py311.nbi"], b"x" * 1500)
    (tmp_path / "new" / "core").mkdir(parents=True)
    name = "core/a.g-9.py311.nbi"
    os.link(files["a.g-9.py311.nbi"], tmp_path / "new" / name)
    copy_entries(tmp_path / "old", tmp_path / "new", [name])
    assert damaged_kernels(tmp_path / "new") == [tmp_path / "new" / name]


def test_a_linked_kernel_that_numba_wrote_after_the_manifest_is_not_damaged(tmp_path: Path) -> None:
    """numba adds a signature to a cached function; then the version changes, and a new directory begins with links."""
    file = made(tmp_path / "old")["a.g-9.py311.nbi"]
    write_manifest(tmp_path / "old")
    file.write_bytes(b"of two signatures now")
    later_ns = (tmp_path / "old" / MANIFEST).stat().st_mtime_ns + 1_000_000
    os.utime(file, ns=(later_ns, later_ns))
    (tmp_path / "new" / "core").mkdir(parents=True)
    name = "core/a.g-9.py311.nbi"
    os.link(file, tmp_path / "new" / name)
    copy_entries(tmp_path / "old", tmp_path / "new", [name])
    if (tmp_path / "new" / MANIFEST).exists():
        os.utime(tmp_path / "new" / MANIFEST, ns=(later_ns + 1, later_ns + 1))
    assert damaged_kernels(tmp_path / "new") == []


def test_a_copied_directory_with_other_times_is_not_damaged(tmp_path: Path) -> None:
    """As cp -r, a container image or an archive make it: all kernels would be compiled again."""
    made(tmp_path / "old")
    write_manifest(tmp_path / "old")
    copy = tmp_path / "copy"
    shutil.copytree(tmp_path / "old", copy, copy_function=shutil.copyfile)
    later_ns = (copy / MANIFEST).stat().st_mtime_ns + 10**9
    os.utime(copy / MANIFEST, ns=(later_ns, later_ns))
    assert damaged_kernels(copy) == []
    changed(copy / "core" / "a.g-9.py311.nbi", b"x" * 1500)
    assert damaged_kernels(copy) == [copy / "core" / "a.g-9.py311.nbi"]


def test_a_seeded_directory_is_checked(tmp_path: Path) -> None:
    """Damage in an older directory is not linked into the new one unnoticed."""
    root = tmp_path / "sources"
    for place in ("core", "drivers"):
        (root / place).mkdir(parents=True)
    (root / "core" / "a.py").write_text("")
    for name in KERNELS_OUTSIDE_CORE:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    base = tmp_path / "base"
    old, new = base / ("kernels-" + "0" * 16), base / ("kernels-" + "1" * 16)
    files = made(old)
    seed((base,), old, root)
    write_manifest(old)
    changed(files["a.f-3.py311.nbi"], b"y" * 1500)
    new.mkdir()
    seed((base,), new, root)
    assert damaged_kernels(new) == [new / "core" / "a.f-3.py311.nbi"]


def seeded(base: Path, old: Path, new: Path, link: Link | None = None) -> None:
    """Sources of one module, and a new directory for them that begins with the kernels of an older one."""
    root = base.parent / "sources"
    for name in ("core/a.py", *KERNELS_OUTSIDE_CORE):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    seed((), old, root)
    write_manifest(old)
    seed((base,), new, root, link)


def test_copied_kernels_are_checked_where_the_file_system_keeps_whole_seconds(tmp_path: Path) -> None:
    """As ext4 with inodes of 128 bytes, FAT and some network drives do."""
    base = tmp_path / "base"
    old, new = base / ("kernels-" + "0" * 16), base / ("kernels-" + "1" * 16)

    def copy(file: Path, place: Path) -> None:
        shutil.copyfile(file, place)
        seconds = file.stat().st_mtime_ns // 10**9
        os.utime(place, (seconds, seconds))

    made(old)
    new.mkdir()
    seeded(base, old, new, copy)
    changed(new / "core" / "a.f-3.py311.1.nbc", b"half")
    assert damaged_kernels(new) == [new / "core" / "a.f-3.py311.1.nbc"]


def test_an_index_is_never_joined_with_machine_code_of_another_directory(tmp_path: Path) -> None:
    """numba writes the index of a kernel first, and ends on a full disk before its code. It takes any code of that name:
    that of other arguments, if the two directories were filled in another order."""
    base = tmp_path / "base"
    old, new = base / ("kernels-" + "0" * 16), base / ("kernels-" + "1" * 16)
    made(old)
    (new / "core").mkdir(parents=True)
    index = new / "core" / "a.f-3.py311.nbi"
    index.write_bytes(b"of other arguments")
    seeded(base, old, new)
    assert index.read_bytes() == b"of other arguments"
    assert sorted(f.name for f in (new / "core").iterdir()) == ["a.f-3.py311.nbi", "a.g-9.py311.nbi"]
    assert damaged_kernels(new) == []


def test_machine_code_without_an_index_is_replaced(tmp_path: Path) -> None:
    """A start was ended before it linked the index; the next one takes another directory."""
    base = tmp_path / "base"
    old, new = base / ("kernels-" + "0" * 16), base / ("kernels-" + "1" * 16)
    files = made(old)
    (new / "core").mkdir(parents=True)
    code = new / "core" / "a.f-3.py311.1.nbc"
    code.write_bytes(b"of another directory")
    seeded(base, old, new)
    assert code.read_bytes() == files[code.name].read_bytes()
    assert damaged_kernels(new) == []


def test_a_directory_is_complete_only_with_all_kernels_of_the_complete_one(tmp_path: Path) -> None:
    """The service compiled the others in its own process, which leaves about 1 GB allocated."""
    shared, key = tmp_path / "shared", "kernels-" + "1" * 16
    new = tmp_path / "base" / key
    made(shared / key)
    (new / "core").mkdir(parents=True)
    (new / "core" / "a.f-3.py311.nbi").write_bytes(b"of other arguments")
    root = tmp_path / "sources"
    for name in ("core/a.py", *KERNELS_OUTSIDE_CORE):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    seed((), shared / key, root)
    (shared / key / f"{COMPLETE}extractor").write_text("this processor")
    seed((shared,), new, root)
    assert not (new / f"{COMPLETE}extractor").exists()
    whole, without_closures = tmp_path / "whole" / key, tmp_path / "without" / key
    for folder in (whole, without_closures):
        folder.mkdir(parents=True)
        seed((shared,), folder, root)
        assert (folder / f"{COMPLETE}extractor").exists() == (folder == whole)
        (shared / key / "closures.json").unlink(missing_ok=True)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache with two compiled kernels; loading them is left out."""
    (tmp_path / "small_kernels.py").write_text(KERNELS)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    code = "from small_kernels import twice, thrice; assert twice(3) == 6 and thrice(3) == 9"
    monkeypatch.setattr(warmup, "CHILD", code)
    monkeypatch.setattr(loading, "run_kernels", lambda modes, metres: None)
    yield tmp_path / "cache"
    gc.unfreeze()


def test_a_start_makes_a_damaged_kernel_again(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    warmup.warm_up()
    (whole,) = cache.rglob("*thrice*.nbc")
    (file,) = cache.rglob("*twice*.nbc")
    content, stamp = file.read_bytes(), whole.stat().st_mtime_ns
    changed(file, content[:-8] + bytes(8))
    with caplog.at_level(logging.WARNING):
        loading.make_ready("safe")
    assert "damaged: 2 files deleted" in caplog.text
    assert file.stat().st_size == len(content)
    assert whole.stat().st_mtime_ns == stamp
    assert damaged_kernels(cache) == []
    caplog.clear()
    loading.make_ready("safe")
    assert caplog.text == ""


def test_the_command_makes_a_damaged_kernel_again(cache: Path) -> None:
    warmup.warm_up()
    (file,) = cache.rglob("*twice*.nbi")
    changed(file, bytes(file.stat().st_size))
    done = warmup.warm_up()
    assert (done.deleted, done.cached) == (2, 4)
    assert damaged_kernels(cache) == []


def test_a_cache_without_a_manifest_gets_one(cache: Path) -> None:
    warmup.warm_up()
    (cache / MANIFEST).unlink()
    loading.make_ready("safe")
    assert (cache / MANIFEST).exists()

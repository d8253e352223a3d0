"""Compiled kernels never outlive the sources that they were made of, also where only a called one's file changed."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import companion.kernels.jit_cache as jit_cache
import companion.kernels.state_folders as state_folders
from companion.kernels.jit_cache import VARIABLE, kernel_folder, use_own_cache
from companion.kernels.manifest import (
    Manifest,
    add_groups,
    discard_damaged,
    missing_groups,
    read_manifest,
    write_manifest,
)
from companion.kernels.module_folder import delete_kernels
from companion.kernels.source_state import CODE_OPTIONS, import_closures, source_key
from companion.kernels.state_folders import base_of, prune

from .small_core import CALLER, KEYED, RUN, python, sources

pytestmark = pytest.mark.process


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
    return folder


def test_every_module_of_the_service_has_it(tmp_path: Path) -> None:
    printed = python("import companion.pipeline.pipeline, numba; print(numba.config.CACHE_DIR)", tmp_path)
    assert Path(printed) == tmp_path / f"kernels-{source_key(jit_cache.ROOT)}"
    assert python("import companion.cli, sys; print('numba' in sys.modules)", tmp_path) == "False"


def state_of(root: Path, cache: Path) -> Path:
    """The directory in a cache for the present state of the sources."""
    return cache / f"kernels-{source_key(root)}"


def run(root: Path, cache: Path) -> str:
    """What the small core prints, with its kernels in a cache."""
    return python(KEYED.format(root=str(root)) + RUN.format(root=str(root)), cache)


def kernels(folder: Path) -> set[str]:
    return {file.name.partition("-")[0] for file in folder.glob("*/*.nbi")}


@pytest.fixture(scope="module")
def small_core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the small core, `project`, and a cache with its compiled kernels, `cache`. Tests use copies."""
    folder = tmp_path_factory.mktemp("small-core")
    assert run(sources(folder / "project", factor=2), folder / "cache") == "21"
    return folder


def test_a_change_in_a_called_kernel_is_noticed(small_core: Path, tmp_path: Path) -> None:
    """Beside it what happens with one directory for all: when that ends, numba has mended it and so may we."""
    root = shutil.copytree(small_core / "project", tmp_path / "project")
    shutil.copytree(small_core / "cache", tmp_path / "keyed")
    first = RUN.format(root=str(root))
    keyed = KEYED.format(root=str(root)) + first
    assert python(first, tmp_path / "one") == "21"
    sources(root, factor=3)
    assert python(first, tmp_path / "one") == "21"
    assert python(keyed, tmp_path / "keyed") == "31"
    assert len(list((tmp_path / "keyed").iterdir())) == 2 + 1  # two states of these sources, one of the service's own


@pytest.mark.parametrize(
    ("changed", "added", "kept"),
    [
        ("core/outer.py", "\nx = 1\n", {"inner.inner"}),
        ("core/inner.py", "\nx = 1\n", set()),
        ("core/other.py", "\nx = 1\n", {"inner.inner", "outer.outer"}),
        ("core/inner.py", '\n"""A sentence that no machine code depends on."""\n', {"inner.inner", "outer.outer"}),
    ],
)
def test_a_new_directory_starts_with_the_kernels_that_did_not_change(
    small_core: Path, tmp_path: Path, changed: str, added: str, kept: set[str]
) -> None:
    shutil.copytree(small_core, tmp_path, dirs_exist_ok=True)
    root, cache = tmp_path / "project", tmp_path / "cache"
    open_cache = KEYED.format(root=str(root))
    with (root / changed).open("a") as file:
        file.write(added)
    python(open_cache, cache)
    assert kernels(state_of(root, cache)) == kept
    assert run(root, cache) == "21"


def test_a_docstring_above_a_kernel_does_not_compile_it_again(small_core: Path, tmp_path: Path) -> None:
    """It moves the kernel to another line; numba distinguishes kernels of one name by their lines otherwise."""
    root = shutil.copytree(small_core / "project", tmp_path / "project")
    cache = shutil.copytree(small_core / "cache", tmp_path / "cache")
    run = KEYED.format(root=str(root)) + RUN.format(root=str(root))
    hits = "print(sum(outer.stats.cache_hits.values()), sum(outer.stats.cache_misses.values()))"
    for name in ("outer", "inner"):
        file = root / "core" / f"{name}.py"
        file.write_text('"""What this module is for,\n\nin several lines."""\n' + file.read_text())
    assert python(run + hits, cache) == "21\n1 0"
    sources(root, factor=3)
    assert python(run + hits, cache) == "31\n0 1"


def test_modules_of_the_same_name_in_two_packages_are_distinguished(tmp_path: Path) -> None:
    root, cache = sources(tmp_path / "project", factor=2), tmp_path / "cache"
    (root / "core" / "world").mkdir()
    (root / "core" / "world" / "__init__.py").write_text("")
    (root / "core" / "world" / "outer.py").write_text(CALLER.replace("from .inner", "from ..inner"))
    (root / "core" / "outer.py").write_text(
        "from numba import njit\n\n@njit(cache=True)\ndef outer(x):\n    return x\n"
    )
    run = KEYED.format(root=str(root)) + RUN.format(root=str(root)).replace("core.outer", "core.world.outer")
    assert python(run + "import core.outer as o; o.outer(1)", cache) == "21"
    sources(root, factor=3)
    assert python(run, cache) == "31"


MAKER = """
from typing import Any, NamedTuple

class Pair(NamedTuple):
    a: Any
    b: Any
"""
SUM = """
from numba import njit

@njit(cache=True)
def total(pair):
    return pair.a + pair.b
"""


def test_kernels_whose_arguments_are_of_a_class_that_moved_are_compiled_again(tmp_path: Path) -> None:
    """numba's index of a kernel names the classes of its arguments; it cannot be read once one of them is elsewhere."""
    root, cache = sources(tmp_path / "project", factor=2), tmp_path / "cache"
    (root / "core" / "sum.py").write_text(SUM)
    (root / "core" / "here.py").write_text(MAKER)
    run = KEYED.format(root=str(root)) + f"import sys\nsys.path.insert(0, {str(root)!r})\nfrom core.sum import total\n"
    assert python(run + "from core.here import Pair; print(total(Pair(1, 2)))", cache) == "3"
    (root / "core" / "here.py").rename(root / "core" / "there.py")
    assert python(run + "from core.there import Pair; print(total(Pair(1, 2)))", cache) == "3"


def test_an_import_from_a_package_is_part_of_the_closure(tmp_path: Path) -> None:
    root = sources(tmp_path / "project", factor=2)
    (root / "core" / "types").mkdir()
    (root / "core" / "types" / "__init__.py").write_text("from .inputs import FAR")
    (root / "core" / "types" / "inputs.py").write_text("FAR = 1\n")
    (root / "core" / "outer.py").write_text("from .types import FAR\n")
    before = import_closures(root)
    (root / "core" / "types" / "inputs.py").write_text("FAR = 2\n")
    changed = {name for name, key in import_closures(root).items() if before[name] != key}
    assert changed == {"core.types.inputs", "core.types", "core.outer"}


def compiled(cache: Path) -> set[Path]:
    return set(cache.rglob("*.nbc"))


def test_a_second_installation_uses_the_kernels_of_the_first(small_core: Path, tmp_path: Path) -> None:
    """Neither the path nor the time of the sources is part of what numba compares."""
    cache, second = shutil.copytree(small_core / "cache", tmp_path / "cache"), sources(tmp_path / "second", factor=2)
    for file in second.rglob("*.py"):
        os.utime(file, (1_000_000_000, 1_000_000_000))
    kernels = {f: f.stat().st_mtime_ns for f in compiled(cache)}
    assert run(second, cache) == "21"
    assert kernels
    assert {f: f.stat().st_mtime_ns for f in compiled(cache)} == kernels


@pytest.fixture
def shipped(base: Path, small_core: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The directory of an installation with all kernels of the small core in `project`."""
    root = shutil.copytree(small_core / "project", tmp_path / "project")
    shutil.copytree(small_core / "cache", tmp_path / "shared")
    add_groups(state_of(root, tmp_path / "shared"), ["extractor"])
    monkeypatch.setattr(jit_cache, "ROOT", root)
    monkeypatch.setattr(jit_cache, "SHARED", tmp_path / "shared")
    return state_of(root, tmp_path / "shared")


def test_kernels_of_the_installation_are_taken_over(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is computed either: the import closures take a second on a fast computer."""
    monkeypatch.setattr(jit_cache, "import_closures", lambda root: pytest.fail("computed"))
    folder = use_own_cache()
    assert folder is not None
    assert kernels(folder) == kernels(shipped) == {"inner.inner", "outer.outer"}
    assert read_manifest(folder) == read_manifest(shipped)
    assert not any(file.is_symlink() for file in compiled(folder))
    assert compiled(folder)


def test_kernels_of_an_installation_that_lacks_some_are_not_taken_over(shipped: Path) -> None:
    """As after an interrupted installation: the directory would be complete in name only."""
    manifest = read_manifest(shipped)
    assert manifest is not None
    write_manifest(shipped, Manifest(manifest.closures, (), manifest.files))
    folder = use_own_cache()
    assert folder is not None
    assert kernels(folder) == set()


def test_a_directory_that_exists_is_whole(shipped: Path, base: Path) -> None:
    """A start that was killed while it copied, as by systemd, leaves none; the next one copies all and deletes what was
    left."""
    code = f"""
import os, shutil
jit_cache.SHARED = Path({str(shipped.parent)!r})
copies = []
def copy(file, place):
    copies.append(file)
    os.link(file, place) if len(copies) < 3 else os.kill(os.getpid(), 9)
shutil.copy2 = copy
"""
    text = KEYED.format(root=str(jit_cache.ROOT)).replace("assert", code + "assert")
    with pytest.raises(AssertionError):  # ended by the signal
        python(text, base)
    left = [f for f in base.glob("osape-companion-kernels-*") if len(list(f.rglob("*.nb?"))) == 2]
    assert len(left) == 1
    assert not (base / shipped.name).exists()
    folder = use_own_cache()
    assert folder is not None
    assert len(kernels(folder)) == 2
    assert not left[0].exists()


def test_of_two_starts_the_later_one_uses_the_directory_of_the_earlier(
    shipped: Path, base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = shutil.copy2

    def copy_late(file: Path, place: Path) -> None:
        (base / shipped.name / "of-the-earlier").mkdir(parents=True, exist_ok=True)
        copy(file, place)

    monkeypatch.setattr(shutil, "copy2", copy_late)
    assert use_own_cache() == base / shipped.name
    assert [f.name for f in (base / shipped.name).iterdir() if f.is_dir()] == ["of-the-earlier"]
    assert [f.name for f in base.iterdir()] == [shipped.name]


def test_the_kernels_of_a_module_are_of_one_directory(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """numba writes the index of a kernel first, and ends on a full disk before its code. It takes any code of that name:
    that of other arguments, if the two directories were filled in another order."""
    root = sources(tmp_path / "project", factor=2)
    monkeypatch.setattr(jit_cache, "ROOT", root)
    module = f"core.inner-{import_closures(root)['core.inner'][0]}"
    made(base, 60, 30)
    older, newer = base / f"kernels-{60:016x}" / module, base / f"kernels-{30:016x}" / module
    for folder, names in ((older, ("f.nbi", "f.1.nbc")), (newer, ("f.nbi",))):
        folder.mkdir()
        for name in names:
            (folder / name).write_text(str(folder))
        os.utime(folder.parent, (1_000_000_000, 1_000_000_000 + (folder == newer)))
    state = use_own_cache()
    assert state is not None
    assert {f.name: f.read_text() for f in (state / module).iterdir()} == {"f.nbi": str(newer)}


@pytest.fixture
def earlier(base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a module in the directory of an older state, with a kernel that is in its manifest."""
    root = sources(tmp_path / "project", factor=2)
    monkeypatch.setattr(jit_cache, "ROOT", root)
    folder = base / f"kernels-{60:016x}" / f"core.inner-{import_closures(root)['core.inner'][0]}"
    folder.mkdir(parents=True)
    written_by_numba(folder, "first")
    add_groups(folder.parent, ["extractor"])
    return folder


def written_by_numba(folder: Path, content: str) -> None:
    """numba replaces its files, first the index."""
    for name in ("f.nbi", "f.1.nbc"):
        (folder / "new").write_text(content)
        (folder / "new").replace(folder / name)


def test_kernels_that_another_process_adds_during_a_start_are_not_taken_for_damaged(
    earlier: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It enters its kernels in the manifest after the others were linked, which are of other times and contents."""
    link = os.link

    def link_early(file: Path, place: Path) -> None:
        link(file, place)
        if file.name == "f.nbi":
            written_by_numba(earlier, "second")
            add_groups(earlier.parent, ["extractor"])

    monkeypatch.setattr(os, "link", link_early)
    state = use_own_cache()
    assert state is not None
    assert discard_damaged(state) == 0
    assert {f.read_text() for f in (state / earlier.name).iterdir()} == {"first"}


@pytest.mark.parametrize("of_the_installation", [False, True])
def test_kernels_that_another_process_deletes_and_compiles_again_are_not_mixed(
    earlier: Path, of_the_installation: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a deletion numba numbers its files of code anew: the new index would name the old code, which is that of other
    arguments."""
    if of_the_installation:
        source = tmp_path / "shared" / f"kernels-{source_key(jit_cache.ROOT)}" / earlier.name
        shutil.copytree(earlier.parent, source.parent)
        monkeypatch.setattr(jit_cache, "SHARED", source.parents[1])
        module, name = shutil, "copy2"
    else:
        source, module, name = earlier, os, "link"
    place = getattr(module, name)
    other = threading.Thread(target=lambda: (delete_kernels(source.parent), written_by_numba(source, "new")))

    def place_slowly(file: Path, target: Path) -> None:
        place(file, target)
        if not other.ident:
            other.start()
            other.join(0.5)  # if it waits for this start, it ends later

    monkeypatch.setattr(module, name, place_slowly)
    state = use_own_cache()
    other.join()
    assert state is not None
    assert {f.read_text() for f in (state / source.name).iterdir()} == {"first"}
    assert {f.read_text() for f in source.iterdir()} == {"new"}


def test_a_file_that_is_changed_while_a_process_starts_has_other_kernels(
    base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = sources(tmp_path / "project", factor=2)
    monkeypatch.setattr(jit_cache, "ROOT", root)
    state = use_own_cache()
    assert state is not None
    closures = import_closures(root)
    assert kernel_folder(root / "core" / "outer.py", state) == f"core.outer-{closures['core.outer'][0]}"
    sources(root, factor=3)
    assert kernel_folder(root / "core" / "inner.py", state) not in {
        f"core.inner-{closure['core.inner'][0]}" for closure in (closures, import_closures(root))
    }


@pytest.mark.parametrize("variable", CODE_OPTIONS)
def test_options_of_the_compiler_have_kernels_of_their_own(
    tmp_path: Path, variable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = sources(tmp_path, factor=2)
    monkeypatch.delenv(variable, raising=False)
    before, closures = source_key(root), import_closures(root)
    monkeypatch.setenv(variable, "1")
    assert source_key(root) != before
    assert not set(import_closures(root).values()) & set(closures.values())


def test_every_kernel_module_has_an_import_closure() -> None:
    closures = import_closures(jit_cache.ROOT)
    assert {"core.stages.free_space", "core.extractor", "drivers.simulation.ray_caster"} <= closures.keys()
    assert len(set(closures.values())) == len(closures)


@pytest.mark.parametrize(
    "changed", ["core/outer.py", "core/inner.py", "drivers/simulation/ray_caster.py", "core/new.py"]
)
def test_the_key_changes_with_every_source(tmp_path: Path, changed: str) -> None:
    root = sources(tmp_path, factor=2)
    before = source_key(root)
    assert source_key(root) == before
    with (root / changed).open("a") as file:
        file.write("\n")
    assert source_key(root) != before


def test_a_child_shares_its_parents_directory(base: Path) -> None:
    folder = use_own_cache()
    assert folder == base / f"kernels-{source_key(jit_cache.ROOT)}"
    assert os.environ[VARIABLE] == str(folder)
    assert use_own_cache() == folder
    assert base_of(folder) == base == base_of(base)


def test_nothing_is_changed_once_numba_is_loaded(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", sys)
    assert use_own_cache() is None
    assert os.environ[VARIABLE] == str(base)


EARLIER = """
import time
from numba.core.caching import IndexDataCacheFile
save_index, later = IndexDataCacheFile._save_index, Path({folder!r}, "later")
def goes_on(index):  # the later one has replaced the index, or waits for the lock
    waiting = f"-> FLOCK  ADVISORY  WRITE {{later.read_text()}} " if later.exists() else "not started"
    return Path(index).exists() or any(waiting in line for line in open("/proc/locks"))
def save(file, overloads):
    Path({folder!r}, "read").touch()
    while "outer" in file._index_name and not goes_on(file._index_path):
        time.sleep(0.01)
    save_index(file, overloads)
IndexDataCacheFile._save_index = save
"""
LATER = """
import os
import time
from numba.core.caching import IndexDataCacheFile
save_data = IndexDataCacheFile._save_data
def save(file, name, data):
    while "outer" in file._index_name and not Path({folder!r}, "saved").exists():
        time.sleep(0.01)
    save_data(file, name, data)
IndexDataCacheFile._save_data = save
Path({folder!r}, "later").write_text(str(os.getpid()))
"""


def test_of_two_processes_that_save_a_kernel_each_finds_its_own_code(tmp_path: Path) -> None:
    """Both compile it at the same time, for different arguments. numba's index named the code for one as that for the
    other."""
    cache, values = tmp_path / "cache", {"root": str(sources(tmp_path / "project", factor=2)), "folder": str(tmp_path)}
    keyed, whole = KEYED.format(**values), RUN.format(**values)
    half = whole.replace("outer(10)", "outer(1.5)")
    with ThreadPoolExecutor() as threads:
        saved = "Path({folder!r}, 'saved').touch()".format(**values)
        earlier = threads.submit(python, keyed + EARLIER.format(**values) + whole + saved, cache)
        while not (tmp_path / "read").exists() and not earlier.done():
            time.sleep(0.01)
        later = threads.submit(python, keyed + LATER.format(**values) + half, cache)
        assert earlier.result() == "21"
        assert later.result() == "4.0"
    hits = "print(sum(outer.stats.cache_hits.values()))"
    assert python(keyed + whole + hits, cache) == "21\n1"
    assert python(keyed + half + hits, cache) == "4.0\n1"


def made(base: Path, *ages: int) -> list[Path]:
    """Directories of old states, last used so many seconds ago."""
    folders = [base / f"kernels-{age:016x}" for age in ages]
    for folder, age in zip(folders, ages, strict=True):
        (folder / "core").mkdir(parents=True)
        (folder / "core" / "kernel.nbi").write_text("")
        (folder / "in-use").write_text("")
        os.utime(folder, (1_000_000_000 - age, 1_000_000_000 - age))
    return folders


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


@pytest.mark.parametrize("complete", [True, False])
def test_on_a_full_disk_the_kernels_of_the_installation_are_used(
    shipped: Path, base: Path, tmp_path: Path, complete: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the first start after an update they could not be copied, and the service did not start."""

    def refuse(file: Path, place: Path) -> None:
        place.write_bytes(file.read_bytes()[:10])
        raise OSError(errno.ENOSPC, "No space left on device", str(place))

    if not complete:
        write_manifest(shipped, Manifest())
    monkeypatch.setattr(shutil, "copy2", refuse)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "full"))
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    folder = use_own_cache()
    assert folder is not None
    if complete:
        assert folder.parents[1] == tmp_path / "run"
        assert {file.resolve() for file in compiled(folder)} == compiled(shipped)
        assert list(base.iterdir()) == []  # the space is needed
    else:
        assert folder == base / shipped.name


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


ANOTHER_USER = 12345
GiveTo = Callable[[int, Path], None]


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


@pytest.mark.parametrize("owner_of_base", [0, ANOTHER_USER])
def test_no_kernels_are_taken_over_from_another_user(shipped: Path, give_to: GiveTo, owner_of_base: int) -> None:
    """Except where the whole cache is that user's, which NUMBA_CACHE_DIR then names."""
    for folder, owner in ((shipped.parent, owner_of_base), (shipped, ANOTHER_USER)):
        give_to(owner, folder)
    folder = use_own_cache()
    assert folder is not None
    assert kernels(folder) == ({"inner.inner", "outer.outer"} if owner_of_base else set())


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

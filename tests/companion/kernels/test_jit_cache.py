"""Compiled kernels never outlive the sources that they were made of, also where only a called one's file changed."""

from __future__ import annotations

import errno
import os
import shutil
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import companion.kernels.jit_cache as jit_cache
from companion.kernels.jit_cache import VARIABLE, kernel_folder, use_own_cache
from companion.kernels.manifest import (
    Manifest,
    add_groups,
    discard_damaged,
    read_manifest,
    write_manifest,
)
from companion.kernels.module_folder import delete_kernels
from companion.kernels.source_state import CODE_OPTIONS, import_closures, source_key
from companion.kernels.state_folders import base_of

from ..small_core import CALLER, KEYED, RUN, compiled, kernels, made, python, run, sources, state_of
from .conftest import GiveTo

pytestmark = pytest.mark.process
ANOTHER_USER = 12345


def test_every_module_of_the_service_has_it(tmp_path: Path) -> None:
    printed = python("import companion.pipeline.pipeline, numba; print(numba.config.CACHE_DIR)", tmp_path, new=True)
    assert Path(printed) == tmp_path / f"kernels-{source_key(jit_cache.ROOT)}"
    assert python("import companion.cli, sys; print('numba' in sys.modules)", tmp_path) == "False"


def test_a_change_in_a_called_kernel_is_noticed(small_core: Path, tmp_path: Path) -> None:
    """By numba alone it is not: test_numba_itself.py."""
    root = shutil.copytree(small_core / "project", tmp_path / "project")
    cache = shutil.copytree(small_core / "cache", tmp_path / "keyed")
    sources(root, factor=3)
    assert run(root, cache) == "31"
    assert len(list(cache.iterdir())) == 2 + 1  # two states of these sources, one of the service's own


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
    base: Path,
    small_core: Path,
    tmp_path: Path,
    changed: str,
    added: str,
    kept: set[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shutil.copytree(small_core, tmp_path, dirs_exist_ok=True)
    root = tmp_path / "project"
    with (root / changed).open("a") as file:
        file.write(added)
    monkeypatch.setattr(jit_cache, "ROOT", root)
    folder = use_own_cache()
    assert folder == state_of(root, base)
    assert kernels(folder) == kept


def test_a_kernel_that_changed_is_compiled_beside_those_that_did_not(small_core: Path, tmp_path: Path) -> None:
    shutil.copytree(small_core, tmp_path, dirs_exist_ok=True)
    outer = tmp_path / "project" / "core" / "outer.py"
    outer.write_text(outer.read_text().replace("+ 1", "+ 2"))
    assert run(tmp_path / "project", tmp_path / "cache") == "22"


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
    before = import_closures(root)
    sources(root, factor=3)
    changed = {name for name, key in import_closures(root).items() if before[name] != key}
    assert changed == {"core.inner", "core.world.outer"}


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


@pytest.mark.parametrize("owner_of_base", [0, ANOTHER_USER])
def test_no_kernels_are_taken_over_from_another_user(shipped: Path, give_to: GiveTo, owner_of_base: int) -> None:
    """Except where the whole cache is that user's, which NUMBA_CACHE_DIR then names."""
    for folder, owner in ((shipped.parent, owner_of_base), (shipped, ANOTHER_USER)):
        give_to(owner, folder)
    folder = use_own_cache()
    assert folder is not None
    assert kernels(folder) == ({"inner.inner", "outer.outer"} if owner_of_base else set())

"""`companion warmup`: a damaged cache is mended, a cache that cannot be written is named.

Only the module's own handling is run here, with a small kernel in place of all of them: compiling everything from
nothing takes too long for a test, and is what the first run of `make demo` does."""

from __future__ import annotations

import fcntl
import gc
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion.kernels.child_process as child_process
import companion.kernels.loading as loading
import companion.kernels.warmup as warmup
from companion.cli import main
from companion.kernels.jit_cache import COMPLETE
from companion.kernels.processor import processor
from companion.kernels.progress import CompiledCount, Report

pytestmark = pytest.mark.process

SUCCESS = subprocess.CompletedProcess[str]([], 0, "", "")
KERNEL = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x
"""


COMPILE = "from small_kernel import twice; assert twice(3) == 6"


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small kernel and, in `cache`, what the command makes of it."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "small_kernel.py").write_text(KERNEL)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(folder / "cache"))
        patch.setenv("PYTHONPATH", str(folder))
        patch.delenv("NUMBA_DISABLE_JIT", raising=False)
        patch.setattr(warmup, "CHILD", COMPILE)
        warmup.warm_up()
    return folder


@pytest.fixture
def small(tmp_path: Path, compiled_once: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The place of a cache of its own that does not exist yet; a child compiles the small kernel alone."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    monkeypatch.setenv("PYTHONPATH", str(compiled_once))
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setattr(warmup, "CHILD", COMPILE)
    return cache


@pytest.fixture
def filled(small: Path, compiled_once: Path) -> Path:
    """The same with the kernel in it, as the command left it."""
    shutil.copytree(compiled_once / "cache", small)
    return small


def test_compiles_once(small: Path) -> None:
    first = warmup.warm_up()
    assert (first.deleted, first.cached) == (0, 2)
    stamps = {f: f.stat().st_mtime_ns for f in small.rglob("*.nb?")}
    assert warmup.warm_up() == first
    assert {f: f.stat().st_mtime_ns for f in small.rglob("*.nb?")} == stamps


@pytest.mark.parametrize("kept", [0, 7, 100])
@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_a_truncated_cache_is_mended(filled: Path, kind: str, kept: int) -> None:
    (file,) = filled.rglob(kind)
    file.write_bytes(file.read_bytes()[:kept])
    foreign = filled / "notes.txt"
    foreign.write_text("not ours")
    mended = warmup.warm_up()
    assert (mended.deleted, mended.cached) == (2, 2)
    assert foreign.exists()
    assert warmup.warm_up().deleted == 0


def test_a_fault_that_no_deletion_repairs_is_reported(
    filled: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warmup, "CHILD", "raise MemoryError('no memory for kernels')")
    assert main(["warmup"]) == 1
    output = capsys.readouterr().err
    assert "even after 2 cached files were deleted" in output
    assert "no memory for kernels" in output


def test_a_killed_child_is_reported(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "CHILD", "import os; os.abort()")
    with pytest.raises(warmup.WarmupError, match="ended by signal 6"):
        warmup.warm_up()


def test_a_cache_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert main(["warmup"]) == 1
    output = capsys.readouterr().err
    assert f"NUMBA_CACHE_DIR = {tmp_path / 'file' / 'cache'} cannot be written" in output
    assert "unset it" in output


def test_kernels_of_other_software_are_not_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba was imported before this software, kernels are in numba's own cache, which all of a user's software shares."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(warmup, "CHILD", "raise MemoryError('no memory for kernels')")
    foreign = tmp_path / "numba" / "their_project" / "kernel.nbi"
    foreign.parent.mkdir(parents=True)
    foreign.write_text("")
    with pytest.raises(warmup.WarmupError, match="import companion before numba"):
        warmup.warm_up()
    assert foreign.exists()


def test_all_kernels_run() -> None:
    """On the frames that the command uses, of both kinds and in both modes."""
    warmup.run_kernels()


NEEDED_LATER = """
import sys
from pathlib import Path
import companion.kernels.warmup as warmup
from companion.config.loader import Config
from companion.replay.replay import make_pipeline, process
from companion.replay.summary import ReplayCounts
from drivers.logs.reader import McapRecording
from numba.core.dispatcher import Dispatcher

def loaded():
    modules = [m for name, m in sys.modules.items() if name.startswith("core.")]
    kernels = {k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)}
    return {f"{k.py_func.__name__}{types}" for k in kernels for types in k.overloads}

warmup.run_kernels(("extractor",), metres=False)
before = loaded()
for path in sorted(Path(sys.argv[1]).glob("*.mcap")):
    with McapRecording(path) as recording:
        for _ in process(recording.events(), make_pipeline(Config(), recording.cameras), ReplayCounts()):
            pass
print(len(before), sorted(loaded() - before))
"""


def test_no_kernel_is_first_needed_in_flight() -> None:
    """Streets, trees, noise, tilted and broken cameras: compiling one on board would take a blind second."""
    data = Path(__file__).resolve().parents[1] / "data"
    command = [sys.executable, "-c", NEEDED_LATER, str(data)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    count, later = done.stdout.split(maxsplit=1)
    assert int(count) > 15
    assert later.strip() == "[]"


CALLED = """
import importlib, inspect, pkgutil, types
import core
import companion.kernels.warmup as warmup
from numba.core.dispatcher import Dispatcher

def functions(owner, module):
    for value in vars(owner).values():
        value = getattr(value, "__func__", getattr(value, "fget", value))
        if getattr(value, "__module__", "") != module.__name__:
            continue
        if inspect.isclass(value):
            yield from functions(value, module)
        elif isinstance(value, types.FunctionType):
            yield value

def calls(code, names):
    called = [names.get(name) for name in code.co_names]
    within = [vars(m).get(name) for m in called if isinstance(m, types.ModuleType) for name in code.co_names]
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            yield from calls(part, names)
    yield from (kernel for kernel in (*called, *within) if isinstance(kernel, Dispatcher))

modules = [importlib.import_module(m.name) for m in pkgutil.walk_packages(core.__path__, "core.")]
kernels = {k for m in modules for f in functions(m, m) for k in calls(f.__code__, vars(m))}
warmup.run_kernels()
print(len(kernels), sorted(k.py_func.__name__ for k in kernels if not k.overloads))
"""


def test_every_kernel_that_python_calls_is_run_for_any_parameters() -> None:
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True)
    count, never = done.stdout.split(maxsplit=1)
    assert int(count) > 25
    assert never.strip() == "[]"


# ---- the start of the service -------------------------------------------------------------------------------------

DIES_WHILE_LOADING = """
import os
import companion.kernels.loading as loading
import companion.kernels.warmup as warmup
warmup.CHILD = "raise SystemExit(1)"
loading.run_kernels = lambda modes, metres: os._exit(9)
loading.make_ready("extractor")
"""

ENDS_WHILE_LOADING = """
import sys, threading, time
import companion.kernels.loading as loading
import companion.kernels.warmup as warmup
begun = threading.Event()
warmup.CHILD = "raise SystemExit(1)"
loading.run_kernels = lambda modes, metres: (begun.set(), time.sleep(60))
threading.Thread(target=loading.make_ready, args=("extractor",), daemon=True).start()
begun.wait()
sys.exit(1)
"""


@pytest.fixture
def ready(small: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[str, ...]]]:
    """What make_ready would run, recorded and not run; objects are the collector's again at the end."""
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(loading, "run_kernels", lambda modes, metres: ran.append(tuple(modes)))
    yield ran
    gc.unfreeze()


def test_a_start_loads_the_mode_that_is_asked_for(small: Path, ready: list[tuple[str, ...]]) -> None:
    small.mkdir()
    loading.make_ready("world")
    assert ready == [("world",)]
    assert gc.get_freeze_count() > 0
    assert not (small / loading.MARK).exists()


def test_what_was_never_compiled_is_compiled_by_a_child_once(
    small: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service would keep the gigabyte that compiling takes."""
    run = "import sys; open(sys.argv[1] + '.ran', 'a').write('x'); from small_kernel import twice; twice(3)"
    monkeypatch.setattr(warmup, "CHILD", run)
    monkeypatch.chdir(small.parent)
    small.mkdir()
    for _ in range(2):
        loading.make_ready("extractor")
        assert (small.parent / "extractor.ran").read_text() == "x"
        assert len(list(small.rglob("*.nbc"))) == 1
    loading.make_ready("world")  # another mode has kernels of its own
    assert (small.parent / "world.ran").read_text() == "x"
    assert ready == [("extractor",), ("extractor",), ("world",)]


def test_a_child_that_cannot_compile_is_asked_again_and_the_service_tries_itself(
    small: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warmup, "CHILD", "raise SystemExit(3)")
    small.mkdir()
    loading.make_ready("extractor")
    assert ready == [("extractor",)]
    assert not list(small.glob(COMPLETE + "*"))


def test_after_the_command_a_start_needs_no_child(
    filled: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warmup, "_child", lambda *modes, report: pytest.fail("a child was started"))
    loading.make_ready("extractor")
    assert ready == [("extractor",)]


def test_kernels_of_another_processor_are_compiled_again(
    filled: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that was moved to another computer: the mark must not hide that numba compiles."""
    for mark in filled.glob(COMPLETE + "*"):
        mark.write_text("cortex-a53 +neon")
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(warmup, "_child", lambda *modes, report: asked.append(modes) or SUCCESS)
    for _ in range(2):
        loading.make_ready("extractor")
    assert asked == [("extractor",)]


def test_of_two_processes_one_compiles(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small.mkdir()
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(warmup, "_child", lambda *modes, report: asked.append(modes) or SUCCESS)
    monkeypatch.setattr(warmup, "POLL_S", 0.01)
    with (small / warmup.LOCK).open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        waiting = threading.Thread(target=warmup.ensure_compiled, args=("extractor",))
        waiting.start()
        waiting.join(0.1)
        assert waiting.is_alive()
        assert asked == []
        (small / (COMPLETE + "extractor")).write_text(processor())  # the other one has finished
    waiting.join()
    assert asked == []
    assert "compiling kernels 0 of" in capsys.readouterr().err  # the one that waits does not look hung


def test_progress_is_shown_while_a_child_compiles(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small.mkdir()
    monkeypatch.setattr(child_process, "POLL_S", 0.01)
    writes = "import sys, time; open(sys.argv[1], 'w'); time.sleep(0.5)"
    kernel = small / "core.stages" / "level.pool_columns-1.py311.nbi"
    kernel.parent.mkdir()
    total = CompiledCount(small, ("extractor",)).total
    monkeypatch.setattr(warmup, "CHILD", writes.replace("sys.argv[1]", repr(str(kernel))))
    warmup.ensure_compiled("extractor")
    assert capsys.readouterr().err == f"compiling kernels 1 of {total}, once for this version\n"
    warmup.ensure_compiled("extractor")
    assert capsys.readouterr().err == ""


def test_a_child_that_progresses_is_not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy computer all kernels took more than 20 minutes."""
    monkeypatch.setattr(child_process, "POLL_S", 0.01)
    children = child_process.Children()
    assert children.run(["sleep", "0.3"], 0.1, lambda: True).returncode == 0
    with pytest.raises(subprocess.TimeoutExpired):
        children.run(["sleep", "0.3"], 0.1, lambda: False)


def test_every_group_has_its_kernels() -> None:
    counts = [CompiledCount(Path("none"), (mode,)).total for mode in warmup.MODES]
    assert min(counts) > 0  # sharing has only four
    assert sum(counts) == CompiledCount(Path("none"), warmup.MODES).total


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_kernels_that_cannot_be_loaded_end_the_start(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(mode: str, report: Report) -> None:
        raise SystemExit  # a thread's end without a word on stderr

    monkeypatch.setattr(loading, "make_ready", refuse)
    thread = loading.Loading("extractor")
    thread.start()
    with pytest.raises(warmup.WarmupError, match="companion warmup"):
        thread.finish()


def test_after_a_death_while_loading_a_damaged_cache_is_mended(
    filled: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise each new start would end the same way."""
    environment = {**os.environ, "PYTHONPATH": str(Path(warmup.__file__).parents[2])}
    died = subprocess.run([sys.executable, "-c", DIES_WHILE_LOADING], env=environment, check=False)
    assert died.returncode == 9
    (mark,) = filled.rglob(loading.MARK)
    mark.rename(filled / loading.MARK)  # that process had a folder of its own below, for the state of its sources
    (file,) = filled.rglob("*.nbc")
    file.write_bytes(b"")
    loading.make_ready("extractor")
    assert ready == [("extractor",)]
    (mended,) = filled.rglob("*.nbc")
    assert mended.stat().st_size > 0
    assert not (filled / loading.MARK).exists()


def test_a_start_that_fails_while_kernels_are_loaded_leaves_no_mark(filled: Path) -> None:
    """The next start would check all kernels in a child process before it loads them."""
    environment = {**os.environ, "PYTHONPATH": str(Path(warmup.__file__).parents[2])}
    ended = subprocess.run([sys.executable, "-c", ENDS_WHILE_LOADING], env=environment, check=False)
    assert ended.returncode == 1
    assert list(filled.rglob(loading.MARK)) == []


def test_where_the_cache_cannot_be_written_a_start_goes_on(
    tmp_path: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none" / "cache"))
    loading.make_ready("extractor")
    assert ready == [("extractor",)]

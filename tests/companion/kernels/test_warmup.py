"""`companion warmup`: a damaged cache is mended, a cache that cannot be written is named.

Only the module's own handling is run here, with a small kernel in place of all of them: compiling everything from
nothing takes too long for a test, and is what the first run of `make demo` does."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from signal import SIGHUP, SIGINT, SIGKILL, SIGTERM

import pytest

import companion.kernels.compilation as compilation
import companion.kernels.loading as loading
import companion.kernels.warmup as warmup
from companion.cli import main
from companion.kernels.manifest import Manifest, add_groups, discard_damaged, missing_groups, write_manifest
from companion.kernels.module_folder import kernels_in
from companion.kernels.progress import CompiledCount, Report, progress_text
from companion.kernels.run_kernels import GROUPS, run_kernels
from tests.waiting import until

pytestmark = pytest.mark.process

STATE = "kernels-0123456789abcdef"
KERNEL = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x
"""


COMPILE = "from small_kernel import twice; assert twice(3) == 6"

WAIT = "import os, time\nfor _ in range(6000): os.path.exists({place!r}) or time.sleep(0.01)"
"""Waits until a file exists; not for ever: with a defect its test would not end."""


def use_small_kernel(folder: Path, cache: Path, patch: pytest.MonkeyPatch) -> Path:
    """Makes the empty directory of a state in a cache, for a child that compiles the small kernel of a folder alone."""
    state = cache / STATE
    state.mkdir(parents=True)
    write_manifest(state, Manifest())
    patch.setenv("NUMBA_CACHE_DIR", str(state))
    patch.setenv("PYTHONPATH", str(folder))
    patch.delenv("NUMBA_DISABLE_JIT", raising=False)
    patch.setattr(compilation, "CHILD", COMPILE)
    return state


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small kernel and, in `cache`, what the command makes of it."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "small_kernel.py").write_text(KERNEL)
    with pytest.MonkeyPatch.context() as patch:
        use_small_kernel(folder, folder / "cache", patch)
        warmup.warm_up()
    return folder


@pytest.fixture
def small(tmp_path: Path, compiled_once: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty directory of kernels of its own; a child compiles the small kernel alone."""
    return use_small_kernel(compiled_once, tmp_path / "cache", monkeypatch)


@pytest.fixture
def filled(small: Path, compiled_once: Path) -> Path:
    """The same with the kernel in it, as the command left it."""
    shutil.rmtree(small)
    shutil.copytree(compiled_once / "cache" / STATE, small)
    return small


def test_compiles_once(small: Path) -> None:
    assert warmup.warm_up() == (small, 0)
    stamps = {f: f.stat().st_mtime_ns for f in kernels_in(small)}
    assert len(stamps) == 2
    assert missing_groups(small, GROUPS) == []
    assert warmup.warm_up() == (small, 0)
    assert {f: f.stat().st_mtime_ns for f in kernels_in(small)} == stamps


@pytest.mark.parametrize(("kind", "kept"), [("*.nbi", 7), ("*.nbc", 100)])
def test_a_truncated_cache_is_mended(filled: Path, kind: str, kept: int) -> None:
    (file,) = filled.rglob(kind)
    file.write_bytes(file.read_bytes()[:kept])
    foreign = filled / "notes.txt"
    foreign.write_text("not ours")
    assert warmup.warm_up() == (filled, 2)
    assert len(kernels_in(filled)) == 2
    assert foreign.exists()
    assert discard_damaged(filled) == 0


def test_a_fault_that_no_deletion_repairs_is_reported(
    filled: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compilation, "CHILD", "raise MemoryError('no memory for kernels')")
    assert main(["warmup"]) == 1
    output = capsys.readouterr().err
    assert "even after 2 cached files were deleted" in output
    assert "no memory for kernels" in output


def test_a_killed_child_is_reported(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "CHILD", "import os; os.abort()")
    with pytest.raises(compilation.WarmupError, match="ended by signal 6"):
        warmup.warm_up()


ENDED = "import os, signal; {number} == 9 or signal.signal({number}, signal.SIG_DFL); os.kill(os.getpid(), {number})"
"""A child that is ended by a signal, also where the test runs in the background and ignores it."""


@pytest.mark.parametrize(
    "failure",
    [
        "raise OSError(28, 'No space left on device')",
        *(ENDED.format(number=int(number)) for number in (SIGKILL, SIGINT, SIGTERM, SIGHUP)),
    ],
)
def test_kernels_stay_where_the_disk_is_full_or_the_child_is_ended(
    filled: Path, failure: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are whole; without them each further start would begin anew and end the same way."""
    monkeypatch.setattr(compilation, "CHILD", failure)
    with pytest.raises(compilation.WarmupError) as raised:
        warmup.warm_up()
    assert len(kernels_in(filled)) == 2
    assert ("free 200 MB" in str(raised.value)) == ("space" in failure)


def test_kernels_of_other_software_are_not_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba was imported before this software, kernels are in numba's own cache, which all of a user's software shares."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compilation, "CHILD", "raise MemoryError('no memory for kernels')")
    foreign = tmp_path / "numba" / "their_project" / "kernel.nbi"
    foreign.parent.mkdir(parents=True)
    foreign.write_text("")
    with pytest.raises(compilation.WarmupError, match="import companion before numba"):
        warmup.warm_up()
    assert foreign.exists()


def test_all_kernels_run() -> None:
    """On the frames that the command uses, of both kinds and in both modes."""
    run_kernels()


NEEDED_LATER = """
import sys
from pathlib import Path
from companion.kernels.run_kernels import run_kernels
from companion.config.loader import Config
from companion.pipeline.configured import make_pipeline
from companion.replay.replay import process
from companion.replay.summary import ReplayCounts
from drivers.logs.reader import McapRecording
from numba.core.dispatcher import Dispatcher

def loaded():
    modules = [m for name, m in sys.modules.items() if name.startswith("core.")]
    kernels = {k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)}
    return {f"{k.py_func.__name__}{types}" for k in kernels for types in k.overloads}

run_kernels(("extractor",))
before = loaded()
for path in sorted(Path(sys.argv[1]).glob("*.mcap")):
    with McapRecording(path) as recording:
        for _ in process(recording.events(), make_pipeline(Config(), recording.cameras), ReplayCounts()):
            pass
print(len(before), sorted(loaded() - before))
"""


def test_no_kernel_is_first_needed_in_flight() -> None:
    """Streets, trees, noise, tilted and broken cameras: compiling one on board would take a blind second."""
    data = Path(__file__).resolve().parents[2] / "data"
    command = [sys.executable, "-c", NEEDED_LATER, str(data)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    count, later = done.stdout.split(maxsplit=1)
    assert int(count) > 15
    assert later.strip() == "[]"


CALLED = """
import importlib, inspect, pkgutil, types
import core
from companion.kernels.run_kernels import run_kernels
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
run_kernels()
print(len(kernels), sorted(k.py_func.__name__ for k in kernels if not k.overloads))
"""


def test_every_kernel_that_python_calls_is_run_for_any_parameters() -> None:
    done = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True)
    count, never = done.stdout.split(maxsplit=1)
    assert int(count) > 25
    assert never.strip() == "[]"


# ---- the start of the service -------------------------------------------------------------------------------------

FAILS_WHILE_LOADING = """
import os, pickle, sys
import companion.kernels.loading as loading

def fail(groups):
    {failure}

loading.compile_kernels = lambda groups, report, check: 0
loading.run_kernels = fail
thread = loading.Loading("extractor")
thread.start()
try:
    thread.finish()
except loading.WarmupError:
    sys.exit(1)
"""


@pytest.fixture
def ready(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """What make_ready would run, recorded and not run."""
    ran: list[tuple[str, ...]] = []
    monkeypatch.setattr(loading, "run_kernels", lambda groups: ran.append(tuple(groups)))
    return ran


def without_child(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """Records for which groups a child process would be run."""
    asked: list[tuple[str, ...]] = []

    def run(folder: Path, groups: tuple[str, ...], report: Report) -> tuple[int, str]:
        asked.append(tuple(groups))
        return 0, ""

    monkeypatch.setattr(compilation, "_run_in_child", run)
    return asked


def test_a_start_loads_the_group_that_is_asked_for(small: Path, ready: list[tuple[str, ...]]) -> None:
    loading.make_ready("world")
    assert ready == [("world",)]
    assert not (small / loading.MARK).exists()


def test_a_service_compiles_the_kernels_of_the_simulated_camera_and_does_not_load_them(
    small: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = without_child(monkeypatch)
    loading.make_ready("extractor", "simulated")
    assert asked == [("extractor", "simulated")]
    assert ready == [("extractor",)]


def test_what_was_never_compiled_is_compiled_by_a_child_once(
    small: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service would keep the gigabyte that compiling takes."""
    run = "import sys; open(sys.argv[1] + '.ran', 'a').write('x'); from small_kernel import twice; twice(3)"
    monkeypatch.setattr(compilation, "CHILD", run)
    monkeypatch.chdir(small.parent)
    for _ in range(2):
        loading.make_ready("extractor")
        assert (small.parent / "extractor.ran").read_text() == "x"
        assert len(list(small.rglob("*.nbc"))) == 1
    loading.make_ready("world")  # another group has kernels of its own
    assert (small.parent / "world.ran").read_text() == "x"
    assert ready == [("extractor",), ("extractor",), ("world",)]


def test_kernels_that_do_not_run_end_the_start_with_the_cause(
    small: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compilation, "CHILD", "raise MemoryError('no memory for kernels')")
    thread = loading.Loading("extractor")
    thread.start()
    with pytest.raises(compilation.WarmupError, match="no memory for kernels"):
        thread.finish()
    assert ready == []
    assert missing_groups(small, ("extractor",)) == ["extractor"]


def test_after_the_command_a_start_needs_no_child(
    filled: Path, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = without_child(monkeypatch)
    loading.make_ready("extractor")
    assert (asked, ready) == ([], [("extractor",)])


def test_of_two_processes_one_compiles(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = without_child(monkeypatch)
    monkeypatch.setattr(compilation, "POLL_S", 0.01)
    shown: list[str] = []

    def waits() -> bool:
        shown.append(capsys.readouterr().err)
        return "compiling kernels 0 of" in "".join(shown)

    with (small / compilation.LOCK).open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        waiting = threading.Thread(target=warmup.ensure_compiled, args=("extractor",))
        waiting.start()
        assert until(waits)  # the one that waits does not look hung
        assert waiting.is_alive()
        assert asked == []
        add_groups(small, ("extractor",))  # the other one has finished
    waiting.join()
    assert asked == []


def test_progress_is_shown_while_a_child_compiles(
    small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compilation, "POLL_S", 0.01)
    count = CompiledCount(small, ("extractor",))
    folder = next(f for f in count.folders if f.name.startswith("core.stages.level-"))
    folder.mkdir()
    index = folder / "level.pool_columns-0.py311.nbi"
    counted, done = small.parent / "counted", CompiledCount.done

    def noted(count: CompiledCount) -> int:
        number = done(count)
        if number:
            counted.touch()
        return number

    monkeypatch.setattr(CompiledCount, "done", noted)
    monkeypatch.setattr(compilation, "CHILD", f"open({str(index)!r}, 'w')\n{WAIT.format(place=str(counted))}")
    warmup.ensure_compiled("extractor")
    assert capsys.readouterr().err == f"compiling kernels 1 of {count.total}, once for this version\n"
    warmup.ensure_compiled("extractor")
    assert capsys.readouterr().err == ""


def test_a_start_that_is_cancelled_does_not_wait_for_the_compiler(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = small.parent / "done"
    monkeypatch.setattr(compilation, "CHILD", WAIT.format(place=str(done)))
    thread = loading.Loading("extractor")
    thread.start()
    thread.cancel()
    with pytest.raises(compilation.WarmupError, match="shutting down"):
        thread.finish()
    assert thread.is_alive()
    done.touch()
    thread.join()


def test_ctrl_c_at_a_start_does_not_reach_the_compiler(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal sends it to all processes of a group. It would be taken for the failure of a damaged kernel."""
    place = small.parent / "group"
    monkeypatch.setattr(compilation, "CHILD", f"import os; open({str(place)!r}, 'w').write(str(os.getpgrp()))")
    compilation.compile_kernels(("extractor",), lambda done, total: None)
    assert int(place.read_text()) != os.getpgrp()


def test_every_group_has_its_kernels() -> None:
    counts = [CompiledCount(Path("none"), (group,)).total for group in GROUPS]
    assert min(counts) > 0  # sharing has only four
    assert sum(counts) == CompiledCount(Path("none"), GROUPS).total


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_kernels_that_cannot_be_loaded_end_the_start(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(group: str, report: Report) -> None:
        raise SystemExit  # a thread's end without a word on stderr

    monkeypatch.setattr(loading, "make_ready", refuse)
    thread = loading.Loading("extractor")
    thread.start()
    with pytest.raises(compilation.WarmupError, match="companion warmup"):
        thread.finish()


def run_service_start(code: str, folder: Path) -> int:
    """Runs code with a directory of kernels; returns its exit status."""
    named = f"import os, companion\nos.environ['NUMBA_CACHE_DIR'] = {str(folder)!r}\n"  # companion takes its own
    environment = {**os.environ, "PYTHONPATH": str(Path(warmup.__file__).parents[2])}
    return subprocess.run([sys.executable, "-c", named + code], env=environment, check=False).returncode


@pytest.mark.parametrize(("failure", "status"), [("os._exit(9)", 9), ("pickle.loads(b'')", 1)])
def test_after_a_failure_to_load_a_damaged_cache_is_mended(
    filled: Path, failure: str, status: int, ready: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise each new start would end the same way. Here by a kernel that no manifest contains yet."""
    (file,) = filled.rglob("*.nbc")
    write_manifest(filled, Manifest(groups=("extractor",)))
    assert run_service_start(FAILS_WHILE_LOADING.format(failure=failure), filled) == status
    file.write_bytes(b"")
    loading.make_ready("extractor")
    assert ready == [("extractor",)]
    assert file.stat().st_size > 0
    assert not (filled / loading.MARK).exists()


def test_compiled_kernels_are_not_reported_as_being_compiled() -> None:
    """A busy computer showed "compiling kernels 309 of 309" for the seconds in which it loaded them."""
    assert progress_text(308, 309).startswith("compiling kernels 308 of 309")
    assert progress_text(309, 309) == "loading kernels"

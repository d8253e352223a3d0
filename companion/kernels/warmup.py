"""`companion warmup`: compiles and caches every kernel before a flight, and repairs a damaged cache.

The kernels run in a child process: a truncated or corrupt cache file (after a power failure) can raise any exception or
end the process. The parent then deletes the cached kernels and a second child compiles them again."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import fcntl
import gc
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..console import fail, print_json, print_line, warn
from .child_process import POLL_S, CancelledError, Children, WarmupError, end_with_parent
from .jit_cache import COMPLETE, VARIABLE, base_of, is_linked_copy, unwritable_bases
from .manifest import CACHED, MANIFEST, damaged_kernels, delete_kernels, write_manifest
from .processor import processor
from .progress import LOG_EVERY_S, CompiledCount, ProgressLine, Report, progress_text
from .run_kernels import MODES, run_kernels

log = logging.getLogger("companion")

CHILD = "import sys; from companion.kernels.warmup import run_child; run_child(sys.argv[1:])"
TIMEOUT_S = 1200.0
"""Longest time without another compiled kernel. All kernels take two minutes on two idle cores, and more than 20 on a
busy computer."""
MARK = "loading"
"""A file beside the cached kernels while a service loads them."""
LOCK = "compiling"
"""A file beside the cached kernels that is locked while a process compiles them."""
COMPILED_S = 5.0
"""Loading cached kernels takes less time than this, compiling them much more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Warmup:
    """Result of `warm_up`.

    Attributes:
        cache: directories of compiled kernels; several if NUMBA_CACHE_DIR is not set.
        deleted: number of deleted files of damaged kernels.
        cached: number of present files."""

    cache: tuple[str, ...]
    deleted: int
    cached: int


def add_parser(subparsers: Any) -> None:
    """Adds the command line of `companion warmup`."""
    parser = subparsers.add_parser("warmup")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Runs `companion warmup`. Returns 0: all kernels are compiled; 1: an error."""
    try:
        done = warm_up()
    except WarmupError as error:
        fail(str(error))
        return 1
    if args.json:
        print_json({"cache": list(done.cache), "deleted": done.deleted, "cached": done.cached})
        return 0
    if done.deleted:
        print_line(f"the cache of compiled kernels was damaged: {done.deleted} files deleted, compiled again")
    print_line(f"all kernels are compiled: {done.cached} files in {', '.join(done.cache)}{_link_remark()}")
    return 0


def warm_up() -> Warmup:
    """Compiles or loads every kernel in a child process, with a line of progress. Raises WarmupError."""
    _check_cache_place()
    folders = cache_folders()
    with _progress_line() as report, _one_at_a_time(folders[0]):
        deleted = discard_damaged()
        first = _child(report=report)
        if first.returncode != 0:
            deleted += _delete(folders)
            if not deleted:
                raise WarmupError(f"the kernels do not run: {_last_line(first)}{_space_remedy(first, folders[0])}")
            second = _child(report=report)
            if second.returncode != 0:
                raise WarmupError(
                    f"the kernels do not run, even after {deleted} cached files were deleted: {_last_line(second)}"
                    f"{_space_remedy(second, folders[0])}"
                )
        _mark_complete(*MODES)
    cached = len(list(_cached_files(folders)))
    return Warmup(cache=tuple(str(f) for f in folders if f.is_dir()), deleted=deleted, cached=cached)


def _link_remark() -> str:
    return ", links to a cache that cannot be written" if is_linked_copy(cache_folders()[0]) else ""


def cache_warning(modes: Sequence[str]) -> str:
    """Returns a warning with a remedy if kernels of these groups are missing and cannot be stored, otherwise "".

    Each process would compile its own kernels then."""
    if is_linked_copy(folder := cache_folders()[0]) and (missing := _incomplete(folder, modes)):
        return (
            f"the cache of compiled kernels cannot be written and has none of {', '.join(missing)} for this processor: each "
            f"command compiles them again, which takes minutes; set {VARIABLE} to a folder that this user may write"
        )
    if not (places := unwritable_bases()):
        return ""
    return (
        f"compiled kernels cannot be stored in {' or '.join(map(str, places))}: each command compiles them again, which takes "
        f"minutes; set {VARIABLE} to a folder that this user may write"
    )


def _space_remedy(child: subprocess.CompletedProcess[str], folder: Path) -> str:
    """Returns the remedy for a full disk; "" for other failures."""
    if "No space left" not in _last_line(child):
        return ""
    return f"; the disk of {folder} is full: free 200 MB, or set {VARIABLE} to a folder on another disk"


def ensure_compiled(*modes: str) -> None:
    """Compiles the missing kernels of these groups in a child process, with a line of progress on stderr.

    Returns at once if all are compiled. Raises WarmupError."""
    if warning := cache_warning(modes):
        warn(warning)
    if named := os.environ.get(VARIABLE):
        discard_damaged()
        with _progress_line() as report:
            _compile_missing(Path(named), modes, report)


@contextlib.contextmanager
def _progress_line() -> Iterator[Report]:
    line = ProgressLine()
    try:
        yield line
    finally:
        line.end()


def _compile_missing(folder: Path, modes: Sequence[str], report: Report) -> bool:
    """Compiles missing kernels; returns True if there were any.

    If the child fails, they stay missing: they are compiled at their first use, which shows the error."""
    if not _incomplete(folder, modes):
        return False
    count = CompiledCount(folder, modes)
    with _one_at_a_time(folder, lambda: report(count.done(), count.total)):
        missing = _incomplete(folder, modes)  # another process may have compiled them meanwhile
        if missing and _child(*missing, report=report).returncode == 0:
            _mark_complete(*missing)
    return True


@contextlib.contextmanager
def _one_at_a_time(folder: Path, on_wait: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Waits while another process compiles into this directory. A directory that cannot be written is not locked."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        yield
        return
    try:
        while not _locked(descriptor):
            _CHILDREN.raise_if_cancelled()
            on_wait()
            time.sleep(POLL_S)
        yield
    finally:
        os.close(descriptor)


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


_CHILDREN = Children()


class Loading(threading.Thread):
    """Runs make_ready in a thread. Loading releases the interpreter for most of the time.

    Attributes:
        text: the present activity, for the status of the service."""

    def __init__(self, *modes: str) -> None:
        super().__init__(name="loading", daemon=True)
        self._modes, self._done = modes, False
        self._next_log_s = 0.0
        self.text = "loading kernels"
        """What is being done, for the status of the service."""

    def run(self) -> None:
        with contextlib.suppress(CancelledError):  # `finish` raises instead
            make_ready(*self._modes, report=self._report)
            self._done = True

    def _report(self, done: int, total: int) -> None:
        self.text = progress_text(done, total)
        if time.monotonic() >= self._next_log_s:
            self._next_log_s = time.monotonic() + LOG_EVERY_S
            log.info(self.text)

    def cancel(self) -> None:
        """Ends a compiling child process; `finish` then raises. Loading in this process continues."""
        _CHILDREN.cancel()

    def finish(self) -> None:
        """Waits until the kernels are loaded. Raises WarmupError if that fails."""
        self.join()
        if not self._done:
            raise WarmupError("the kernels could not be loaded: the cause is printed above; run `companion warmup`")


def make_ready(*modes: str, report: Report = lambda done, total: None) -> None:
    """Loads the kernels of these groups. Missing ones are compiled by a child process, since compiling leaves about 1
    GB allocated.

    A service that ended while it loaded may have met a damaged cache and would end again at each start: a mark file
    makes the next start run `warm_up` first. The objects of the start are frozen (`gc.freeze`), since full garbage
    collections would otherwise scan them and stop the other threads. Raises WarmupError."""
    begun_s = time.monotonic()
    if warning := cache_warning(modes):
        log.warning(warning)
    named = os.environ.get(VARIABLE)
    mark = Path(named) / MARK if named else None
    died = mark is not None and mark.exists()
    if died:
        warm_up()
    elif mark is not None:
        if discarded := discard_damaged():
            log.warning("the cache of compiled kernels is damaged: %d files deleted, compiling them again", discarded)
        compiled = _compile_missing(mark.parent, modes, report)
        if not compiled and not (mark.parent / MANIFEST).exists():
            _mark_complete(*modes)  # compiled by a version without a manifest
    with _marked(mark):
        run_kernels(modes, metres=False)
    if time.monotonic() - begun_s > COMPILED_S:
        gc.collect()  # compiling leaves much garbage, loading little
    gc.freeze()


@contextlib.contextmanager
def _marked(mark: Path | None) -> Iterator[None]:
    """Keeps a mark file while kernels are loaded.

    It remains only if the process crashes or is killed. If the main thread fails or is stopped while another thread
    loads, it is removed at exit."""
    if mark is None:
        yield
        return

    def remove() -> None:
        mark.unlink(missing_ok=True)

    with contextlib.suppress(OSError):  # a cache that cannot be written cannot be damaged by this process
        mark.touch()
    atexit.register(remove)
    yield
    remove()
    atexit.unregister(remove)


def discard_damaged() -> int:
    """Deletes the kernels that differ from the manifest, and the marks that all are cached.

    A cache that cannot be written is left unchanged. Returns the number of deleted files."""
    named = os.environ.get(VARIABLE)
    damaged = damaged_kernels(Path(named)) if named else []
    if not named or not damaged:
        return 0
    try:
        for mode in MODES:
            (Path(named) / (COMPLETE + mode)).unlink(missing_ok=True)
        deleted = delete_kernels(damaged)
        (Path(named) / MANIFEST).unlink(missing_ok=True)
        write_manifest(Path(named))
    except OSError as error:
        log.warning("compiled kernels in %s are damaged and cannot be deleted (%s)", named, error.strerror)
        return 0
    return deleted


def _incomplete(folder: Path, modes: Sequence[str]) -> list[str]:
    """Returns the groups that are not marked as compiled for this processor."""
    if not folder.is_dir():
        return []
    here = processor()
    return [mode for mode in modes if _marked_for(folder / (COMPLETE + mode)) != here]


def _marked_for(mark: Path) -> str | None:
    try:
        return mark.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def _mark_complete(*modes: str) -> None:
    named = os.environ.get(VARIABLE)
    if named:
        with contextlib.suppress(OSError):
            for mode in modes:
                (Path(named) / (COMPLETE + mode)).write_text(processor(), encoding="utf-8")
            write_manifest(Path(named))


def run_child(modes: Sequence[str]) -> None:
    """Runs the kernels of these groups in the child process; without arguments, those of all groups."""
    threading.Thread(target=end_with_parent, name="parent", daemon=True).start()
    if modes:
        run_kernels(modes, metres=False)
    else:
        run_kernels()


def cache_folders() -> list[Path]:
    """Returns the directories of numba's cache for these sources.

    They are NUMBA_CACHE_DIR as set by jit_cache; otherwise (not writable, or numba imported before this package) the
    directories beside the sources and in the user's cache."""
    named = os.environ.get(VARIABLE)
    if named:
        return [Path(named)]
    root = Path(__file__).resolve().parents[2]
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    return [root / "core" / "__pycache__", root / "drivers" / "__pycache__", user]


def _cached_files(folders: list[Path]) -> Iterator[Path]:
    for folder in folders:
        for pattern in CACHED:
            yield from folder.rglob(pattern)


def _delete(folders: list[Path]) -> int:
    files = list(_cached_files(folders))
    for file in files:
        file.unlink(missing_ok=True)
    return len(files)


def _check_cache_place() -> None:
    """Raises WarmupError if the cache directory cannot be written: numba's own error names neither the directory nor
    a remedy."""
    named = os.environ.get(VARIABLE)
    if not named:
        return
    if is_linked_copy(Path(named)) and (warning := cache_warning(MODES)):
        raise WarmupError(warning)
    named = str(base_of(Path(named)))  # the value that the user has set
    try:
        Path(named).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=named):
            pass
    except OSError as error:
        raise WarmupError(
            f"{VARIABLE} = {named} cannot be written ({error.strerror}); "
            "name a directory that this user may write, or unset it"
        ) from error


def _child(*modes: str, report: Report) -> subprocess.CompletedProcess[str]:
    """Runs the kernels of these groups, or of all without arguments, in a child process and reports what it compiles."""
    command = [sys.executable, "-c", CHILD, *modes]
    count = CompiledCount(cache_folders()[0], modes or MODES)
    cached = newest = count.done()

    def has_progressed() -> bool:
        nonlocal newest
        before, newest = newest, count.done()
        if newest > cached:  # nothing is reported where all are only loaded
            report(newest, count.total)
        return newest > before

    try:
        return _CHILDREN.run(command, TIMEOUT_S, has_progressed)
    except subprocess.TimeoutExpired as error:
        raise WarmupError(
            f"no kernel was compiled within {TIMEOUT_S:g} s; reduce the load of the computer and run `companion warmup`: "
            "it continues with the kernels that are missing"
        ) from error


def _last_line(child: subprocess.CompletedProcess[str]) -> str:
    if child.returncode < 0:
        return f"the process was ended by signal {-child.returncode}"
    return (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]

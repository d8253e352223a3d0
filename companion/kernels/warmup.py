"""`companion warmup`: compiles and caches every kernel before a flight, and repairs a damaged cache.

The kernels run in a child process: a truncated or corrupt cache file (after a power failure) can raise any exception or
end the process. The parent then deletes the cached kernels and a second child compiles them again."""

from __future__ import annotations

import argparse
import contextlib
import gc
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..console import fail, print_json, print_line
from .child_process import CancelledError, Children, WarmupError, end_with_parent
from .jit_cache import VARIABLE, base_of
from .manifest import CACHED, MANIFEST, damaged_kernels, delete_kernels, write_manifest
from .run_kernels import MODES, run_kernels

log = logging.getLogger("companion")

CHILD = "import sys; from companion.kernels.warmup import run_child; run_child(sys.argv[1:])"
TIMEOUT_S = 1200.0
"""Compiling takes about a minute on two cores and several on a Raspberry Pi."""
COMPLETE = "complete-"
"""Prefix of a file beside the cached kernels: all kernels of this group are cached."""
MARK = "loading"
"""A file beside the cached kernels while a service loads them."""
COMPILED_S = 5.0
"""Loading cached kernels takes less time, compiling them far more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Warmup:
    """cache: directories of compiled kernels (several when NUMBA_CACHE_DIR is not set); deleted: damaged cache files
    and their companions; cached: present files."""

    cache: tuple[str, ...]
    deleted: int
    cached: int


def add_parser(subparsers: Any) -> None:
    """The command line of `companion warmup`."""
    parser = subparsers.add_parser("warmup", help="compile all kernels")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: all kernels are compiled; 1: an error."""
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
    print_line(f"all kernels are compiled: {done.cached} files in {', '.join(done.cache)}")
    return 0


def warm_up() -> Warmup:
    """Compiles or loads every kernel in a child process. Raises WarmupError."""
    _check_cache_place()
    folders = cache_folders()
    deleted = discard_damaged()
    first = _child()
    if first.returncode != 0:
        deleted += _delete(folders)
        if not deleted:
            raise WarmupError(f"the kernels do not run: {_last_line(first)}")
        second = _child()
        if second.returncode != 0:
            raise WarmupError(
                f"the kernels do not run, even after {deleted} cached files were deleted: {_last_line(second)}"
            )
    _tell_complete(*MODES)
    cached = len(list(_cached_files(folders)))
    return Warmup(cache=tuple(str(f) for f in folders if f.is_dir()), deleted=deleted, cached=cached)


_CHILDREN = Children()


class Loading(threading.Thread):
    """Runs make_ready in a thread. Loading releases the interpreter for most of the time."""

    def __init__(self, *modes: str) -> None:
        super().__init__(name="loading", daemon=True)
        self._modes, self._done = modes, False

    def run(self) -> None:
        with contextlib.suppress(CancelledError):  # `finish` raises instead
            make_ready(*self._modes)
            self._done = True

    def cancel(self) -> None:
        """Ends a compiling child; `finish` then raises. Loading in this process continues."""
        _CHILDREN.cancel()

    def finish(self) -> None:
        """Waits until the kernels are loaded. Raises WarmupError where that fails."""
        self.join()
        if not self._done:
            raise WarmupError("the kernels could not be loaded: the cause is printed above; run `companion warmup`")


def make_ready(*modes: str) -> None:
    """Loads the kernels of these groups. Missing ones are compiled by a child process, since compiling leaves about 1
    GB allocated.

    A service that ended while it loaded may have met a damaged cache and would end again at each start: a mark file
    makes the next start run `warm_up` first. The objects of the start are frozen (`gc.freeze`), since full garbage
    collections would otherwise scan them and stop the other threads. Raises WarmupError."""
    begun_s = time.monotonic()
    named = os.environ.get(VARIABLE)
    mark = Path(named) / MARK if named else None
    died = mark is not None and mark.exists()
    if died:
        warm_up()
    elif mark is not None:
        if discarded := discard_damaged():
            log.warning("the cache of compiled kernels is damaged: %d files deleted, compiling them again", discarded)
        if (lacking := _incomplete(mark.parent, modes)) and _child(*lacking).returncode == 0:
            _tell_complete(*lacking)  # otherwise compiled here, which shows the error
        elif not lacking and not (mark.parent / MANIFEST).exists():
            _tell_complete(*modes)  # compiled by a version without a manifest
    with contextlib.suppress(OSError):  # a cache that cannot be written cannot be damaged by this process
        if mark is not None:
            mark.touch()
    run_kernels(modes, metres=False)
    if mark is not None:
        mark.unlink(missing_ok=True)
    if time.monotonic() - begun_s > COMPILED_S:
        gc.collect()  # compiling leaves much garbage, loading little
    gc.freeze()


def discard_damaged() -> int:
    """Deletes the kernels that differ from the manifest, and the marks that all are cached; returns the number of
    deleted files. A cache that cannot be written is left unchanged."""
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
    return [mode for mode in modes if folder.is_dir() and not (folder / (COMPLETE + mode)).exists()]


def _tell_complete(*modes: str) -> None:
    named = os.environ.get(VARIABLE)
    if named:
        with contextlib.suppress(OSError):
            for mode in modes:
                (Path(named) / (COMPLETE + mode)).touch()
            write_manifest(Path(named))


def run_child(modes: Sequence[str]) -> None:
    """The child process: runs the kernels of these groups; all groups without arguments."""
    threading.Thread(target=end_with_parent, name="parent", daemon=True).start()
    if modes:
        run_kernels(modes, metres=False)
    else:
        run_kernels()


def cache_folders() -> list[Path]:
    """Directories of numba's cache for these sources: NUMBA_CACHE_DIR as set by jit_cache; otherwise (not writable, or
    numba imported before this package) beside the sources and in the user's cache."""
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
    """Checks the cache directory: numba's own error for one that cannot be written names neither it nor a remedy."""
    named = os.environ.get(VARIABLE)
    if not named:
        return
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


def _child(*modes: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CHILD, *modes]
    try:
        return _CHILDREN.run(command, TIMEOUT_S)
    except subprocess.TimeoutExpired as error:
        raise WarmupError(
            f"compiling did not end within {TIMEOUT_S:g} s; reduce the load of the computer and run "
            "`companion warmup` again"
        ) from error


def _last_line(child: subprocess.CompletedProcess[str]) -> str:
    if child.returncode < 0:
        return f"the process was ended by signal {-child.returncode}"
    return (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]

"""`companion warmup`: every kernel compiled and cached before take-off, and a damaged cache mended.

The kernels run in a child process: a truncated or corrupt cache file (a power cut while it was written) can raise
anything, or end the process outright. Whatever happens there, the parent sees it, deletes the cached kernels and
lets a second child compile them again.
"""

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
"""With a mode behind it: stands beside the cached kernels when all that a service in this mode uses are there."""
MARK = "loading"
"""Stands beside the cached kernels while a service loads them."""
COMPILED_S = 5.0
"""Loading cached kernels takes less, compiling them far more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Warmup:
    """cache: where compiled kernels lie (several places when NUMBA_CACHE_DIR is not set); deleted: cache files that
    were damaged or stood beside such, and are made again; cached: files there now."""

    cache: tuple[str, ...]
    deleted: int
    cached: int


def add_parser(subparsers: Any) -> None:
    """The command line of `companion warmup`."""
    parser = subparsers.add_parser("warmup", help="compile what is compiled at first use")
    parser.add_argument("--json", action="store_true", help="one machine-readable object on stdout")


def run(args: argparse.Namespace) -> int:
    """0: all kernels are compiled; 1: they cannot be."""
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
    """Compiles or loads every kernel, in a child process. Raises WarmupError."""
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
                f"the kernels do not run, also after {deleted} cached files were deleted: {_last_line(second)}"
            )
    _tell_complete(*MODES)
    cached = len(list(_cached_files(folders)))
    return Warmup(cache=tuple(str(f) for f in folders if f.is_dir()), deleted=deleted, cached=cached)


_CHILDREN = Children()


class Loading(threading.Thread):
    """make_ready, beside whatever else a start has to do. Loading releases the interpreter for most of its time."""

    def __init__(self, *modes: str) -> None:
        super().__init__(name="loading", daemon=True)
        self._modes, self._done = modes, False

    def run(self) -> None:
        with contextlib.suppress(CancelledError):  # `finish` says so
            make_ready(*self._modes)
            self._done = True

    def cancel(self) -> None:
        """Ends a child that compiles; `finish` then raises. What this process itself is loading goes on."""
        _CHILDREN.cancel()

    def finish(self) -> None:
        """Waits until the kernels are there. Raises WarmupError where they cannot be had."""
        self.join()
        if not self._done:
            raise WarmupError("the kernels could not be loaded: the cause stands above; try `companion warmup`")


def make_ready(*modes: str) -> None:
    """Loads the kernels that a live service in these modes uses, or has them compiled where that was never done: by a
    child, since compiling leaves a gigabyte behind, and the service stays as large as it once was.

    A service that died while it loaded has perhaps met a damaged cache, and would die of it again at each start: a
    mark tells the next one, which lets `warm_up` look and mend first. What the start has made stays for good: it is
    frozen (`gc.freeze`), since full collections would otherwise scan all of it again and again and stop the other
    threads meanwhile. Raises WarmupError."""
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
            _tell_complete(*lacking)  # else it is tried here, which tells why it fails
        elif not lacking and not (mark.parent / MANIFEST).exists():
            _tell_complete(*modes)  # compiled by a version without a manifest
    with contextlib.suppress(OSError):  # a cache that cannot be written is not one that we damage
        if mark is not None:
            mark.touch()
    run_kernels(modes, metres=False)
    if mark is not None:
        mark.unlink(missing_ok=True)
    if time.monotonic() - begun_s > COMPILED_S:
        gc.collect()  # compiling leaves much behind, loading little
    gc.freeze()


def discard_damaged() -> int:
    """Deletes the kernels whose content is not that of the manifest, and the marks that say that all are there; returns
    how many files were deleted. A cache that cannot be written is left as it is."""
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
    """What a child process does: the kernels of a service in these modes; none named: all there are."""
    threading.Thread(target=end_with_parent, name="parent", daemon=True).start()
    if modes:
        run_kernels(modes, metres=False)
    else:
        run_kernels()


def cache_folders() -> list[Path]:
    """Where numba keeps compiled kernels of these sources: NUMBA_CACHE_DIR as jit_cache set it, else (no place could
    be written, or numba was imported before this package) beside the sources or in the user's own cache."""
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
    """numba's own message for a cache that cannot be written names neither the directory nor a remedy."""
    named = os.environ.get(VARIABLE)
    if not named:
        return
    named = str(base_of(Path(named)))  # what the user wrote
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
        raise WarmupError(f"compiling did not end within {TIMEOUT_S:g} s; is the machine overloaded?") from error


def _last_line(child: subprocess.CompletedProcess[str]) -> str:
    if child.returncode < 0:
        return f"the process was ended by signal {-child.returncode}"
    return (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]

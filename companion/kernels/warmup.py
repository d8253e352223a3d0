"""`companion warmup`: compiles and caches kernels before a flight, and repairs a damaged cache.

The kernels run in a child process: a truncated or corrupt cache file (after a power failure) can raise any exception or
end the process. The parent then deletes the cached kernels and a second child compiles them again."""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..console import fail, print_json, print_line, warn
from .cache_state import (
    cache_folder,
    cache_warning,
    cached_files,
    check_cache_place,
    delete_all,
    discard_damaged,
    incomplete_modes,
    mark_complete,
)
from .child_process import POLL_S, Children, WarmupError, end_with_parent
from .jit_cache import VARIABLE, base_of, is_temporary_copy
from .processor import CPU_NAME, level_variables, levels, own_levels
from .progress import CompiledCount, ProgressLine, Report
from .run_kernels import MODES, run_kernels

log = logging.getLogger("companion")

CHILD = "import sys; from companion.kernels.warmup import run_child; run_child(sys.argv[1:])"
LEVEL_CHILD = "import sys; from companion.cli import main; sys.exit(main(['warmup', '--json']))"
TIMEOUT_S = 1200.0
"""Longest time without another compiled kernel. All kernels take two minutes on two idle cores, and more than 20 on a
busy computer."""
LOCK = "compiling"
"""A file beside the cached kernels that is locked while a process compiles them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Warmup:
    """Result of `warm_up`.

    Attributes:
        cache: directory of compiled kernels.
        deleted: number of deleted files of damaged kernels.
        cached: number of present files."""

    cache: Path
    deleted: int
    cached: int


def add_parser(subparsers: Any) -> None:
    """Adds the command line of `companion warmup`."""
    parser = subparsers.add_parser("warmup")
    parser.add_argument(
        "--levels",
        action="store_true",
        help="compile for each level of processors that this one can run, as a package for other computers contains them",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Runs `companion warmup`. Returns 0: all kernels are compiled; 1: an error."""
    if args.levels:
        return _run_levels(args.json)
    try:
        done = warm_up()
    except WarmupError as error:
        fail(str(error))
        return 1
    if args.json:
        print_json({"cache": [str(done.cache)], "deleted": done.deleted, "cached": done.cached})
        return 0
    if done.deleted:
        print_line(f"the cache of compiled kernels was damaged: {done.deleted} files deleted, compiled again")
    level = os.environ.get(CPU_NAME, "this processor")
    print_line(f"all kernels are compiled for {level}: {done.cached} files in {done.cache}{_link_remark()}")
    return 0


def _run_levels(as_json: bool) -> int:
    """Runs `companion warmup` for each level in a process of its own, since numba reads its processor once."""
    own = own_levels()
    if not own:
        fail("this processor has no level in common with others; `companion warmup` without --levels compiles for it")
        return 1
    for level in levels():
        if level not in own:
            warn(f"no kernels for {level}: this processor cannot run them; compile them on one that can")
    done = {}
    for level in own:
        environment = os.environ | level_variables(level)
        if named := os.environ.get(VARIABLE):
            environment[VARIABLE] = str(base_of(Path(named)))
        child = subprocess.run(
            [sys.executable, "-c", LEVEL_CHILD], env=environment, stdout=subprocess.PIPE, check=False
        )
        if child.returncode != 0:
            return 1  # its error is above
        done[level] = json.loads(child.stdout)
        if not as_json:
            print_line(f"{level}: {done[level]['cached']} files in {', '.join(done[level]['cache'])}")
    if as_json:
        print_json({"levels": done})
    return 0


def warm_up() -> Warmup:
    """Compiles or loads every kernel in a child process, with a line of progress. Raises WarmupError."""
    check_cache_place()
    folder = cache_folder()
    with _progress_line() as report, _one_at_a_time(folder):
        deleted = discard_damaged()
        first = _child(report=report)
        if first.returncode != 0:
            deleted += delete_all(folder)
            if not deleted:
                raise WarmupError(f"the kernels do not run: {_last_line(first)}{_space_remedy(first, folder)}")
            second = _child(report=report)
            if second.returncode != 0:
                raise WarmupError(
                    f"the kernels do not run, even after {deleted} cached files were deleted: {_last_line(second)}"
                    f"{_space_remedy(second, folder)}"
                )
        mark_complete(*MODES)
    return Warmup(cache=folder, deleted=deleted, cached=len(cached_files(folder)))


def _link_remark() -> str:
    return ", links to a cache that cannot be written" if is_temporary_copy(cache_folder()) else ""


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
            compile_missing(Path(named), modes, report)


@contextlib.contextmanager
def _progress_line() -> Iterator[Report]:
    line = ProgressLine()
    try:
        yield line
    finally:
        line.end()


def compile_missing(folder: Path, modes: Sequence[str], report: Report) -> bool:
    """Compiles missing kernels; returns True if there were any.

    If the child fails, they stay missing: they are compiled at their first use, which shows the error."""
    if not incomplete_modes(folder, modes):
        return False
    count = CompiledCount(folder, modes)
    with _one_at_a_time(folder, lambda: report(count.done(), count.total)):
        missing = incomplete_modes(folder, modes)  # another process may have compiled them meanwhile
        if missing and _child(*missing, report=report).returncode == 0:
            mark_complete(*missing)
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
            CHILDREN.raise_if_cancelled()
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


CHILDREN = Children()


def run_child(modes: Sequence[str]) -> None:
    """Runs the kernels of these groups in the child process; without arguments, those of all groups."""
    threading.Thread(target=end_with_parent, name="parent", daemon=True).start()
    if modes:
        run_kernels(modes, metres=False)
    else:
        run_kernels()


def _child(*modes: str, report: Report) -> subprocess.CompletedProcess[str]:
    """Runs the kernels of these groups, or of all without arguments, in a child process and reports what it compiles."""
    command = [sys.executable, "-c", CHILD, *modes]
    count = CompiledCount(cache_folder(), modes or MODES)
    cached = newest = count.done()

    def has_progressed() -> bool:
        nonlocal newest
        before, newest = newest, count.done()
        if newest > cached:  # nothing is reported where all are only loaded
            report(newest, count.total)
        return newest > before

    try:
        return CHILDREN.run(command, TIMEOUT_S, has_progressed)
    except subprocess.TimeoutExpired as error:
        raise WarmupError(
            f"no kernel was compiled within {TIMEOUT_S:g} s; reduce the load of the computer and run `companion warmup`: "
            "it continues with the kernels that are missing"
        ) from error


def _last_line(child: subprocess.CompletedProcess[str]) -> str:
    if child.returncode < 0:
        return f"the process was ended by signal {-child.returncode}"
    return (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]

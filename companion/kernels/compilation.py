"""Compiles the missing kernels of the directory in use.

They are run in a child process: compiling leaves about 1 GB allocated, and a damaged file of a cache, as after a power
failure, can raise any exception or end the process. The kernels are then deleted and compiled again."""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..stop_signal import end_with_parent
from .jit_cache import VARIABLE, state_in_use, unwritable_text
from .manifest import add_groups, discard_damaged, missing_groups
from .module_folder import delete_kernels
from .progress import CompiledCount, Report

CHILD = "import sys; from companion.kernels.compilation import run_child; run_child(sys.argv[1:])"
LOCK = "compiling"
"""A file in the directory of the kernels that is locked while a process compiles them."""
POLL_S = 0.5
"""Time between reports of the progress."""
_SENT_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""They are sent to a process from outside; a damaged kernel raises others."""


class WarmupError(Exception):
    """The kernels cannot be made ready; the message states the cause and the remedy."""


def compile_kernels(groups: Sequence[str], report: Report, check: bool = False) -> int:
    """Compiles the kernels of these groups that are missing or damaged; waits while another process compiles.

    Without a directory of its own, where numba was imported first, nothing is done.

    Args:
        groups: see `run_kernels.GROUPS`.
        report: is called with the progress.
        check: run the kernels in a child process even if none is missing.

    Returns the number of files that were deleted since they were damaged. Raises WarmupError."""
    folder = state_in_use()
    if folder is None:
        return 0
    try:
        deleted = discard_damaged(folder)
        if check or missing_groups(folder, groups):
            with _one_at_a_time(folder, groups, report):
                wanted = groups if check else missing_groups(folder, groups)  # another process may have compiled them
                if wanted:
                    deleted += _compile(folder, wanted, report)
                    add_groups(folder, wanted)
    except OSError as error:
        raise WarmupError(f"{error.filename or folder}: {error.strerror}{_remedy(str(error), folder)}") from error
    return deleted


def cache_warning(groups: Sequence[str]) -> str:
    """Returns a warning with a remedy if kernels of these groups are missing and cannot be stored, otherwise "".

    Each process would compile its own kernels then."""
    text, folder = unwritable_text(), state_in_use()
    missing = missing_groups(folder, groups) if text and folder else []
    if not missing:
        return ""
    return (
        f"{text}, and those of {', '.join(missing)} are missing: each command compiles them again, which takes minutes; "
        f"set {VARIABLE} to a folder that this user may write"
    )


@contextlib.contextmanager
def _one_at_a_time(folder: Path, groups: Sequence[str], report: Report) -> Iterator[None]:
    """Waits while another process compiles into this directory, and reports its progress. Raises OSError."""
    count = CompiledCount(folder, groups)
    with (folder / LOCK).open("a") as lock:
        while not _locked(lock.fileno()):
            report(count.done(), count.total)
            time.sleep(POLL_S)
        yield


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _compile(folder: Path, groups: Sequence[str], report: Report) -> int:
    """Runs the kernels in a child process, and once more without the cached ones if that fails. Returns the number of
    deleted files. Raises OSError, WarmupError."""
    deleted = 0
    status, errors = _run_in_child(folder, groups, report)
    if status != 0 and _may_be_damage(status, errors) and (deleted := delete_kernels(folder)):
        status, errors = _run_in_child(folder, groups, report)
    if status != 0:
        after = f", even after {deleted} cached files were deleted" if deleted else ""
        lines = errors.strip().splitlines() or [f"exit status {status}"]
        cause = f"the process was ended by signal {-status}" if status < 0 else lines[-1]
        raise WarmupError(f"the kernels do not run{after}: {cause}{_remedy(cause, folder)}")
    return deleted


def _run_in_child(folder: Path, groups: Sequence[str], report: Report) -> tuple[int, str]:
    """Runs the kernels of these groups in a child process. Returns its status and what it has written to stderr."""
    count = CompiledCount(folder, groups)
    cached = count.done()
    theirs, ours = os.pipe()  # `ours` closes when this process ends in any way, see `run_child`
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD, *groups],
        stdin=theirs,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,  # Ctrl-C in a terminal reaches this process alone, which ends the child
    )
    os.close(theirs)
    try:
        while True:
            try:
                _, errors = process.communicate(timeout=POLL_S)
                return process.returncode, errors
            except subprocess.TimeoutExpired:
                if (done := count.done()) > cached:  # nothing is reported where all are only loaded
                    report(done, count.total)
    finally:
        process.kill()  # no effect after it has ended
        process.wait()
        os.close(ours)


def run_child(groups: Sequence[str]) -> None:
    """Runs the kernels of these groups in the child process."""
    from .run_kernels import run_kernels

    end_with_parent()
    run_kernels(groups)


def _may_be_damage(status: int, errors: str) -> bool:
    """False on a full disk, and if the child was ended by a signal of another process, or of the kernel where memory is
    short: the files that it has written are whole, and the next one continues with them."""
    return -status not in _SENT_SIGNALS and not _is_disk_full(errors)


def _remedy(cause: str, folder: Path) -> str:
    """Returns the remedy for a full disk; "" for other failures."""
    if not _is_disk_full(cause):
        return ""
    return f"; the disk of {folder} is full: free 200 MB, or set {VARIABLE} to a folder on another disk"


def _is_disk_full(errors: str) -> bool:
    return "No space left" in errors

"""Loads the compiled kernels at the start of a service, and survives a cache that was damaged while it ran."""

from __future__ import annotations

import atexit
import contextlib
import gc
import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from .cache_state import cache_warning, discard_damaged, mark_complete
from .child_process import CancelledError, WarmupError
from .jit_cache import VARIABLE
from .manifest import MANIFEST
from .progress import LOG_EVERY_S, Report, progress_text
from .run_kernels import run_kernels
from .warmup import CHILDREN, compile_missing, warm_up

log = logging.getLogger("companion")

MARK = "loading"
"""A file beside the cached kernels while a service loads them."""
COMPILED_S = 5.0
"""Loading cached kernels takes less time than this, compiling them much more."""


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
        CHILDREN.cancel()

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
        compiled = compile_missing(mark.parent, modes, report)
        if not compiled and not (mark.parent / MANIFEST).exists():
            mark_complete(*modes)  # compiled by a version without a manifest
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

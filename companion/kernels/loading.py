"""Loads the compiled kernels at the start of a service, and survives a cache that was damaged while it ran."""

from __future__ import annotations

import contextlib
import logging
import threading
import time

from .compilation import POLL_S, WarmupError, cache_warning, compile_kernels
from .jit_cache import state_in_use
from .progress import LOG_EVERY_S, Report, progress_text
from .run_kernels import run_kernels

log = logging.getLogger("companion")

MARK = "loading"
"""A file in the directory of the kernels while a service loads them."""


class Loading(threading.Thread):
    """Runs make_ready in a thread. Loading releases the interpreter for most of the time.

    Attributes:
        text: the present activity, for the status of the service."""

    def __init__(self, *groups: str) -> None:
        super().__init__(name="loading", daemon=True)
        self._groups = groups
        self._error: WarmupError | None = WarmupError(
            "the kernels could not be loaded: the cause is printed above; run `companion warmup`"
        )
        self._cancelled = False
        self._next_log_s = 0.0
        self.text = progress_text(0, 0)

    def run(self) -> None:
        try:
            make_ready(*self._groups, report=self._report)
            self._error = None
        except WarmupError as error:
            self._error = error

    def _report(self, done: int, total: int) -> None:
        self.text = progress_text(done, total)
        if time.monotonic() >= self._next_log_s:
            self._next_log_s = time.monotonic() + LOG_EVERY_S
            log.info(self.text)

    def cancel(self) -> None:
        """Makes `finish` return, so that this process can end. A compiling child process ends with it."""
        self._cancelled = True

    def finish(self) -> None:
        """Waits until the kernels are loaded. Raises WarmupError if that fails, or after `cancel`."""
        while self.is_alive():
            if self._cancelled:
                raise WarmupError("the kernels are not loaded: the process is shutting down")
            self.join(POLL_S)
        if self._error is not None:
            raise self._error


def make_ready(*groups: str, report: Report = lambda done, total: None) -> None:
    """Loads the kernels of these groups, after a child process has compiled the missing ones. Raises WarmupError. Those of the
    simulated camera are not loaded: its own process renders.

    A service that failed or ended while it loaded may have met a damaged cache and would end again at each start. A mark
    file, which then remains, makes the next start run the kernels in a child process first."""
    if warning := cache_warning(groups):
        log.warning(warning)
    folder = state_in_use()
    mark = folder / MARK if folder else None
    if deleted := compile_kernels(groups, report, check=mark is not None and mark.exists()):
        log.warning("the cache of compiled kernels was damaged: %d files deleted, compiled again", deleted)
    if mark is not None:
        with contextlib.suppress(OSError):  # as on a full disk
            mark.touch()
    run_kernels([group for group in groups if group != "simulated"])
    if mark is not None:
        mark.unlink(missing_ok=True)

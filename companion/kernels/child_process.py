"""Child processes that compile kernels."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Sequence


class WarmupError(Exception):
    """The kernels cannot be made ready; the message states the cause and the remedy."""


class CancelledError(WarmupError):
    """The process was asked to end while a child compiled."""


class Children:
    """The child processes that compile, so that another thread can end them."""

    def __init__(self) -> None:
        self._lock = threading.RLock()  # a signal's handler may interrupt its holder
        self._running: subprocess.Popen[str] | None = None
        self._cancelled = False

    def run(self, command: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
        """As `subprocess.run`, with its output. Raises CancelledError once cancelled."""
        with self._lock:
            if self._cancelled:
                raise CancelledError("compiling was cancelled: the process was told to end")
            theirs, ours = os.pipe()  # `ours` closes with this process, however that ends, see `end_with_parent`
            process = self._running = subprocess.Popen(
                command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            os.close(theirs)
        try:
            out, errors = process.communicate(timeout=timeout_s)
        finally:
            process.kill()  # nothing where it has ended
            process.wait()
            os.close(ours)
            with self._lock:
                self._running = None
        if self._cancelled:
            raise CancelledError("compiling was cancelled: the process was told to end")
        return subprocess.CompletedProcess(command, process.returncode, out, errors)

    def cancel(self) -> None:
        """Ends the child that runs, if one does; none is started any more."""
        with self._lock:
            self._cancelled = True
            if self._running is not None:
                self._running.kill()


def end_with_parent() -> None:
    """Ends this process when its standard input is closed: a parent that was killed cannot end it."""
    while os.read(0, 1):
        pass
    os._exit(1)

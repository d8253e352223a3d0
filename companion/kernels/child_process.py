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
    """The compiling child process, which another thread can end."""

    def __init__(self) -> None:
        self._lock = threading.RLock()  # a signal handler may interrupt the thread that holds it
        self._running: subprocess.Popen[str] | None = None
        self._cancelled = False

    def run(self, command: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
        """As `subprocess.run`, with its output. Raises CancelledError once cancelled."""
        with self._lock:
            if self._cancelled:
                raise CancelledError("compiling was cancelled: the process is shutting down")
            theirs, ours = os.pipe()  # `ours` closes when this process ends in any way, see `end_with_parent`
            process = self._running = subprocess.Popen(
                command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            os.close(theirs)
        try:
            out, errors = process.communicate(timeout=timeout_s)
        finally:
            process.kill()  # no effect after it has ended
            process.wait()
            os.close(ours)
            with self._lock:
                self._running = None
        if self._cancelled:
            raise CancelledError("compiling was cancelled: the process is shutting down")
        return subprocess.CompletedProcess(command, process.returncode, out, errors)

    def cancel(self) -> None:
        """Ends the running child; no further child is started."""
        with self._lock:
            self._cancelled = True
            if self._running is not None:
                self._running.kill()


def end_with_parent() -> None:
    """Ends this process when its standard input is closed, which shows that the parent was killed."""
    while os.read(0, 1):
        pass
    os._exit(1)

"""Child processes that compile kernels."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Callable, Sequence

POLL_S = 0.5


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

    def raise_if_cancelled(self) -> None:
        """Raises CancelledError once cancelled."""
        if self._cancelled:
            raise CancelledError("compiling was cancelled: the process is shutting down")

    def run(
        self, command: Sequence[str], timeout_s: float, has_progressed: Callable[[], bool] = lambda: False
    ) -> subprocess.CompletedProcess[str]:
        """Runs a command like `subprocess.run` with captured output.

        has_progressed is called every POLL_S; the timeout begins anew when it returns True. Raises CancelledError
        once cancelled, and TimeoutExpired."""
        with self._lock:
            self.raise_if_cancelled()
            theirs, ours = os.pipe()  # `ours` closes when this process ends in any way, see `end_with_parent`
            process = self._running = subprocess.Popen(
                command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            os.close(theirs)
        try:
            out, errors = _output_of(process, timeout_s, has_progressed)
        finally:
            process.kill()  # no effect after it has ended
            process.wait()
            os.close(ours)
            with self._lock:
                self._running = None
        self.raise_if_cancelled()
        return subprocess.CompletedProcess(command, process.returncode, out, errors)

    def cancel(self) -> None:
        """Ends the running child; no further child is started."""
        with self._lock:
            self._cancelled = True
            if self._running is not None:
                self._running.kill()


def _output_of(process: subprocess.Popen[str], timeout_s: float, has_progressed: Callable[[], bool]) -> tuple[str, str]:
    """Returns stdout and stderr of a process at its end. Raises TimeoutExpired."""
    end_s = time.monotonic() + timeout_s
    while True:
        try:
            return process.communicate(timeout=POLL_S)
        except subprocess.TimeoutExpired:
            if has_progressed():
                end_s = time.monotonic() + timeout_s
            if time.monotonic() > end_s:
                raise


def end_with_parent() -> None:
    """Ends this process when its standard input is closed, which shows that the parent was killed."""
    while os.read(0, 1):
        pass
    os._exit(1)

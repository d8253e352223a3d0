"""How a process learns that it is to end: by a signal, or by the end of its parent."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable


def stop_event() -> threading.Event:
    """An event that Ctrl-C (SIGINT) and SIGTERM set from now on."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def end_with_parent() -> None:
    """From now on ends this process when its standard input is closed, which shows that its parent has ended."""
    _at_end_of_parent(lambda: os._exit(1))


def stop_with_parent() -> None:
    """As `end_with_parent`, by SIGTERM: what this process does at a stop is done."""
    _at_end_of_parent(lambda: os.kill(os.getpid(), signal.SIGTERM))


def _at_end_of_parent(end: Callable[[], None]) -> None:
    def wait() -> None:
        while os.read(0, 1):  # not through sys.stdin: its lock would be held when this process exits
            pass
        end()

    threading.Thread(target=wait, name="parent", daemon=True).start()

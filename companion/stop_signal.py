"""How a process learns that it is to end: by a signal, or by the end of its parent."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable


def at_stop_signal(act: Callable[[], None]) -> None:
    """From now on calls `act` at Ctrl-C (SIGINT) or SIGTERM, once and in a thread of its own.

    A handler runs in the main thread wherever that is, also while it holds a lock: a handler that sets an event for which
    the main thread waits may wait for ever."""
    signalled, signals = os.pipe()
    os.set_blocking(signals, False)

    def wait() -> None:
        os.read(signalled, 1)
        act()

    def handle(*_: object) -> None:
        with contextlib.suppress(BlockingIOError):  # full: signalled long ago
            os.write(signals, b"\0")

    threading.Thread(target=wait, name="stop signal", daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handle)


def stop_event() -> threading.Event:
    """An event that Ctrl-C (SIGINT) and SIGTERM set from now on."""
    stop = threading.Event()
    at_stop_signal(stop.set)
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

"""How a process learns that it is to end: by a signal, or by the end of its parent."""

from __future__ import annotations

import os
import signal
import threading


def stop_event() -> threading.Event:
    """An event that Ctrl-C (SIGINT) and SIGTERM set from now on."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def end_with_parent() -> None:
    """From now on ends this process when its standard input is closed, which shows that its parent has ended."""
    threading.Thread(target=_wait_for_parent, name="parent", daemon=True).start()


def _wait_for_parent() -> None:
    while os.read(0, 1):  # not through sys.stdin: its lock would be held when this process exits
        pass
    os._exit(1)

"""Commands that run until they are stopped."""

from __future__ import annotations

import signal
import threading


def stop_event() -> threading.Event:
    """An event that Ctrl-C (SIGINT) and SIGTERM set from now on."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop

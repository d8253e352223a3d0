"""A signal ends a process whatever the main thread does when it arrives."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

_PROGRAM = """
import signal, sys, threading
from companion.stop_signal import stop_event

def interrupt(frame, event, argument):
    if frame.f_code is not threading.Event.wait.__code__:
        return None
    if event == "line":
        signal.raise_signal(signal.{signal})
    return interrupt

stop = stop_event()
sys.settrace(interrupt)
while not stop.wait(0.2):
    pass
"""


@pytest.mark.parametrize("signal", ["SIGINT", "SIGTERM"])
def test_a_signal_within_the_wait_for_it_ends_the_wait(signal: str) -> None:
    """The handler set the event itself. Where it interrupted the main thread while that held the event's lock, both waited for
    ever: a service then ended by SIGKILL only."""
    program = _PROGRAM.format(signal=signal)
    assert subprocess.run([sys.executable, "-c", program], check=False, timeout=20).returncode == 0

"""Waits for a condition."""

from __future__ import annotations

import time
from collections.abc import Callable

POLL_S = 0.05


def wait_until(condition: Callable[[], bool], seconds: float) -> None:
    """Returns when the condition holds, at the latest after `seconds`."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and not condition():
        time.sleep(POLL_S)

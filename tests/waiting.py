"""Waiting for a condition."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 120.0
"""Time limit for steps that are not the subject of a test, such as a start on a busy machine."""


def until(condition: Callable[[], Any], seconds: float = PATIENCE_S, every_s: float = 0.01) -> bool:
    """Waits until a condition holds, and checks it at this interval; returns whether it does."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(every_s)
    return bool(condition())

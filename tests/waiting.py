"""Waiting for a condition."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

PATIENCE_S = 120.0
"""Time limit for steps that are not the subject of a test, such as a start on a busy machine."""


def until(condition: Callable[[], Any], seconds: float = PATIENCE_S) -> bool:
    """Waits until a condition holds; returns whether it does."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.01)
    return bool(condition())

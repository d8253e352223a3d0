"""Closes a device whose library may wait for it for ever, so that the cause of a failure is raised in any case."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Final

CLOSE_S: Final = 3.0
"""Longest wait for a device to close after its opening has failed; the process of the camera ends then."""


def close_within(close: Callable[[], object], seconds: float | None = None) -> bool:
    """Closes in a thread of its own; returns whether this ended within the time, by default CLOSE_S. A RuntimeError is dropped: the
    library raises it for a lost device, whose cause is known already."""

    def run() -> None:
        with contextlib.suppress(RuntimeError):
            close()

    thread = threading.Thread(target=run, name="close of a camera", daemon=True)
    thread.start()
    thread.join(CLOSE_S if seconds is None else seconds)
    return not thread.is_alive()

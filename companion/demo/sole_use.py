"""The output directory of a demo, which one demo at a time uses."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .live import DemoError


@contextmanager
def sole_use(folder: Path) -> Iterator[None]:
    """No other demo writes into the directory meanwhile. Raises DemoError where one does, and OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise DemoError(
            f"{folder}: another demo is running and writes there; wait for its end, or give -o another directory"
        ) from error
    except OSError:
        pass  # some network file systems have no locks
    try:
        yield
    finally:
        os.close(descriptor)

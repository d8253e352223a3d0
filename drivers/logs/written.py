"""Whether a log is being written: its writer holds an exclusive lock on the file."""

from __future__ import annotations

import fcntl
from pathlib import Path


def is_being_written(path: Path) -> bool:
    """Whether a process has the file open with an exclusive lock. Raises OSError where it cannot be opened."""
    with path.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            pass  # some network file systems have no locks
    return False


def seems_written(path: Path) -> bool:
    """The same; False where it is not a file, or cannot be opened: it was renamed, or who reads it reports the cause."""
    try:
        return path.is_file() and is_being_written(path)
    except OSError:
        return False

"""Refuses what only looks like a file: reading a pipe waits for another process, and a device may have no end."""

from __future__ import annotations

import errno
import stat
from pathlib import Path


def regular(path: Path) -> Path:
    """The path of a file to read. Raises OSError where nothing is there, and for a pipe, socket or device."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # to open a directory has an error of its own
        raise OSError(errno.EINVAL, "a pipe, socket or device; save its content as a file", str(path))
    return path

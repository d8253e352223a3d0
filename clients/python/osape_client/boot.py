"""The identity of this boot of the machine."""

from __future__ import annotations

import uuid
from functools import cache
from pathlib import Path

BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


@cache
def boot_id() -> str:
    """Identifier of this boot of the machine: monotonic time stamps of two boots cannot be compared. A random one, constant
    within this process, where the system has none."""
    try:
        return BOOT_ID_FILE.read_text().strip()
    except OSError:
        return str(uuid.uuid4())

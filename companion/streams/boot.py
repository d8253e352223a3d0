"""The identity of this boot of the machine."""

from __future__ import annotations

import uuid
from pathlib import Path

BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Of this boot of the machine: stamps of two boots cannot be compared. A random one where the system has none."""
    try:
        return BOOT_ID_FILE.read_text().strip()
    except OSError:
        return str(uuid.uuid4())

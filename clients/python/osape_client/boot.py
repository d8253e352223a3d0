"""The identity of this boot of the machine."""

from __future__ import annotations

import uuid
from functools import cache
from pathlib import Path

BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")
OFFSETS_FILE = Path("/proc/self/timens_offsets")


@cache
def boot_id() -> str:
    """Identifier of this boot of the machine: monotonic time stamps of two boots cannot be compared, and neither can those of two time
    namespaces, as of a container, whose offsets are a part of it. A random one, constant within this process, where the system has
    none."""
    try:
        return BOOT_ID_FILE.read_text().strip() + _offsets()
    except OSError:
        return str(uuid.uuid4())


def _offsets() -> str:
    """The offsets of the time namespace of this process, such as +0.0.100.0; empty: it has none."""
    try:
        numbers = [n for line in OFFSETS_FILE.read_text().splitlines() for n in line.split()[1:]]
    except OSError:  # an older kernel has no time namespaces
        return ""
    return "" if set(numbers) <= {"0"} else "+" + ".".join(numbers)

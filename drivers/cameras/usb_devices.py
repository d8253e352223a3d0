"""USB devices as the kernel describes them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

USB: Final = Path("/sys/bus/usb/devices")
MOVIDIUS, STEREOLABS, INTEL = "03e7", "2b03", "8086"
"""idVendor of the makers of cameras."""


def text_of(file: Path) -> str:
    """The content of a file of the kernel, without blanks around it; empty where it cannot be read."""
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""

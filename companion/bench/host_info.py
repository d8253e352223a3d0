"""Processor and package versions of a measurement, without host name or paths."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..log.provenance import package_versions

_CPUINFO: Final = Path("/proc/cpuinfo")
_GOVERNOR: Final = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
_BOARD: Final = Path("/proc/device-tree/model")


@dataclass(frozen=True, slots=True, kw_only=True)
class HostInfo:
    """The computer."""

    processor: str  # its model name
    architecture: str
    cores: int  # usable by this process
    governor: str  # of the clock frequency, "" if unknown
    board: str  # of a single-board computer, "" otherwise
    system: str

    def text(self) -> str:
        """The description in one line."""
        parts = [self.board, self.processor, self.architecture, f"{self.cores} core{'s' * (self.cores != 1)}"]
        parts.append(f"clock governor {self.governor}" if self.governor else "clock governor unknown")
        return ", ".join(part for part in [*parts, self.system] if part)


def host_info() -> HostInfo:
    """Description of this computer."""
    return HostInfo(
        processor=processor_model(_text(_CPUINFO)) or platform.processor() or "unknown processor",
        architecture=platform.machine(),
        cores=len(os.sched_getaffinity(0)),
        governor=_text(_GOVERNOR),
        board=_text(_BOARD).strip("\0"),
        system=platform.system(),
    )


def processor_model(cpuinfo: str) -> str:
    """The model name in the text of /proc/cpuinfo; for ARM cores, which report numbers only, their part numbers."""
    rows = [line.split(":", 1) for line in cpuinfo.splitlines() if ":" in line]
    values = [(key.strip().lower(), value.strip()) for key, value in rows]
    for wanted in ("model name", "hardware"):
        found = next((value for key, value in values if key == wanted and value), "")
        if found:
            return found
    parts = sorted({value for key, value in values if key == "cpu part"})
    return f"ARM cores of part {', '.join(parts)}" if parts else ""


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that affect the times."""
    return {"python": platform.python_version(), **package_versions()}


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""

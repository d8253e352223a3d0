"""Keeps values of the autopilot from one start of the service to the next.

The artificial wall is at AVOID_MARGIN or just outside of CP_DIST, and reading a parameter takes more than a second.
Without this file, a service that restarts in flight would meanwhile put the wall at a configured default, from which
the vehicle may back away. The newest values are kept in the state folder, with the kind and the system id of the
autopilot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from drivers.mavlink.session_types import Vehicle

from ..state_file import DAMAGED, StateFile
from .firmware_version import FirmwareVersion

NAME: Final = "autopilot.json"
KEPT: Final = {"AVOID_MARGIN": 100.0, "CP_DIST": 100.0}
"""Parameters that are kept, with the greatest accepted value. The least accepted value is above 0."""


@dataclass(frozen=True, slots=True)
class LastValues:
    """Values of one autopilot."""

    kind: str  # kind of the autopilot
    system_id: int  # MAVLink system
    version: FirmwareVersion | None = None  # version of its firmware; None: never read
    parameters: Mapping[str, float] = field(default_factory=dict)  # those of KEPT that were read


class LastValuesFile:
    """File of the last values: `of` returns those of the last start, `keep` writes new ones. folder None: nothing is
    kept."""

    def __init__(self, folder: Path | None) -> None:
        without = "a restart begins with configured defaults"
        self._file = None if folder is None else StateFile(folder / NAME, without, sync=True)
        self._kept = None if self._file is None else _read(self._file)

    def of(self, kind: str, system_id: int) -> LastValues:
        """Returns the values that were read last; none for another autopilot.

        While heartbeats contradict each other, kind names several autopilots, and the values of each of them count."""
        kept = self._kept
        if kept is not None and kept.system_id == system_id and kept.kind in kind.split(" or "):
            return kept
        return LastValues(kind, system_id)

    def expected(self) -> Vehicle | None:
        """Returns the autopilot of the last start as an armed vehicle; None: there was none."""
        kept = self._kept
        return None if kept is None else Vehicle(kept.system_id, kept.kind, 0, True, 0, heartbeat_ns=0)

    def keep(self, new: LastValues) -> None:
        """Keeps values that were read now; values that were not read are retained."""
        if self._file is None or self._file.busy:
            return
        old = self.of(new.kind, new.system_id)
        parameters = _accepted(dict(old.parameters) | dict(new.parameters))
        merged = LastValues(new.kind, new.system_id, new.version or old.version, parameters)
        if merged == old:
            return
        self._kept = merged
        self._file.write(_content(merged))

    def close(self) -> None:
        """Waits at most 0.5 s for a write in progress. May be called twice."""
        if self._file is not None:
            self._file.close()


def _accepted(parameters: Mapping[str, float]) -> dict[str, float]:
    """Returns the parameters of KEPT with a value in range. CP_DIST = -1 (collision prevention is off) is not kept."""
    return {n: v for n, v in parameters.items() if math.isfinite(v) and 0.0 < v <= KEPT.get(n, 0.0)}


def _read(file: StateFile) -> LastValues | None:
    """Returns the content of the file, without parameters out of range; None: no file, or not a valid one."""
    try:
        kept = file.read()
        version = None if kept["version"] is None else FirmwareVersion(*(int(n) for n in kept["version"]))
        parameters = {str(name): float(value) for name, value in kept["parameters"].items()}
        return LastValues(str(kept["autopilot"]), int(kept["system_id"]), version, _accepted(parameters))
    except DAMAGED:
        return None


def _content(kept: LastValues) -> dict[str, Any]:
    v = kept.version
    return {
        "autopilot": kept.kind,
        "system_id": kept.system_id,
        "version": None if v is None else [v.major, v.minor, v.patch],
        "parameters": dict(kept.parameters),
    }

"""Keeps the guard's memory in the state folder: it outlives the process, but not a reboot of the computer.

The file is written at each change and, while the guard is active, every REFRESH_NS, so that its age is the time since
the process ended. It is not synchronised to the disk: a power failure ends the boot for which it is valid."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

from drivers.suspended_time import suspended_ns
from osape_client.boot import boot_id

from ..state_file import DAMAGED, StateFile
from .states import GuardMemory, GuardState

NS = 1_000_000_000
NAME: Final = "guard.json"
REFRESH_NS: Final = 2 * NS
LIFE_NS: Final = 30 * NS
"""An older memory is not used: another station may have flown the vehicle meanwhile."""
BETWEEN_NS: Final = NS // 10
"""An age may be negative by less: two clocks are read one after the other, at the writing and at the reading."""


class GuardMemoryFile:
    """File of the guard's memory: `load` once, then `keep` at each step. folder None: nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self._file = (
            None if folder is None else StateFile(folder / NAME, "a restart in flight begins without it", sync=False)
        )
        self._kept: GuardMemory | None = None
        self._written_ns = 0
        self.loaded_ns: int | None = None
        """Instant at which the loaded memory was written, about the end of the earlier run; None: nothing was loaded."""

    def load(self, now_ns: int) -> GuardMemory | None:
        """Returns the memory of an earlier run of this boot; None: there is none, it is too old, or the file is not
        valid."""
        if self._file is None:
            return None
        try:
            content = self._file.read()
            age_ns = now_ns + suspended_ns() - int(content["written_ns"])
            if content["boot"] != boot_id() or not -BETWEEN_NS <= age_ns <= LIFE_NS:
                return None
            memory = _memory(content["memory"])
            self.loaded_ns = now_ns - age_ns
            return memory
        except DAMAGED:
            return None

    def keep(self, memory: GuardMemory, now_ns: int) -> None:
        """Writes the memory if it has changed or its file is old. While a write is in progress nothing is done; a
        later step writes."""
        active = memory.state is not GuardState.INACTIVE
        if self._file is None or (memory == self._kept and (not active or now_ns - self._written_ns < REFRESH_NS)):
            return
        if self._file.busy:
            return
        self._kept, self._written_ns = memory, now_ns
        written_ns = now_ns + suspended_ns()  # a time that does not stand still in a suspension
        self._file.write({"boot": boot_id(), "written_ns": written_ns, "memory": asdict(memory)})

    def close(self) -> None:
        """Waits at most 0.5 s for a write in progress. May be called twice."""
        if self._file is not None:
            self._file.close()


def _memory(content: Any) -> GuardMemory:
    """Converts the content of the file. Raises ValueError, TypeError or LookupError if fields are missing, unknown or
    of another type."""
    known = {f.name: f for f in fields(GuardMemory)}
    if set(content) != set(known):
        raise ValueError(f"fields {sorted(content)}")
    values = dict(content)
    values["state"] = GuardState(values["state"])
    values["stop_modes"] = tuple(int(mode) for mode in values["stop_modes"])
    default = GuardMemory()
    for name, value in values.items():
        kind = type(getattr(default, name))
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            values[name] = value = float(value)
        if type(value) is not kind:
            raise TypeError(f"{name}: {value!r}")
        if kind is float and not 0.0 <= value < math.inf:  # also NaN: it would be sent as a speed
            raise ValueError(f"{name}: {value!r}")
    return GuardMemory(**values)

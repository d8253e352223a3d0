"""The guard's memory in the state folder: it outlives a kill of the process, not a reboot of the computer.

Written at each change and, while the guard does anything, every REFRESH_NS, so that the age of the file is the time since the
process ended. It is not synchronised to the disk: what a power failure loses belongs to a boot that is over. A thread of its own
writes, so that a slow disk neither delays a command nor counts as a guard that hangs."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

from drivers.watched_thread import WatchedThread
from osape_client.boot import boot_id

from .states import GuardMemory, GuardState

log = logging.getLogger("companion")

NS = 1_000_000_000
NAME: Final = "guard.json"
REFRESH_NS: Final = 2 * NS
LIFE_NS: Final = 30 * NS
"""After a longer time another station may have flown the vehicle: the memory is not used."""
_MOST_BYTES: Final = 4000


class GuardMemoryFile:
    """`load` once, then `keep` at each step. folder None: nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self._file = None if folder is None else folder / NAME
        self._kept: GuardMemory | None = None
        self._written_ns = 0
        self.loaded_ns: int | None = None
        """Instant at which the loaded memory was written, about the end of the earlier run; None: nothing was loaded."""
        self._warned = False
        self._writing: WatchedThread | None = None

    def load(self, now_ns: int) -> GuardMemory | None:
        """The memory of an earlier run of this boot; None: there is none, it is too old, or this module did not write it."""
        if self._file is None:
            return None
        try:
            with self._file.open("rb") as stream:
                content = json.loads(stream.read(_MOST_BYTES))
            if content["boot"] != boot_id() or not 0 <= now_ns - int(content["written_ns"]) <= LIFE_NS:
                return None
            memory = _memory(content["memory"])
            self.loaded_ns = int(content["written_ns"])
            return memory
        except (OSError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError):
            return None

    def keep(self, memory: GuardMemory, now_ns: int) -> None:
        """Writes the memory where it has changed, or is old. While a write is under way nothing is done: a later step keeps
        what is new then."""
        active = memory.state is not GuardState.INACTIVE
        if self._file is None or (memory == self._kept and (not active or now_ns - self._written_ns < REFRESH_NS)):
            return
        if self._writing is not None and self._writing.is_alive():
            return
        self._kept, self._written_ns = memory, now_ns
        content = {"boot": boot_id(), "written_ns": now_ns, "memory": asdict(memory)}
        self._writing = WatchedThread(self._write, "guard memory", (self._file, json.dumps(content)))
        self._writing.start()

    def close(self) -> None:
        """Waits at most 0.5 s for what is being written. May be called twice."""
        if self._writing is not None:
            self._writing.join(0.5)

    def _write(self, file: Path, content: str) -> None:
        new = file.with_name(file.name + ".new")
        try:
            new.write_text(content, encoding="utf-8")
            new.replace(file)
        except OSError as error:
            if not self._warned:
                self._warned = True
                log.warning("%s cannot be written (%s): a restart in flight begins without it", file, error.strerror)


def _memory(content: Any) -> GuardMemory:
    """Raises ValueError, TypeError or LookupError where a field is missing, has another type or another name."""
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
    return GuardMemory(**values)

"""The autopilot's AVOID_MARGIN from one start to the next.

The blind policy's wall stands at AVOID_MARGIN, which takes a second to be read. A service that is started again in flight
would meanwhile put the wall at the configured default: nearer than the margin the vehicle backs away from it. What was
read last is therefore kept in the state folder, with the autopilot that it belongs to."""

from __future__ import annotations

import json
import logging
import math
import os
from pathlib import Path
from typing import Final

from drivers.watched_thread import WatchedThread

log = logging.getLogger("companion")

NAME: Final = "avoid_margin.json"
_MOST_BYTES: Final = 1000
_MOST_M: Final = 100.0


class MarginFile:
    """`margin_m` of an autopilot at the last start, `keep` what is read now. folder None: nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self._file = None if folder is None else folder / NAME
        self._kept = None if self._file is None else _read(self._file)
        self._writing: WatchedThread | None = None

    def margin_m(self, kind: str, system_id: int) -> float | None:
        """AVOID_MARGIN of this autopilot as it was read last, metres; None: never."""
        if self._kept is None or self._kept[:2] != (kind, system_id):
            return None
        return self._kept[2]

    def keep(self, kind: str, system_id: int, margin_m: float) -> None:
        """What the autopilot says now. Written by a thread of its own where it is new: a slow disk stops nobody."""
        new = (kind, system_id, margin_m)
        if self._file is None or new == self._kept or (self._writing is not None and self._writing.is_alive()):
            return
        self._kept = new
        self._writing = WatchedThread(_write, "margin", (self._file, new))
        self._writing.start()

    def close(self) -> None:
        """Waits a moment for what is being written. May be called twice."""
        if self._writing is not None:
            self._writing.join(0.5)


def _read(file: Path) -> tuple[str, int, float] | None:
    """What the file holds; None where there is none, or nothing that we wrote."""
    try:
        with file.open("rb") as stream:
            kept = json.loads(stream.read(_MOST_BYTES))
        kind, system_id, margin_m = str(kept["autopilot"]), int(kept["system_id"]), float(kept["avoid_margin_m"])
    except (OSError, ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return None
    return (kind, system_id, margin_m) if math.isfinite(margin_m) and 0.0 < margin_m <= _MOST_M else None


def _write(file: Path, kept: tuple[str, int, float]) -> None:
    new = file.with_name(file.name + ".new")
    kind, system_id, margin_m = kept
    text = json.dumps({"autopilot": kind, "system_id": system_id, "avoid_margin_m": margin_m})
    try:
        with new.open("w") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        new.replace(file)
    except OSError as error:
        log.warning(
            "AVOID_MARGIN cannot be kept in %s (%s): a restart begins with avoid_margin_m", file, error.strerror
        )

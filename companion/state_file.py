"""A small JSON file in the state folder that outlives the process."""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import Any, Final

from drivers.watched_thread import WatchedThread

log = logging.getLogger("companion")

DAMAGED: Final = (OSError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError)
"""What the reading of a missing or damaged file and the conversion of its content raise."""
_MOST_BYTES: Final = 4000


class StateFile:
    """A file that a thread of its own writes, so that a slow disk delays nothing."""

    def __init__(self, path: Path, without: str, *, sync: bool) -> None:
        """without: what a restart does without the file, for the warning. sync: the file must survive a power failure."""
        self._path, self._without, self._sync = path, without, sync
        self._warned = False
        self._writing: WatchedThread | None = None

    def read(self) -> Any:
        """Returns the content. Raises errors of DAMAGED."""
        with self._path.open("rb") as stream:
            return json.loads(stream.read(_MOST_BYTES))

    @property
    def busy(self) -> bool:
        """True while a write is in progress; `write` must not be called then."""
        return self._writing is not None and self._writing.is_alive()

    def write(self, content: dict[str, Any]) -> None:
        """Begins to write. A file that cannot be written is named in the log, once."""
        writing = WatchedThread(self._write, f"write {self._path.name}", (json.dumps(content),))
        try:
            writing.start()
        except RuntimeError as error:  # memory or threads are short, which must not end the caller
            self._warn(str(error))
        else:
            self._writing = writing

    def close(self) -> None:
        """Waits at most 0.5 s for a write in progress. May be called twice."""
        if self._writing is not None:
            self._writing.join(0.5)

    def _write(self, text: str) -> None:
        new = self._path.with_name(self._path.name + ".new")
        try:
            with new.open("w", encoding="utf-8") as stream:
                stream.write(text)
                if self._sync:
                    stream.flush()
                    os.fsync(stream.fileno())
            new.replace(self._path)
        except OSError as error:
            self._warn(str(error.strerror))

    def _warn(self, cause: str) -> None:
        if not self._warned:
            self._warned = True
            log.warning("%s cannot be written (%s): %s", self._path, cause, self._without)

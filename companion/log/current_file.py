"""The log file that is being written: begun, rotated, finished, and begun anew where it was taken away."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.types import CameraInfo
from osape_client.proto import osape_v1_pb2 as pb

from ..config.service import RecordParams
from ..pipeline.pipeline import PipelineState
from .log_directory import free_bytes, make_room, part_path, used_bytes
from .log_writer import LogWriter
from .repair import Repairs

NS: Final = 1_000_000_000


class LogRemovedError(OSError):
    """The file or its folder was deleted, moved or renamed while it was written."""


@dataclass(frozen=True, slots=True, eq=False)
class Begin:
    """What a file opens with."""

    t_ns: int
    cameras: tuple[CameraInfo, ...]
    state: PipelineState


class CurrentLog:
    """The file being written, of a flight in a folder. repairs: what goes on beside it, and stops where it needs the room."""

    def __init__(self, folder: Path, flight: str, run: pb.RunInfo, params: RecordParams, repairs: Repairs) -> None:
        self._folder, self._flight, self._run, self._params = folder, flight, run, params
        self._repairs = repairs
        self._log: LogWriter | None = None
        self._begun_ns = self._synced_ns = 0
        self.files = 0
        self._finished_bytes = 0

    @property
    def path(self) -> Path | None:
        """Of the file being written."""
        return self._log.active_path if self._log is not None else None

    @property
    def total_bytes(self) -> int:
        """Written in this flight."""
        return self._finished_bytes + (self._log.bytes_written if self._log is not None else 0)

    @property
    def wants_successor(self) -> bool:
        """Whether the file is large or old enough."""
        if self._log is None:
            return False
        old = time.monotonic_ns() - self._begun_ns > self._params.file_s * NS
        return old or self._log.bytes_written > self._params.file_mb * 1e6

    def begin(self, item: Begin) -> None:
        """Finishes the file before and opens the next, in a folder that is made anew where it is gone. Raises OSError, also
        where the disk is nearly full."""
        self.finish()
        self._folder.mkdir(parents=True, exist_ok=True)
        params = self._params
        # room for this file is made before it needs it, and a repair has to give way
        if not self._has_budget(0) and not (self._repairs.stop("the recording needs the room") and self._has_budget(0)):
            raise OSError(f"this flight's logs have spent the budget of {params.budget_mb:g} MB")
        if not self._has_disk(0) and not (self._repairs.stop("the recording needs the room") and self._has_disk(0)):
            raise OSError(f"less than {params.least_free_mb:g} MB free on the disk; make room for logs")
        path = part_path(self._folder, self._flight, self.files)
        self._log = LogWriter(path, level=params.zstd_level)
        self.files += 1
        self._begun_ns = self._synced_ns = time.monotonic_ns()
        self._log.begin(self._run, item.cameras, item.state, item.t_ns)

    def room_for(self, size: int) -> bool:
        """Whether a copy of so many bytes fits the budget and the disk beside this file. Makes room as for a new file."""
        return self._has_budget(size) and self._has_disk(size + round(self._params.file_mb * 1e6))

    def _has_budget(self, size: int) -> bool:
        budget = max(0, round((self._params.budget_mb - self._params.file_mb) * 1e6) - size)
        self._repairs.files_deleted(make_room(self._folder, budget, self._flight))
        return used_bytes(self._folder) <= budget

    def _has_disk(self, size: int) -> bool:
        return free_bytes(self._folder) - size >= self._params.least_free_mb * 1e6

    def write(self, write: Callable[[LogWriter], None]) -> None:
        """Into the file, if there is one."""
        if self._log is not None:
            write(self._log)

    def sync(self) -> None:
        """Once a second everything written goes to the disk itself. Raises OSError, LogRemovedError where nobody would
        find the file."""
        now_ns = time.monotonic_ns()
        if self._log is not None and now_ns - self._synced_ns >= NS:
            self._log.sync()
            self._synced_ns = now_ns
            if not self._log.in_place:
                raise LogRemovedError(f"{self._log.active_path} was deleted or moved away; a new file is begun")

    def finish(self) -> None:
        """Ends the file and gives it its name."""
        if self._log is not None:
            log, self._log = self._log, None
            log.finish()
            self._finished_bytes += os.path.getsize(log.path)

    def abandon(self) -> None:
        """Leaves the file as .active: what was written of it can be recovered."""
        if self._log is not None:
            log, self._log = self._log, None
            log.abandon()

"""The log file being written: opened, rotated, finished, and replaced when it was deleted or moved."""

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
from ..pipeline.state import PipelineState
from .log_directory import free_bytes, make_room, new_flight, part_path, used_bytes
from .log_file import CHUNK_BYTES, FileInUseError, UnfinishedLogError
from .log_writer import LogWriter
from .repair import Repairs

NS: Final = 1_000_000_000
_NAMES_TRIED: Final = 10
FINISH_BYTES: Final = 8 * CHUNK_BYTES
"""More than `finish` writes: the open chunk and the summary, of 300 bytes for each chunk."""


class LogRemovedError(OSError):
    """The file or its directory was deleted, moved or renamed while it was written."""


@dataclass(frozen=True, slots=True, eq=False)
class Begin:
    """The content at the beginning of a file."""

    t_ns: int
    cameras: tuple[CameraInfo, ...]
    state: PipelineState
    idle: bool = False  # the vehicle is disarmed


def begin_bytes(params: RecordParams) -> int:
    """Returns the disk space that must be free, beside least_free_mb, to begin a file: for what may wait, so that it does not end
    at once."""
    return round(params.queue_mb * 1e6) + FINISH_BYTES


class CurrentLog:
    """The current file of a flight in a directory. flight: its name; empty: chosen when the first file is begun. repairs: a
    repair that runs beside it and is stopped when disk space is needed."""

    def __init__(self, folder: Path, flight: str, run: pb.RunInfo, params: RecordParams, repairs: Repairs) -> None:
        self._folder, self.flight, self._run, self._params = folder, flight, run, params
        self._repairs = repairs
        self._log: LogWriter | None = None
        self._begun_ns = self._synced_ns = 0
        self.files = 0
        self._finished_bytes = 0

    @property
    def path(self) -> Path | None:
        """Path of the file being written."""
        return self._log.active_path if self._log is not None else None

    @property
    def total_bytes(self) -> int:
        """Bytes written in this flight."""
        return self._finished_bytes + (self._log.bytes_written if self._log is not None else 0)

    @property
    def wants_successor(self) -> bool:
        """Whether the file has reached its size or age limit."""
        if self._log is None:
            return False
        old = time.monotonic_ns() - self._begun_ns > self._params.file_s * NS
        return old or self._log.bytes_written > self._params.file_mb * 1e6

    def begin(self, item: Begin) -> None:
        """Finishes the previous file and opens the next; creates a missing directory. Raises OSError, also where the disk
        has less free space than `begin_bytes` beside least_free_mb."""
        self.finish()
        self._folder.mkdir(parents=True, exist_ok=True)
        params = self._params
        # space is freed before this file needs it
        if not self._fits(lambda: self._has_budget(0)):
            raise OSError(
                f"the budget of {params.budget_mb:g} MB is used by logs of this flight, or by ones that cannot be deleted; raise "
                "[record] budget_mb, or move logs to another disk"
            )
        self._require_disk(begin_bytes(params))
        self._log = self._open(item.idle)
        self.files += 1
        self._begun_ns = time.monotonic_ns()
        self._synced_ns = 0  # the first items at once: without a complete chunk nothing of a file can be recovered
        self._log.begin(self._run, item.cameras, item.state, item.t_ns)

    def _open(self, idle: bool) -> LogWriter:
        """Another service that records into this directory may choose the same name in the same second."""
        for _ in range(_NAMES_TRIED):
            flight = self.flight or new_flight(self._folder)
            try:
                log = LogWriter(part_path(self._folder, flight, self.files, idle), level=self._params.zstd_level)
            except (FileInUseError, UnfinishedLogError):
                if self.flight:
                    raise
                continue
            self.flight = flight
            return log
        raise OSError(f"{self._folder}: other processes take each name; give each service its own [record] folder")

    def keep_free(self, size: int) -> None:
        """Finishes the file where the disk has no space for `size` more bytes, and raises OSError."""
        if self._log is None:
            return
        try:
            self._require_disk(size + FINISH_BYTES)
        except FileNotFoundError:
            pass  # the directory was deleted or moved, which `sync` finds
        except OSError:
            self.finish()
            raise

    def _require_disk(self, size: int) -> None:
        """Raises OSError where `size` more bytes would leave less free than least_free_mb."""
        if not self._fits(lambda: self._has_disk(size)):
            needed_mb = self._params.least_free_mb + size / 1e6
            raise OSError(
                f"{self._folder}: less than {needed_mb:.0f} MB free on its disk, of which [record] least_free_mb = "
                f"{self._params.least_free_mb:g} stay free; free disk space"
            )

    def _fits(self, has_space: Callable[[], bool]) -> bool:
        """Whether there is space, if necessary without the copy of a repair."""
        return has_space() or (self._repairs.stop("the recording needs the disk space") and has_space())

    def room_for(self, size: int) -> bool:
        """Whether a copy of `size` bytes fits the budget and the disk beside this file. Frees space as for a new file."""
        return self._has_budget(size) and self._has_disk(size + round(self._params.file_mb * 1e6))

    def _has_budget(self, size: int) -> bool:
        budget = max(0, round((self._params.budget_mb - self._params.file_mb) * 1e6) - size)
        self._repairs.files_deleted(make_room(self._folder, budget, self.flight))
        return used_bytes(self._folder) <= budget

    def _has_disk(self, size: int) -> bool:
        return free_bytes(self._folder) - size >= self._params.least_free_mb * 1e6

    def write(self, write: Callable[[LogWriter], None]) -> None:
        """Writes to the file, if one is open."""
        if self._log is not None:
            write(self._log)

    def sync(self) -> None:
        """Flushes the file to the disk once per second. Raises OSError, and LogRemovedError where the file was deleted
        or moved."""
        now_ns = time.monotonic_ns()
        if self._log is not None and now_ns - self._synced_ns >= NS:
            self._log.sync()
            self._synced_ns = now_ns
            if not self._log.in_place:
                raise LogRemovedError(f"{self._log.active_path} was deleted or moved; a new file is begun")

    def finish(self) -> None:
        """Finishes the file and gives it its final name."""
        if self._log is not None:
            log, self._log = self._log, None
            try:
                log.finish()
            except OSError:
                log.abandon()
                raise
            self._finished_bytes += os.path.getsize(log.path)

    def abandon(self) -> None:
        """Leaves the file as .active; its content can be recovered."""
        if self._log is not None:
            log, self._log = self._log, None
            log.abandon()

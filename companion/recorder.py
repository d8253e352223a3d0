"""Records the flight: a thread of its own behind a bounded queue. The pipeline never waits for the disk.

Every file opens with the state that its frames depend on, so each replays by itself. When something had to be dropped
(a slow disk, a full one), all that follows is dropped too and counted, until a new file can open with a new state: a log
has no holes that a replay would not notice."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from google.protobuf.message import Message

from core.types import CameraInfo, DepthFrame
from drivers.base import Event
from drivers.proto import osape_v1_pb2 as pb

from .config_live import RecordParams
from .events import RawFrame
from .log_folder import files_of, free_bytes, make_room, new_flight, part_path, repair
from .log_writer import LogWriter
from .pipeline import Output, PipelineState

NS: Final = 1_000_000_000
RETRY_NS: Final = 5 * NS
"""After a failure, before a new file is tried."""
_SMALL: Final = 512
"""Bytes that a sample or a decision counts for in the queue."""
_RESULT: Final = 20_000
_WAKE_BYTES: Final = 100_000
_WAKE_ITEMS: Final = 64
_IDLE_S: Final = 0.2
"""What waits is written at least so often, be it much or little."""
_AFTER_S: Final = 0.001
"""So long after a frame was handed over the work on it begins: whoever listens wakes up with its prisms just then, and
would wait 1 to 2 ms for the processor on which a chunk is compressed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordStatus:
    """How recording goes. trouble: in words, empty when there is none."""

    recording: bool = False
    file: str = ""
    files: int = 0
    bytes: int = 0
    queued: int = 0
    dropped: int = 0
    trouble: str = ""
    alive_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Begin:
    t_ns: int
    cameras: tuple[CameraInfo, ...]
    state: PipelineState


@dataclass(frozen=True, slots=True, eq=False)
class _Item:
    write: Callable[[LogWriter], None]


class Recorder:
    """`begin`, `event`, `output`, `message` and `end` come from the pipeline's thread; `close` ends the last file.

    When `wants_begin`, call `begin` with the state at that moment."""

    def __init__(self, folder: Path, run: pb.RunInfo, params: RecordParams | None = None) -> None:
        self._folder, self._run_info, self._params = folder, run, params or RecordParams()
        self._queue: deque[_Begin | _Item | None] = deque()
        self._queued_bytes = 0
        self._held: list[_Begin | _Item | None] = []
        self._held_bytes = 0
        self._holding = False
        self._ready = threading.Condition()
        self._stop = False
        self._taking = self._begun = False
        self._wanting, self._not_before_ns = True, 0
        self._status = RecordStatus(alive_ns=time.monotonic_ns())
        self._dropped = 0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self.flight = ""

    def open(self) -> None:
        """Makes the folder and starts the thread. Raises OSError where the folder cannot be made."""
        self._folder.mkdir(parents=True, exist_ok=True)
        self.flight = new_flight(self._folder)
        self._thread.start()

    @property
    def status(self) -> RecordStatus:
        """How it goes now."""
        s = self._status
        return RecordStatus(
            recording=s.recording, file=s.file, files=s.files, bytes=s.bytes, queued=len(self._queue) + len(self._held),
            dropped=self._dropped, trouble=s.trouble, alive_ns=s.alive_ns,
        )  # fmt: skip

    @property
    def may_begin(self) -> bool:
        """Whether a new file can be begun now; after a failure not again for some seconds."""
        return time.monotonic_ns() >= self._not_before_ns

    @property
    def wants_begin(self) -> bool:
        """Whether a new file is to be begun now."""
        return self._wanting and self.may_begin

    # ---- from the pipeline ------------------------------------------------------------------------------------------

    def begin(self, t_ns: int, cameras: Iterable[CameraInfo], state: PipelineState) -> None:
        """From here on into a new file, which opens with this state."""
        self._begun = True
        self._taking = self._put(_Begin(t_ns, tuple(cameras), state), _SMALL)
        self._wanting = not self._taking

    def end(self) -> None:
        """Nothing more until the next begin: the vehicle was disarmed."""
        self._taking = False
        self._put(None, 0)

    def event(self, event: Event) -> None:
        """What came from the hardware."""
        if isinstance(event, DepthFrame):
            if self._params.depth:
                self._take(lambda log: log.event(event), event.depth_mm.nbytes)
        else:
            self._take(lambda log: log.event(event), _SMALL)

    def events(self, events: Sequence[Event]) -> None:
        """The same of several samples: one thing in the queue."""

        def write(log: LogWriter) -> None:
            for event in events:
                log.event(event)

        self._take(write, len(events) * _SMALL, len(events))

    def frames(self, frames: Sequence[RawFrame]) -> None:
        """What came on the autopilot's line."""

        def write(log: LogWriter) -> None:
            for raw in frames:
                log.write("mavlink", pb.MavlinkFrame(frame=raw.data), raw.t_arrival_ns)

        self._take(write, sum(len(raw.data) + _SMALL for raw in frames), len(frames))

    def output(self, output: Output, prisms: bytes | None = None) -> None:
        """What the pipeline said; prisms: the bytes of its message, where they are known already."""
        drawn = self._params.drawings
        self._take(lambda log: log.output(output, drawn, drawn, prisms), _RESULT)

    def message(self, key: str, message: Message, t_ns: int) -> None:
        """Another message of the table of topics."""
        self._take(lambda log: log.write(key, message, t_ns), message.ByteSize() + _SMALL)

    @contextmanager
    def holding(self) -> Iterator[None]:
        """What is said meanwhile is handed to the thread at the end, so that it does not begin to work beside a frame
        that is not published yet."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False
            self._hand_over()

    def _take(self, write: Callable[[LogWriter], None], size: int, count: int = 1) -> None:
        """count: how many messages it is, where they are dropped."""
        if not self._taking:
            # not while nothing is to be recorded, nor before the first camera, when there is nothing to begin with
            self._dropped += count if self._wanting and self._begun else 0
            return
        if not self._put(_Item(write), size, count):
            self._taking = False
            self._wanting = True

    def _put(self, item: _Begin | _Item | None, size: int, count: int = 1) -> bool:
        waiting = len(self._queue) + len(self._held)
        waiting_bytes = self._queued_bytes + self._held_bytes + size
        full = waiting >= self._params.queue_items or waiting_bytes > self._params.queue_mb * 1e6
        if full and item is not None:
            self._dropped += count
            return False
        self._held.append(item)
        self._held_bytes += size
        if not self._holding:
            self._hand_over()
        return True

    def _hand_over(self) -> None:
        """Wakes the thread for a frame or for many samples; for a few it comes by itself, some times a second."""
        with self._ready:
            self._queue.extend(self._held)
            self._queued_bytes += self._held_bytes
            if self._much:
                self._ready.notify()
        self._held.clear()
        self._held_bytes = 0

    @property
    def _much(self) -> bool:
        return self._queued_bytes >= _WAKE_BYTES or len(self._queue) >= _WAKE_ITEMS

    def close(self) -> None:
        """Writes what is queued, finishes the file and ends. May be called twice."""
        self._hand_over()
        with self._ready:
            self._stop = True
            self._ready.notify()
        if self._thread.ident is not None:
            self._thread.join(30.0)

    # ---- the thread ---------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        said = repair(self._folder, self.flight)
        current = _Current(self._folder, self.flight, self._run_info, self._params)
        trouble = ""
        while True:
            items = self._next_items()
            if items is None:
                break
            try:
                for item in items:
                    if isinstance(item, _Begin):
                        current.begin(item)
                        trouble = ""
                    elif item is None:
                        current.finish()
                    else:
                        current.write(item)
                current.sync()
            except (OSError, ValueError) as error:
                trouble = f"recording stopped: {getattr(error, 'strerror', None) or error}"
                current.abandon()
                self._not_before_ns = time.monotonic_ns() + RETRY_NS
                self._taking, self._wanting = False, True
                self._dropped += 1
            if current.wants_successor and self._taking:
                self._wanting = True
            self._status = RecordStatus(
                recording=current.path is not None, file=str(current.path or ""), files=current.files,
                bytes=current.total_bytes, trouble=trouble or "; ".join(s for s in said if "left as it is" in s),
                alive_ns=time.monotonic_ns(),
            )  # fmt: skip
        try:
            current.finish()
        except OSError as error:
            self._status = RecordStatus(trouble=f"the last file stays .active: {error.strerror}")

    def _next_items(self) -> list[_Begin | _Item | None] | None:
        """What is queued, waiting a little for it; None at the end."""
        with self._ready:
            idle = not self._stop and not self._much
            if idle and self._ready.wait(_IDLE_S) and not self._stop:
                self._ready.wait(_AFTER_S)
            if not self._queue and self._stop:
                return None
            items = list(self._queue)
            self._queue.clear()
            self._queued_bytes = 0
            return items


class _Current:
    """The file being written."""

    def __init__(self, folder: Path, flight: str, run: pb.RunInfo, params: RecordParams) -> None:
        self._folder, self._flight, self._run, self._params = folder, flight, run, params
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

    def begin(self, item: _Begin) -> None:
        """Finishes the file before and opens the next. Raises OSError, also where the disk is nearly full."""
        self.finish()
        # room for this file is made before it needs it
        budget = max(0, round((self._params.budget_mb - self._params.file_mb) * 1e6))
        make_room(self._folder, budget, self._flight)
        if sum(f.bytes for f in files_of(self._folder)) > budget:
            raise OSError(f"this flight's logs have spent the budget of {self._params.budget_mb:g} MB")
        if free_bytes(self._folder) < self._params.least_free_mb * 1e6:
            raise OSError(f"less than {self._params.least_free_mb:g} MB free on the disk; make room for logs")
        path = part_path(self._folder, self._flight, self.files)
        self._log = LogWriter(path, level=self._params.zstd_level)
        self.files += 1
        self._begun_ns = self._synced_ns = time.monotonic_ns()
        self._log.begin(self._run, item.cameras, item.state, item.t_ns)

    def write(self, item: _Item) -> None:
        """Into the file, if there is one."""
        if self._log is not None:
            item.write(self._log)

    def sync(self) -> None:
        """Once a second everything written goes to the disk itself."""
        now_ns = time.monotonic_ns()
        if self._log is not None and now_ns - self._synced_ns >= NS:
            self._log.sync()
            self._synced_ns = now_ns

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

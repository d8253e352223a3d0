"""Records a flight in a thread of its own with a bounded queue. The pipeline never waits for the disk.

Every file begins with the state that its frames depend on, so it can be replayed alone. When an item has to be dropped
(slow or full disk), all following items are dropped and counted until a new file begins with a new state: a log has no
gap that a replay would miss."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from google.protobuf.message import Message

from core.types import CameraInfo, DepthFrame
from drivers.base import Event
from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb

from ..config.camera import OutputConfig
from ..config.service import RecordParams
from ..pipeline.events import RawMavlink
from ..pipeline.results import Output
from ..pipeline.state import PipelineState
from ..pipeline.tracking import TracksResult
from .current_file import Begin, CurrentLog, LogRemovedError
from .depth_rate import DepthRate
from .log_writer import LogWriter
from .record_queue import IDLE_S, RecordQueue
from .repair import Repairs

NS: Final = 1_000_000_000
RETRY_NS: Final = 5 * NS
"""Delay after a failure before a new file is tried."""
STALLED_NS: Final = 5 * NS
"""After a longer time without a completed write the disk is reported, and a stop does not wait for it."""
CLOSE_NS: Final = 30 * NS
"""Longest time to write the queued items at a stop."""
REPAIR_AFTER_NS: Final = 10 * NS
"""Unfinished files of earlier runs are repaired once this flight is being recorded, or after this time without
recording."""
_SMALL: Final = 512
"""Queue size of a sample or a decision, bytes."""
_RESULT: Final = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordStatus:
    """State of the recording."""

    recording: bool = False
    file: str = ""
    files: int = 0
    bytes: int = 0
    queued: int = 0
    dropped: int = 0
    fault: str = ""  # as text, empty: none
    repairing: str = ""  # name of the earlier file being repaired, empty: none
    alive_ns: int = 0


_Write = Callable[[LogWriter], None]
_Item = Begin | _Write | None
"""What waits for the thread: a file to begin, something to write; None: the file ends."""


class Recorder:
    """The pipeline thread calls `begin`, `event`, `output`, `message` and `end`; `close` finishes the last file.

    When `wants_begin`, the caller calls `begin` with the present state. One lock, that of the queue, guards all shared
    fields."""

    def __init__(
        self, folder: Path, run: pb.RunInfo, params: RecordParams | None = None, output: OutputConfig | None = None
    ) -> None:
        """output: whether drawings and transforms for viewers are recorded."""
        self._folder, self._run_info, self._params = folder, run, params or RecordParams()
        self._drawn = output or OutputConfig()
        self._queue: RecordQueue[_Item] = RecordQueue(self._params.queue_items, self._params.queue_mb * 1e6)
        self._accepting = self._started_once = self._begin_waits = False
        self._start_wanted, self._not_before_ns = True, 0
        self._status = RecordStatus(alive_ns=time.monotonic_ns())
        self._dropped = 0
        self._repairs = Repairs(folder)
        self._thread = WatchedThread(self._work, "recorder")
        self._depth_rate = DepthRate(self._params.depth_hz)
        self.flight = ""

    def open(self) -> None:
        """Starts the thread. A directory that cannot be used is a fault in `status`, and tried again."""
        self._thread.start()

    @property
    def status(self) -> RecordStatus:
        """The present state."""
        with self._queue.lock:
            status = replace(self._status, queued=self._queue.waiting, dropped=self._dropped)
        if self._thread.failure:
            fault = (
                f"recording has ended ({self._thread.failure}); restart the service; `companion recover` completes "
                "the last file"
            )
            return replace(status, recording=False, fault=fault)
        stalled_ns = self._stalled_ns()
        if stalled_ns > STALLED_NS:
            fault = (
                f"{self._folder}: the disk has not taken the log for {stalled_ns / NS:.0f} s: what is recorded now may be "
                "lost; check it and its cable, or use another [record] folder"
            )
            return replace(status, fault=fault)
        return status

    def _stalled_ns(self) -> int:
        """Time for which the thread has been writing; 0: it has ended, or was not started."""
        return time.monotonic_ns() - self._status.alive_ns if self._thread.is_alive() else 0

    @property
    def may_begin(self) -> bool:
        """Whether a new file can begin now; not for RETRY_NS after a failure."""
        with self._queue.lock:
            return time.monotonic_ns() >= self._not_before_ns

    @property
    def wants_begin(self) -> bool:
        """Whether a new file should begin now."""
        with self._queue.lock:
            return self._start_wanted and self.may_begin

    # ---- from the pipeline ------------------------------------------------------------------------------------------

    def begin(self, t_ns: int, cameras: Iterable[CameraInfo], state: PipelineState, idle: bool = False) -> None:
        """Begins a new file with this state. idle: the vehicle is disarmed; the budget deletes such files first."""
        with self._queue.lock:
            self._started_once = True
            self._accepting = self._begin_waits = self._append(Begin(t_ns, tuple(cameras), state, idle), _SMALL)
            self._start_wanted = not self._accepting

    def end(self) -> None:
        """Ends the file: the vehicle was disarmed."""
        with self._queue.lock:
            self._accepting = False
            self._append(None, 0)

    def event(self, event: Event) -> None:
        """Records an event of the hardware."""
        size = event.depth_mm.nbytes if isinstance(event, DepthFrame) else _SMALL
        self._enqueue(lambda log: log.event(event), size)

    def keeps_depth(self, camera: str, t_exposure_ns: int) -> bool:
        """Whether to record this depth image. To be asked once per image."""
        return self._params.depth and self._depth_rate.keeps(camera, t_exposure_ns)

    @property
    def skips_depth(self) -> bool:
        """Whether images between recorded ones are left out: each recorded one then needs the state before it."""
        return self._depth_rate.limited

    def events(self, events: Sequence[Event]) -> None:
        """Records several samples as one queue item."""

        def write(log: LogWriter) -> None:
            for event in events:
                log.event(event)

        self._enqueue(write, len(events) * _SMALL, len(events))

    def mavlink(self, messages: Sequence[RawMavlink]) -> None:
        """Records MAVLink messages."""

        def write(log: LogWriter) -> None:
            for raw in messages:
                log.write("mavlink", pb.MavlinkFrame(frame=raw.data), raw.t_arrival_ns)

        self._enqueue(write, sum(len(raw.data) + _SMALL for raw in messages), len(messages))

    def output(self, output: Output, prisms: bytes | None = None) -> None:
        """Records an output of the pipeline. prisms: the encoded message, if available."""
        drawn = self._drawn
        self._enqueue(lambda log: log.output(output, drawn.scene, drawn.transforms, prisms), _RESULT)

    def tracks(self, result: TracksResult, data: bytes) -> None:
        """Records the tracked obstacles after a frame. data: the encoded message."""
        self._enqueue(lambda log: log.tracks(result, data), len(data) + _SMALL)

    def message(self, key: str, message: Message, t_ns: int) -> None:
        """Records another message of the table of topics."""
        self._enqueue(lambda log: log.write(key, message, t_ns), message.ByteSize() + _SMALL)

    def deferred(self) -> AbstractContextManager[None]:
        """Passes the items recorded within the block to the thread at its end, so that the thread does not work while a
        frame is processed."""
        return self._queue.deferred()

    def _enqueue(self, write: _Write, size: int, count: int = 1) -> None:
        """count: number of messages, for the count of dropped ones."""
        with self._queue.lock:
            if not self._accepting:
                # nothing is dropped while recording is off, or before the first camera
                self._dropped += count if self._start_wanted and self._started_once else 0
            elif not self._append(write, size, count):
                self._accepting = False
                self._start_wanted = True

    def _append(self, item: _Item, size: int, count: int = 1) -> bool:
        """Adds an item to the queue; False: the queue is full. The end of a file is always added. The lock is held."""
        if self._queue.add(item, size, always=item is None):
            return True
        self._dropped += count
        return False

    def close(self) -> None:
        """Writes the queued items, finishes the file and ends; on a disk that does not respond the file stays .active. May be
        called twice."""
        self._queue.stop()
        until_ns = time.monotonic_ns() + CLOSE_NS
        while self._thread.is_alive() and self._stalled_ns() < STALLED_NS and time.monotonic_ns() < until_ns:
            self._thread.join(IDLE_S)

    # ---- the thread ---------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        repairs = self._repairs
        prepared = False
        current = CurrentLog(self._folder, self.flight, self._run_info, self._params, repairs)
        repair_ns = time.monotonic_ns() + REPAIR_AFTER_NS
        fault = ""
        try:
            while (queued := self._queue.take()) is not None:
                if not prepared:
                    fault = self._prepare(current.flight)
                    prepared = not fault
                fault = self._write(current, *queued, fault)
                self.flight = current.flight
                if current.path is not None or time.monotonic_ns() >= repair_ns:
                    with suppress(OSError):  # a deleted directory has nothing to repair
                        repairs.step(current.room_for)
                self._update_status(current, fault or repairs.fault)
        finally:
            repairs.stop()
        try:
            current.finish()
            self._status = replace(self._status, recording=False)
        except OSError as error:
            self._status = RecordStatus(
                fault=f"the last file remains .active: {_cause(error, self._folder)}; the next start repairs it"
            )

    def _prepare(self, flight: str) -> str:
        """Creates the directory and lists the repairs. Returns why that is not possible, "": it is done."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._repairs.begin(flight)
        except OSError as error:
            return f"recording stopped: {_cause(error, self._folder)}"
        return ""

    def _write(self, current: CurrentLog, items: Sequence[_Item], size: int, fault: str) -> str:
        """Writes the items, of `size` bytes, to the file. Returns why recording has stopped, "": it continues. fault: the
        previous fault."""
        try:
            current.keep_free(size)
            for item in items:
                if isinstance(item, Begin):
                    with self._queue.lock:
                        self._begin_waits = False
                    current.begin(item)
                    fault = ""
                elif item is None:
                    current.finish()
                else:
                    current.write(item)
            current.sync()
        except (OSError, ValueError) as error:
            fault = f"recording stopped: {_cause(error, self._folder)}"
            current.abandon()
            with self._queue.lock:
                # a removed file may be replaced at once
                wait_ns = 0 if isinstance(error, LogRemovedError) else RETRY_NS
                self._not_before_ns = time.monotonic_ns() + wait_ns
                self._accepting, self._start_wanted = False, True
                self._dropped += 1
        return fault

    def _update_status(self, current: CurrentLog, fault: str) -> None:
        with self._queue.lock:
            if current.wants_successor and self._accepting and not self._begin_waits:
                self._start_wanted = True
            self._status = RecordStatus(
                recording=current.path is not None,
                file=str(current.path or ""),
                files=current.files,
                bytes=current.total_bytes,
                fault=fault,
                repairing=self._repairs.repairing,
                alive_ns=time.monotonic_ns(),
            )


def _cause(error: Exception, folder: Path) -> str:
    """The text of an error; of one of the operating system with the place and the remedy."""
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    if error.errno == errno.EFBIG:
        remedy = "its disk, or a limit of this process, allows no larger file: reduce [record] file_mb"
    else:
        remedy = "check the disk, its mount and the rights of the directory"
    return f"{error.filename or folder}: {error.strerror}; {remedy}"

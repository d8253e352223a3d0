"""What the pipeline's thread records, and when a log file begins.

Calls of the recorder are collected while a frame is processed and made by `flush`, in their original order, so that
recording does not delay publication. Without a recorder nothing is recorded."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import Event
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource

from ..log.recorder import Recorder
from ..pipeline.events import LogMessage, RawMavlink, SupersededFrame, TimedItem
from ..pipeline.pipeline import Pipeline
from ..pipeline.results import Output
from ..pipeline.state_messages import state_message
from ..pipeline.tracking import TracksResult
from .health import clock_message


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockCallbacks:
    """Callbacks of the recording: the estimate of the autopilot's clock with its restarts, whether the vehicle is
    armed; None: not known."""

    clock: Callable[[], tuple[ClockEstimate, int]]
    armed: Callable[[], bool | None]


class LogFeed:
    """Used by the pipeline's thread alone, and by the one that has ended it."""

    def __init__(self, recorder: Recorder | None, record: str, callbacks: ClockCallbacks, pipeline: Pipeline) -> None:
        """record: `[record] record`. pipeline: the one whose state each file begins with."""
        self._recorder, self._record, self._callbacks, self._pipeline = recorder, record, callbacks, pipeline
        self._calls: list[Callable[[Recorder], None]] = []
        self._recording = self._idle_file = False
        self._described: tuple[CameraInfo, ...] = ()
        self._clock = ClockEstimate(ClockSource.NONE)

    def deferred(self) -> AbstractContextManager[None]:
        """See Recorder.deferred."""
        return nullcontext() if self._recorder is None else self._recorder.deferred()

    def flush(self) -> None:
        """Makes the collected calls."""
        calls, self._calls = self._calls, []
        for call in calls:
            assert self._recorder is not None
            call(self._recorder)

    def open_file(self, item: TimedItem) -> None:
        """Begins a log file where one is due: with the first frame, when the vehicle is armed, when the previous file
        is full or failed, when the vehicle is no longer disarmed as at the beginning of the file, and with the first frame
        after a camera was added or changed, since a log describes its cameras at its beginning."""
        if self._recorder is None:
            return
        armed = self._callbacks.armed()
        wanted = self._record == "always" or (self._record == "armed" and armed is True)
        if not wanted:
            if self._recording:
                self.flush()
                self._recorder.end()
            self._recording = False
            return
        frame = isinstance(item, DepthFrame | SupersededFrame)
        due = self._recorder.wants_begin if self._recording else frame
        if frame and self._described != self._pipeline.cameras:
            due = True
        if self._recording and self._idle_file and armed is not False:
            due = True
        if due and self._recorder.may_begin:
            self.flush()  # earlier items belong to the previous file
            self._recorder.begin(item.t_arrival_ns, self._pipeline.cameras, self._pipeline.state(), armed is False)
            self._idle_file = armed is False
            self._clock = ClockEstimate(ClockSource.NONE)
            self._recording, self._described = True, self._pipeline.cameras

    def clock(self, t_ns: int) -> None:
        """Records the estimate of the autopilot's clock after a change."""
        if self._recorder is None:
            return
        clock, restarts = self._callbacks.clock()
        if clock is not self._clock and clock != self._clock:
            self._clock = clock
            self._later(lambda log: log.message("clock", clock_message(clock, restarts), t_ns))

    def event(self, event: Event) -> None:
        """Records a sample or a frame. Where depth images are left out, each recorded one has the state before it, so
        that a replay gives the same result."""
        recorder = self._recorder
        if isinstance(event, DepthFrame) and recorder is not None:
            if not recorder.keeps_depth(event.camera, event.t_exposure_ns):
                return
            if recorder.skips_depth:
                state = self._pipeline.camera_state(event.camera)
                self._later(lambda log: log.message("state", state_message(state), event.t_arrival_ns))
        self._later(lambda log: log.event(event))

    def motion(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Records attitudes and positions."""
        self._later(lambda log: log.events(samples))

    def mavlink(self, messages: list[RawMavlink]) -> None:
        """Records MAVLink messages."""
        self._later(lambda log: log.mavlink(messages))

    def message(self, item: LogMessage) -> None:
        """Records a message of another part."""
        self._later(lambda log: log.message(item.key, item.message, item.t_arrival_ns))

    def output(self, output: Output, prisms: bytes | None) -> None:
        """Records a result. prisms: its encoded message; None: it has none."""
        self._later(lambda log: log.output(output, prisms))

    def tracks(self, tracks: TracksResult, data: bytes) -> None:
        """Records tracked obstacles. data: their encoded message."""
        self._later(lambda log: log.tracks(tracks, data))

    def _later(self, call: Callable[[Recorder], None]) -> None:
        """Collects a call of the recorder."""
        if self._recorder is not None:
            self._calls.append(call)

"""Cuts time spans out of a log. A clip begins with the state that its frames depend on, as every log does, so it can be
replayed alone with the same results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.types import DepthFrame
from drivers.base import BadData, Event
from drivers.logs.reader import EVENT_KEYS, LoggedMessage, McapRecording
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..kernels.warmup import ensure_compiled
from ..log.log_file import refuse_output
from ..log.log_writer import LogWriter
from ..log.provenance import run_info
from ..pipeline.configured import make_pipeline
from ..pipeline.pipeline import Pipeline
from ..replay.compare import key_of
from ..replay.recorded_run import decoded_state, opening_state, recorded_config, skipped_live

_OPENING: Final = ("run", "camera_info", "calibration")
"""Messages that `LogWriter.begin` writes."""


@dataclass(frozen=True, slots=True)
class Span:
    """A clip to cut: messages that arrived from begin_ns to end_ns."""

    begin_ns: int
    end_ns: int
    output: Path


def merged(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The spans in order, overlapping ones joined."""
    joined: list[tuple[int, int]] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        else:
            joined.append((begin, end))
    return joined


def cut(path: Path, spans: Sequence[Span], on_written: Callable[[Path], None]) -> str | None:
    """Writes the clips of a log, whose spans must not overlap, and calls `on_written` for each; returns the damage of the log,
    None: none. A span without a message gives no file. Where no clip is completed, what was at its place stays.

    The state at the beginning of a clip is computed with the configuration in the log from the frames before it. Raises
    BadData and ConfigError for a log that cannot be replayed, ValueError and OSError for an output that cannot be written."""
    for span in spans:
        refuse_output(span.output, path, replace=True)
    with McapRecording(path) as source:
        state, config = opening_state(source), recorded_config(source, otherwise="")
        if config.tracking.enabled:
            ensure_compiled("tracking")
        pipeline = make_pipeline(config, source.cameras, state)
        cutter = _Cutter(source, pipeline, sorted(spans, key=lambda s: s.begin_ns), on_written)
        ignored = skipped_live(path)
        try:
            for item in _until(source, cutter):
                if isinstance(item, LoggedMessage):
                    cutter.message(item)
                    continue
                cutter.event(item)
                if isinstance(item, DepthFrame) and key_of(item) in ignored:
                    continue
                for output in pipeline.handle(item):
                    pipeline.track(output)
            cutter.end()
        except BadData as error:
            cutter.complete()
            return str(error)
        finally:
            cutter.discard()
    return None


def _until(source: McapRecording, cutter: _Cutter) -> Iterator[Event | LoggedMessage]:
    """Events and messages in the order of the file, until all clips are cut."""
    others = [key for key in TOPICS if key not in EVENT_KEYS and key not in _OPENING]
    for item in source.events_with(*others):
        if cutter.finished:
            return
        yield item


class _Cutter:
    """Writes one clip after the other."""

    def __init__(
        self, source: McapRecording, pipeline: Pipeline, spans: Sequence[Span], on_written: Callable[[Path], None]
    ) -> None:
        self._source, self._pipeline, self._on_written = source, pipeline, on_written
        self._waiting = list(spans)
        self._log: LogWriter | None = None
        self._begun = False

    @property
    def finished(self) -> bool:
        """Whether all clips are written."""
        return not self._waiting

    def complete(self) -> None:
        """Completes the clip that is being written, if there is one."""
        if self._log is not None:
            self._log.finish()
            self._on_written(self._log.path)
            self._log = None

    def discard(self) -> None:
        """Deletes a clip that could not be completed: it would look like a short one."""
        if self._log is not None:
            self._log.discard()

    def end(self) -> None:
        """Ends all clips at the end of the log."""
        while self._waiting:
            self._end_clip()

    def _end_clip(self) -> None:
        self._waiting.pop(0)
        self.complete()

    def event(self, event: Event) -> None:
        """Takes an event before the pipeline handles it."""
        self._begun = True
        self._advance(event.t_arrival_ns)
        if self._log is not None:
            self._log.event(event)

    def message(self, item: LoggedMessage) -> None:
        """Takes a message. A state within the log is that of the frame after it."""
        if isinstance(item.message, pb.StateSnapshot):
            if not self._begun:
                return
            self._pipeline.resume(decoded_state(self._source, item.message))
        if self._log is not None:
            exposure_ns = getattr(item.message, "t_exposure_ns", None)
            self._log.write(item.key, item.message, item.t_log_ns, item.camera, item.sequence, exposure_ns)

    def _advance(self, t_ns: int) -> None:
        """Ends and begins clips."""
        while self._waiting and t_ns > self._waiting[0].end_ns:
            self._end_clip()
        if self._waiting and self._log is None and t_ns >= self._waiting[0].begin_ns:
            self._log = LogWriter(self._waiting[0].output)
            run = self._source.run or run_info("replay", recorded_config(self._source))
            self._log.begin(run, self._source.cameras, self._pipeline.state(), t_ns)

"""Runs a log through the pipeline and writes a log with prisms. The same input gives the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from core.types import CameraInfo, DepthFrame
from drivers.base import BadData, Event
from drivers.logs.reader import LoggedMessage, McapRecording
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..cameras.masks import masks_of, outside_text
from ..config.loader import Config, ConfigError, load_config
from ..config.obstacle_range import obstacle_range_m
from ..log.log_file import refuse_output
from ..log.log_writer import LogWriter
from ..log.provenance import run_info
from ..pipeline.configured import make_pipeline
from ..pipeline.encode import prisms_message, wire_bytes
from ..pipeline.pipeline import Pipeline
from ..pipeline.results import Output, PrismsResult
from ..pipeline.state import PipelineState
from ..pipeline.track_messages import tracks_message
from ..pipeline.tracking import TracksResult
from ..self_check.exposure_monitor import ExposureOffsetMonitor
from .compare import Comparison, Key, key_of
from .recorded_run import decoded_state, opening_state, readable_recorded_config, recorded_config, skipped_live
from .replay_report import Replay, depth_note
from .summary import ReplayCounts


def process(
    events: Iterable[Event], pipeline: Pipeline, counts: ReplayCounts
) -> Iterator[tuple[Event, tuple[Output, ...]]]:
    """Yields each event with its outputs and counts both."""
    for event in events:
        outputs = pipeline.handle(event)
        counts.event(event)
        for output in outputs:
            counts.output(output)
        yield event, outputs


class Observer(Protocol):
    """Receives the results of a replay, and messages of the log, in file order."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The kinds of messages (keys of TOPICS) to receive."""

    def begin(self, source: McapRecording, config: Config) -> None:
        """Called first. config: the configuration in use."""

    def logged(self, item: LoggedMessage) -> None:
        """Called for a message of the log."""

    def output(self, output: Output) -> None:
        """Called for an output of the pipeline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a replay."""

    output: Path | None = None  # None: nothing is written
    replace: bool = False  # an existing output
    config: Path | Config | None = None  # a file or its content, None: that in the log
    check: bool = False
    tolerance: float = 0.0
    depth: bool = True
    as_live: bool = False  # leave out the frames that the live run skipped, as `check` does


def replay(
    path: Path,
    options: Options,
    on_progress: Callable[[float], None] = lambda share: None,
    observer: Observer | None = None,
) -> Replay:
    """Runs a log through the pipeline. Raises DriverError, ConfigError or OSError when it cannot start. Damage found
    later ends the replay and is part of the result; the events before it are written and counted. Without a frame nothing is
    written."""
    if options.output is not None:
        refuse_output(options.output, path, replace=options.replace)
    with ExitStack() as stack:
        source = stack.enter_context(McapRecording(path))
        config = _config(options, source)
        if observer is not None:
            observer.begin(source, config)
        pipeline = _pipeline_of(source, config)
        comparisons = {key: Comparison(options.tolerance) for key in ("prisms", "tracks") if options.check}
        prisms, tracks = comparisons.get("prisms"), comparisons.get("tracks")
        cameras = pipeline.cameras
        result = Replay(ReplayCounts(), {}, tuple(info.camera for info in cameras), prisms, tracks)
        skipped = skipped_live(path) if options.check or options.as_live else frozenset()
        log = stack.enter_context(LogWriter(options.output)) if options.output is not None else None
        sink = _Sink(log, config, options.depth and config.output.copy_input, cameras, pipeline.state())
        events = _without(_events(source, comparisons, pipeline, observer), skipped)
        monitor = _exposure_monitor(config, cameras)
        try:
            for event, outputs in process(events, pipeline, result.counts):
                monitor.event(event)
                sink.take(event, outputs)
                for output in outputs:
                    if prisms is not None and isinstance(output, PrismsResult):
                        prisms.computed(prisms_message(output))
                    _track(pipeline, output, sink, tracks)
                    if observer is not None:
                        observer.output(output)
                on_progress(source.share_read)
        except BadData as error:
            result.damage = str(error)
        result.lost, result.borrowed = source.lost, source.borrowed
        if log is not None and not result.counts.frames:
            log.discard()
            result.unwritten = log.path
        result.sample_anomalies = pipeline.sample_anomalies()
        result.exposure_offsets = monitor.offsets()
        _add_camera_findings(result, config, cameras)
        _add_recorded_settings(result, source)
        return result


def _pipeline_of(source: McapRecording, config: Config) -> Pipeline:
    """The pipeline with the state at the beginning of the log. Raises BadData where that does not fit the configuration."""
    state = opening_state(source)
    try:
        return make_pipeline(config, source.cameras, state)
    except ValueError as error:
        raise BadData(f"{source.path}: {TOPICS['state'].name}: {error}") from error


def _exposure_monitor(config: Config, cameras: Iterable[CameraInfo]) -> ExposureOffsetMonitor:
    monitor = ExposureOffsetMonitor(masks_of(config))
    for info in cameras:
        monitor.announce(info)
    return monitor


def _add_camera_findings(result: Replay, config: Config, cameras: Iterable[CameraInfo]) -> None:
    """Adds what the report needs of the cameras as configured."""
    for info in cameras:
        ke_per_m = result.counts.ke_per_m.get(info.camera)
        result.obstacle_range_m[info.camera] = obstacle_range_m(info, ke_per_m, config.extractor)
        if text := outside_text(config.camera(info.camera), info):
            result.mask_faults.append(f"camera {info.camera}: {text}")


def _add_recorded_settings(result: Replay, source: McapRecording) -> None:
    """Adds what the report needs of the configuration in the log, where it can be read."""
    recorded = readable_recorded_config(source)
    if recorded is not None:
        result.depth_note = depth_note(recorded.record)
        result.configured_offsets_ms = {
            info.camera: recorded.camera(info.camera).exposure_offset_ms for info in source.cameras
        }


def _track(pipeline: Pipeline, output: Output, sink: _Sink, comparison: Comparison | None) -> None:
    """Updates, writes and compares the tracked obstacles, where they are enabled."""
    tracks = pipeline.track(output)
    if tracks is None:
        return
    message = tracks_message(tracks)
    sink.tracks(tracks, wire_bytes(message))
    if comparison is not None:
        comparison.computed(message)


def check_input(path: Path, options: Options) -> Config:
    """The configuration. Raises what `replay` would raise for its files, before anything is computed."""
    if options.output is not None:
        refuse_output(options.output, path, replace=options.replace)
    with McapRecording(path) as source:
        return _config(options, source)


class _Sink:
    """Writes events and outputs; opens the log at the first event. state: at the beginning of the log."""

    def __init__(
        self,
        log: LogWriter | None,
        config: Config,
        depth: bool,
        cameras: tuple[CameraInfo, ...],
        state: PipelineState,
    ) -> None:
        self._log, self._config, self._depth, self._cameras, self._state = log, config, depth, cameras, state
        self._is_open = False

    def take(self, event: Event, outputs: tuple[Output, ...]) -> None:
        """Writes an event and its outputs."""
        if self._log is None:
            return
        if not self._is_open:
            self._is_open = True
            self._log.begin(run_info("replay", self._config), self._cameras, self._state, event.t_arrival_ns)
        if self._depth or not isinstance(event, DepthFrame):
            self._log.event(event)
        for output in outputs:
            self._log.output(output, self._config.output.scene, self._config.output.transforms)

    def tracks(self, result: TracksResult, data: bytes) -> None:
        """Writes tracked obstacles."""
        if self._log is not None:
            self._log.tracks(result, data)


def _config(options: Options, source: McapRecording) -> Config:
    """The given configuration (raises ConfigError where its cameras are not those of the log), otherwise that in the
    log, otherwise the defaults."""
    if isinstance(options.config, Config):
        _refuse_unknown_cameras(options.config, "the given configuration", source)
        return options.config
    if options.config is not None:
        config = load_config(options.config)
        _refuse_unknown_cameras(config, str(options.config), source)
        return config
    return recorded_config(source)


def _refuse_unknown_cameras(config: Config, name: str, source: McapRecording) -> None:
    """Raises ConfigError for a section of an unknown camera while a camera of the log has no section: a misspelt name
    would otherwise have no effect. More cameras than in the log, or no camera sections at all, are accepted."""
    there, named = [info.camera for info in source.cameras], [camera.name for camera in config.cameras]
    unknown, missing = [name for name in named if name not in there], [name for name in there if name not in named]
    if unknown and missing:
        raise ConfigError(
            name,
            [
                f'[[camera]] "{name}": {source.path} has no such camera, and its camera {", ".join(missing)} has no '
                "section; correct the name, or remove the section"
                for name in unknown
            ],
        )


def _events(
    source: McapRecording, comparisons: Mapping[str, Comparison], pipeline: Pipeline, observer: Observer | None
) -> Iterator[Event]:
    """The events; messages of the log with a key in `comparisons` are passed to these, states within the log to the
    pipeline: a log without all depth images (`[record] depth_hz`) has one before each image."""
    begun = False
    observed = observer.keys if observer is not None else ()
    for item in source.events_with("state", *comparisons, *observed):
        if not isinstance(item, LoggedMessage):
            begun = True
            yield item
            continue
        if observer is not None and item.key in observed:
            observer.logged(item)
        if isinstance(item.message, pb.StateSnapshot):
            if begun:
                pipeline.resume(decoded_state(source, item.message))
        elif item.key in comparisons and isinstance(item.message, pb.PrismsFrame | pb.Tracks):
            comparisons[item.key].logged(item.message)


def _without(events: Iterator[Event], skipped: frozenset[Key]) -> Iterator[Event]:
    for event in events:
        if not isinstance(event, DepthFrame) or key_of(event) not in skipped:
            yield event

"""Draws a log: pictures, a page with its prisms in 3-D, a layout for Foxglove and a recording for Rerun."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from core.params import Params
from drivers.base import BadData
from drivers.logs.reader import McapRecording

from ..config.loader import ConfigError
from ..replay.recorded_run import recorded_config
from ..whole_file import write_whole
from .foxglove_layout import LAYOUT_NAME, write_layout
from .frame import FrameStatus, select_frames
from .log import read_frames
from .page import PageBuilder
from .png import save_frame
from .rerun_file import RERUN_NAME, RerunWriter
from .strips import StripFinder

PAGE_NAME: Final = "flight.html"
PAGE_FRAMES: Final = 600
"""Largest number of frames in a page; more are thinned out evenly."""

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """Options."""

    every: int | None = None  # a picture of every N-th frame
    frames: tuple[int, ...] = ()  # of these sequence numbers; neither: a selection
    png: bool = True
    page: bool = True
    rerun: bool = False

    def __post_init__(self) -> None:
        if self.every is not None and self.every < 1:
            raise ValueError(f"every = {self.every}, expected 1 or more")


@dataclass(slots=True)
class Views:
    """The written files."""

    pictures: list[Path] = field(default_factory=list)
    page: Path | None = None
    layout: Path | None = None
    rerun: Path | None = None
    frames: int = 0
    valid: int = 0
    blind: int = 0
    without_prisms: int = 0
    notes: list[str] = field(default_factory=list)
    damage: str = ""  # why the log could not be read to its end; "" if it could


@dataclass(frozen=True, slots=True)
class _FrameSummary:
    """Properties of a frame that the selection and the layout need."""

    sequence: int
    t_ns: int
    planes: int
    status: FrameStatus
    health: bool = False  # a health report comes before it


def make_views(
    path: Path, out_dir: Path, options: ViewOptions | None = None, on_progress: Progress = lambda share: None
) -> Views:
    """Draws a log into a directory, created if missing: frame_CAMERA_SEQUENCE.png, flight.html, a layout for Foxglove and,
    where requested, a recording for Rerun.

    A damaged log is drawn as far as it can be read. Raises DriverError, ValueError (a requested frame is not
    in the log, or the log has none), OSError."""
    options = options or ViewOptions()
    with McapRecording(path) as source:
        summaries, damage = _summaries(source, lambda share: on_progress(0.4 * share))
        views = _counted(summaries, damage)
        if not summaries:
            raise ValueError(f"{path}: no depth frame in the log; nothing to draw. {damage}".strip())
        pictures = set(_chosen(summaries, options)) if options.png else set()
        stride = -(-len(summaries) // PAGE_FRAMES)
        builder = PageBuilder(path.name, -(-len(summaries) // stride)) if options.page else None
        out_dir.mkdir(parents=True, exist_ok=True)
        rerun = RerunWriter(out_dir / RERUN_NAME, path.name) if options.rerun else None
        sinks = _Sinks(out_dir, pictures, builder, stride, rerun)
        _draw(source, summaries, sinks, views, lambda share: on_progress(0.4 + 0.6 * share))
        views.layout = out_dir / LAYOUT_NAME
        write_layout(views.layout, [info.camera for info in source.cameras], health=any(g.health for g in summaries))
        if rerun is not None:
            rerun.close()
            views.rerun = out_dir / RERUN_NAME
        if builder is not None and len(builder):
            note = f"Every {stride}. of {len(summaries)} frames is shown. " if stride > 1 else ""
            note += "The log is damaged: later frames are missing." if views.damage else ""
            views.page = out_dir / PAGE_NAME
            write_whole(views.page, builder.page(note))
    return views


def _summaries(source: McapRecording, on_progress: Progress) -> tuple[list[_FrameSummary], str]:
    """The first pass over the log: (summaries, why it ended early)."""
    summaries: list[_FrameSummary] = []
    try:
        for logged in read_frames(source, on_progress):
            health = logged.health is not None
            summaries.append(_FrameSummary(logged.sequence, logged.t_ns, logged.plane_count, logged.status, health))
    except BadData as error:
        return summaries, str(error)
    return summaries, ""


def _counted(summaries: list[_FrameSummary], damage: str) -> Views:
    count = {status: sum(g.status is status for g in summaries) for status in FrameStatus}
    views = Views(
        frames=len(summaries),
        valid=count[FrameStatus.VALID],
        blind=count[FrameStatus.BLIND],
        without_prisms=count[FrameStatus.NO_PRISMS],
        damage=damage,
    )
    if summaries and views.without_prisms == len(summaries):
        views.notes.append(
            "no prisms in this log: run `companion replay` first; the pictures show the depth images only"
        )
    return views


def _chosen(summaries: list[_FrameSummary], options: ViewOptions) -> Sequence[int]:
    """Indices of the frames to draw. Raises ValueError for a frame that is not in the log."""
    if options.frames:
        missing = sorted(set(options.frames) - {g.sequence for g in summaries})
        if missing:
            first, last = min(g.sequence for g in summaries), max(g.sequence for g in summaries)
            raise ValueError(f"frame {missing[0]} is not in the log; its frames are {first} .. {last}")
        return [k for k, g in enumerate(summaries) if g.sequence in options.frames]
    if options.every is not None:
        return range(0, len(summaries), options.every)
    return select_frames([g.planes for g in summaries], [g.status is FrameStatus.BLIND for g in summaries])


@dataclass(frozen=True, slots=True, eq=False)
class _Sinks:
    """What the second pass writes."""

    out_dir: Path
    pictures: set[int]  # indices of the frames to draw
    builder: PageBuilder | None
    stride: int  # every stride-th frame is on the page
    rerun: RerunWriter | None


def _draw(
    source: McapRecording, summaries: list[_FrameSummary], sinks: _Sinks, views: Views, on_progress: Progress
) -> None:
    """The second pass: draws the selected frames and adds all (or every stride-th) frames to the page."""
    pictures, builder = sinks.pictures, sinks.builder
    strips = StripFinder(_params(source, views)) if pictures else None
    t_start_ns = min(g.t_ns for g in summaries)
    try:
        for k, logged in enumerate(read_frames(source, on_progress)):
            on_page = builder is not None and k % sinks.stride == 0
            if k not in pictures and not on_page and sinks.rerun is None:
                continue
            try:
                frame = logged.frame()
            except ValueError as error:
                views.damage = views.damage or f"{source.path}: frame {logged.sequence} was left out: {error}"
                continue
            if strips is not None and k in pictures:
                target = sinks.out_dir / f"frame_{frame.info.camera}_{frame.sequence:06d}.png"
                save_frame(strips.with_strips(frame, logged.state), target, t_start_ns=t_start_ns)
                views.pictures.append(target)
            if builder is not None and on_page:
                builder.add(frame)
            if sinks.rerun is not None:
                sinks.rerun.add(frame)
    except BadData as error:
        views.damage = str(error)


def _params(source: McapRecording, views: Views) -> Params:
    """The extractor's parameters of the log; the defaults where it has none, or an unusable configuration."""
    try:
        return recorded_config(source, otherwise="").extractor
    except ConfigError as error:
        views.notes.append(f"no strips are drawn: the configuration in the log cannot be used: {error}")
        return Params()

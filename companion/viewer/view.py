"""`companion view`: pictures of a log and a page with its prisms in 3-D."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from core.params import Params
from drivers.base import BadData
from drivers.logs.reader import McapRecording

from ..argument_types import number_in
from ..common_options import add_keys, add_service
from ..config.loader import ConfigError
from ..console import counted, fail, print_json, print_line, progress, warn
from ..kernels.warmup import ensure_compiled
from ..replay.recorded_config import recorded_config
from ..usage_error import UsageError, given_option
from ..whole_file import write_whole
from .foxglove_layout import LAYOUT_NAME, write_layout
from .frame import FrameStatus, select_frames
from .log import read_frames
from .page import PageBuilder
from .png import drawing_library, save_frame
from .rerun_file import RERUN_NAME, RerunWriter, rerun_library
from .strips import StripFinder

PAGE_NAME: Final = "flight.html"
PAGE_FRAMES: Final = 600
"""Largest number of frames in a page; more are thinned out evenly."""

_LIVE_ONLY: Final = ("config", "keys", "port", "listen", "foxglove", "no_depth")
_LOG_ONLY: Final = ("every", "frame", "no_png", "no_page", "rerun")

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


def add_parser(subparsers: Any) -> None:
    """The command line of `companion view`."""
    parser = subparsers.add_parser("view")
    parser.add_argument(
        "input",
        type=Path,
        nargs="?",
        metavar="FILE.mcap",
        help="a log with prisms, written by the service, `companion demo` or `companion replay -o`",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="directory for the pictures and the page; needed without --live",
    )
    parser.add_argument(
        "--live", action="store_true", help="serve a page that follows the running service; Ctrl-C ends it"
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--every",
        type=number_in(int, 1, 1_000_000),
        metavar="N",
        help="draw a picture of every N-th frame (default: about seven of the log)",
    )
    which.add_argument(
        "--frame",
        type=number_in(int, 0, 2**32 - 1),
        action="append",
        default=[],
        metavar="N",
        help="draw a picture of frame N; may be repeated",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--no-png", action="store_true", help="write the page only")
    what.add_argument("--no-page", action="store_true", help="write the pictures only")
    parser.add_argument("--rerun", action="store_true", help=f"also write {RERUN_NAME} for Rerun (needs rerun-sdk)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    live = parser.add_argument_group("with --live")
    add_service(live)
    add_keys(live)
    live.add_argument(
        "--port",
        type=number_in(int, 0, 65535),
        metavar="N",
        help="port of the page (default: 8760); 0: any free port",
    )
    live.add_argument(
        "--listen",
        metavar="HOST",
        help="address to serve at, IPv4 or IPv6 (default: 127.0.0.1, this computer only); 0.0.0.0 or ::: the whole network, without encryption",
    )
    live.add_argument(
        "--foxglove",
        type=number_in(int, 0, 65535),
        nargs="?",
        const=8765,
        metavar="N",
        help="also serve a WebSocket for the Foxglove viewer (default port: 8765). Any web page that is open in a browser of this computer can read it, with camera images and position",
    )
    live.add_argument(
        "--no-depth", action="store_true", help="request no depth images, which saves the service their computation"
    )


def run(args: argparse.Namespace) -> int:
    """0: success; 1: the log could not be read to its end. Raises UsageError."""
    if args.live:
        if args.input is not None or args.output is not None:
            raise UsageError("--live follows the running service: leave FILE.mcap and -o away")
        if option := given_option(args, _LOG_ONLY):
            raise UsageError(f"--live draws no log: leave out {option}")
        from .live_server import run as run_live  # imports a web server: only where requested

        return run_live(args)
    if args.input is None:
        raise UsageError("give FILE.mcap and -o DIR, or --live")
    if args.output is None:
        raise UsageError(f"-o DIR is missing: where to draw {args.input}")
    if option := given_option(args, _LIVE_ONLY):
        raise UsageError(f"{option} needs --live: it has no effect on the drawings of a log")
    if args.no_png and (option := given_option(args, ("every", "frame"))):
        raise UsageError(f"{option} chooses pictures, and --no-png draws none; leave one of them out")
    options = ViewOptions(
        every=args.every, frames=tuple(args.frame), png=not args.no_png, page=not args.no_page, rerun=args.rerun
    )
    if options.png:
        drawing_library(", or draw the page only with --no-png")
    if options.rerun:
        rerun_library()
    with McapRecording(args.input):
        pass  # a file that cannot be read is not to wait for the compiler
    if options.png:
        ensure_compiled("extractor")  # strips are computed again for the pictures
    with progress("view") as on_progress:
        views = make_views(args.input, args.output, options, on_progress)
    if args.json:
        print_json(_report(views, args.input))
    else:
        _print_summary(views)
    for note in views.notes:
        warn(note)
    if views.damage:
        fail(views.damage)
    return 1 if views.damage else 0


def _report(views: Views, path: Path) -> dict[str, Any]:
    """The object of `--json`."""
    return {
        "input": str(path),
        "frames": views.frames,
        "valid": views.valid,
        "blind": views.blind,
        "without_prisms": views.without_prisms,
        "pictures": [str(p) for p in views.pictures],
        "page": None if views.page is None else str(views.page),
        "layout": None if views.layout is None else str(views.layout),
        "rerun": None if views.rerun is None else str(views.rerun),
        "notes": views.notes,
        "damage": views.damage or None,
    }


def _print_summary(views: Views) -> None:
    print_line(
        f"{counted(views.frames, 'frame')}: {views.valid} valid, {views.blind} blind, {views.without_prisms} without prisms"
    )
    for picture in views.pictures:
        print_line(f"picture  {picture}")
    if views.page is not None:
        print_line(f"page     {views.page}  (open it in a browser; it works offline)")
    if views.layout is not None:
        print_line(f"layout   {views.layout}  (Foxglove and Lichtblick: import it, then open the log)")
    if views.rerun is not None:
        print_line(f"rerun    {views.rerun}  (rerun {views.rerun})")

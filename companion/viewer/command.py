"""`companion view`: the command line."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

from drivers.logs.reader import McapRecording

from ..argument_types import number_in
from ..common_options import add_keys, add_service
from ..console import counted, fail, print_json, print_line, progress, warn
from ..kernels.warmup import ensure_compiled
from ..usage_error import UsageError, given_option
from .png import drawing_library
from .rerun_file import RERUN_NAME, rerun_library
from .view import ViewOptions, Views, make_views

_LIVE_ONLY: Final = ("config", "keys", "port", "listen", "foxglove", "no_depth")
_LOG_ONLY: Final = ("every", "frame", "no_png", "no_page", "rerun")


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
    _add_live(parser.add_argument_group("with --live"))


def _add_live(live: Any) -> None:
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
        _refuse_log_options(args)
        from .live_view import follow  # imports a web server: only where requested

        return follow(args)
    _refuse_live_options(args)
    return _draw(args)


def _refuse_log_options(args: argparse.Namespace) -> None:
    """Raises UsageError for what has no effect with --live."""
    if args.input is not None or args.output is not None:
        raise UsageError("--live follows the running service: leave FILE.mcap and -o away")
    if option := given_option(args, _LOG_ONLY):
        raise UsageError(f"--live draws no log: leave out {option}")


def _refuse_live_options(args: argparse.Namespace) -> None:
    """Raises UsageError for what is missing, or has no effect, where a log is drawn."""
    if args.input is None:
        raise UsageError("give FILE.mcap and -o DIR, or --live")
    if args.output is None:
        raise UsageError(f"-o DIR is missing: where to draw {args.input}")
    if option := given_option(args, _LIVE_ONLY):
        raise UsageError(f"{option} needs --live: it has no effect on the drawings of a log")
    if args.no_png and (option := given_option(args, ("every", "frame"))):
        raise UsageError(f"{option} chooses pictures, and --no-png draws none; leave one of them out")


def _draw(args: argparse.Namespace) -> int:
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

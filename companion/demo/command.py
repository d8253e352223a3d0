"""`companion demo`: the command line."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import sysconfig
from pathlib import Path
from typing import Any

from ..argument_types import number_in
from ..common_options import add_config, add_replace
from ..console import counted, fail, print_json, print_line, progress, warn
from ..kernels.compilation import WarmupError
from ..live.message_json import message_json
from ..live.status import status_lines
from ..packaged import packaged_file
from ..pipeline.sync import DropCause
from ..whole_file import refuse_existing
from .demo import LOG, OUTPUT, SECONDS, Demo, DemoOptions, demo, demo_problems, shown
from .live import DemoError

FAST_SECONDS, FAST_WIDTH_PX = 3.0, 320
BUSY_SHARE = 0.1
"""Skipped frames over used ones from which the summary names the load of the computer."""


def add_parser(subparsers: Any) -> None:
    """The command line of `companion demo`."""
    parser = subparsers.add_parser("demo")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help=f"directory for log, pictures and page (default: {OUTPUT}, whose files are replaced)",
    )
    add_replace(parser)
    add_config(parser, "configuration with a simulated camera (default: the demo flight)")
    parser.add_argument(
        "--seconds",
        type=number_in(float, 1.0, 600.0),
        metavar="S",
        help=f"duration of the flight (default: {SECONDS:g} s)",
    )
    parser.add_argument(
        "--fast", action="store_true", help=f"fly {FAST_SECONDS:g} s with images {FAST_WIDTH_PX} pixels wide"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: success; 1: a problem was found."""
    seconds = args.seconds or (FAST_SECONDS if args.fast else SECONDS)
    width_px = FAST_WIDTH_PX if args.fast else None
    if args.output is not None:
        refuse_existing(args.output / LOG, replace=args.replace)
    args.output = args.output or OUTPUT
    options = DemoOptions(folder=args.output, config=args.config, seconds=seconds, width_px=width_px)
    try:
        done = demo(options, progress if args.json else _announced)
    except (WarmupError, DemoError) as error:
        fail(str(error))
        return 1
    problems = demo_problems(done)
    if args.json:
        print_json(_json(done, problems))
    else:
        _print_summary(done)
        _print_next(done)
    for note in done.views.notes:
        warn(note)
    for problem in problems:
        fail(problem)
    return 1 if problems else 0


def _announced(label: str) -> Any:
    """A progress bar, and a printed line where no terminal shows it."""
    print_line(f"- {label} ...")
    return progress(label)


def _print_summary(done: Demo) -> None:
    """Prints the state of the service and what the planner and the replay found."""
    received, counts = done.live.received, done.replay.counts
    valid = max(1, counts.valid)
    print_line()
    print_line("State of the service at the end of the flight, as printed by `companion status`:")
    for line in status_lines(done.live.health):
        print_line(f"  {line}")
    print_line()
    print_line(
        f"A planner in another process received {counted(received.messages, 'message')}: {received.valid} with obstacles and "
        "free space,"
    )
    ages = f"{received.age_ms[0]:.0f} ms after the exposure in the median and {received.age_ms[1]:.0f} ms for 99 of 100"
    print_line(f"{ages};")
    blind = ", ".join(f"{n} ({text})" for text, n in received.texts.items()) or "none"
    print_line(
        f"blind messages (valid = false), sent while no recent frame is valid, as before the first one: {blind}."
    )
    skipped, used = done.live.health.frames_dropped.get(DropCause.BUSY.value, 0), done.live.health.frames_used
    if skipped > BUSY_SHARE * used:
        print_line(
            f"This computer was busy: {skipped} of {skipped + used} frames were skipped for newer ones. Delays and faults "
            "above can be due to that."
        )
    print_line(
        f"On average a frame has {counts.planes / valid:.0f} vertical planes in {counts.prisms / valid:.0f} prisms."
    )
    comparison = done.replay.comparison
    if comparison is not None and comparison.passed:
        print_line("Replaying the log gave the same prisms bit for bit.")


def _print_next(done: Demo) -> None:
    """Prints the paths of the results, and the commands to try next."""
    print_line()
    print_line("Look at:")
    if done.views.page is not None:
        print_line(f"  {shown(done.views.page)}  obstacles in 3-D: open it in a browser")
    if done.views.pictures:
        folder = shown(done.views.pictures[0].parent)
        print_line(
            f"  {folder}/*.png  {len(done.views.pictures)} pictures: depth image with planes, top view, side view"
        )
    print_line(f"  {shown(done.log)}  log of the flight; Foxglove and Lichtblick can open it")
    if done.views.layout is not None:
        print_line(f"  {shown(done.views.layout)}  layout for Foxglove and Lichtblick: import it first")
    print_line()
    print_line("Next:")
    if (scripts := scripts_outside_path()) is not None:
        print_line(f"  . {shown(scripts / 'activate')}   puts the command `companion` into the path of this terminal")
    print_line(f"  companion info {shown(done.log)}")
    shipped = shown(packaged_file("configs", "simulated.toml"))
    print_line(f"  companion run -c {shipped}   run the same service until you stop it with Ctrl-C, and beside it")
    print_line(f"  companion simulate-autopilot -c {shipped}   its attitude: the service is blind without it")
    print_line("  companion view --live   page that follows the service")
    page = shown(packaged_file("docs/how-to", "import-recordings.md"))
    print_line(f"  companion import FOLDER -o my.mcap   convert a recording of your own ({page})")


def scripts_outside_path() -> Path | None:
    """The folder of this environment's commands where the shell does not find them."""
    scripts = Path(sysconfig.get_path("scripts"))
    return scripts if shutil.which("companion") is None and (scripts / "activate").exists() else None


def _json(done: Demo, problems: list[str]) -> dict[str, Any]:
    return {
        "prisms": str(done.log),
        "page": str(done.views.page) if done.views.page else None,
        "pictures": [str(p) for p in done.views.pictures],
        "duration_s": done.live.duration_s,
        "subscriber": dataclasses.asdict(done.live.received),
        "troubles": list(done.live.health.troubles),
        "diagnostics": [message_json(d) for d in done.live.health.diagnostics],
        **done.replay.counts.as_json(),
        "problems": problems,
    }

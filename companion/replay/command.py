"""`companion replay`: the command line."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..argument_types import number_in
from ..common_options import add_config, add_replace
from ..console import fail, print_json, progress, warn
from ..kernels.warmup import ensure_compiled
from ..usage_error import UsageError
from .replay import Options, check_input, replay
from .replay_report import print_report, replay_problems, report


def add_parser(subparsers: Any) -> None:
    """The command line of `companion replay`."""
    parser = subparsers.add_parser("replay")
    parser.add_argument("input", type=Path, metavar="IN.mcap", help="a log with depth images and attitude")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.mcap", help="write a log with the obstacles (prisms)")
    add_replace(parser)
    add_config(parser, "use this configuration instead of the recorded one")
    parser.add_argument(
        "--check",
        action="store_true",
        help="compare the result with the prisms in the log, bit by bit; status 1 if they differ",
    )
    parser.add_argument(
        "--tolerance",
        type=number_in(float, 0.0, 1.0),
        metavar="X",
        help="with --check: greatest allowed difference of two numbers in their unit (m, rad), for another type of processor (default: 0)",
    )
    parser.add_argument("--no-depth", action="store_true", help="leave the depth images out of OUT.mcap")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: success; 1: the input was damaged, frames were dropped or the check failed. Raises UsageError."""
    if args.tolerance is not None and not args.check:
        raise UsageError("--tolerance needs --check")
    if args.replace and args.output is None:
        raise UsageError("--replace needs -o OUT.mcap, the file to replace")
    if args.no_depth and args.output is None:
        raise UsageError("--no-depth needs -o OUT.mcap: it leaves the depth images out of that file")
    options = Options(
        output=args.output,
        replace=args.replace,
        config=args.config,
        check=args.check,
        tolerance=args.tolerance or 0.0,
        depth=not args.no_depth,
    )
    config = check_input(args.input, options)  # a mistake is not to wait for the compiler
    ensure_compiled("extractor", *(("tracking",) if config.tracking.enabled else ()))
    share = 0.0
    with progress("replay") as show:

        def on_progress(now: float) -> None:
            nonlocal share
            share = now
            show(now)

        try:
            result = replay(args.input, options, on_progress)
        except KeyboardInterrupt as interrupt:
            unwritten = f"; {args.output} was not written" if args.output is not None else ""
            raise KeyboardInterrupt(f"interrupted after {share:.0%} of {args.input}{unwritten}") from interrupt
    problems = replay_problems(result)
    written = args.output if result.unwritten is None else None
    if args.json:
        print_json(report(result, args.input, written, problems))
    else:
        print_report(result, written)
    for text in result.mask_faults:
        warn(text)
    for problem in problems:
        fail(problem)
    return 1 if problems else 0

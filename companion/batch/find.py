"""`companion find`: cuts the times of a dataset that fulfil a condition out of the logs."""

from __future__ import annotations

import argparse
import itertools
import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from drivers.base import DriverError

from ..argument_types import number_in
from ..common_options import add_replace
from ..config.loader import ConfigError
from ..console import counted, fail, print_json, print_line, progress, warn
from ..error_text import error_text
from ..kernels.warmup import ensure_compiled
from ..usage_error import UsageError
from ..whole_file import refuse_existing
from .clip import Span, cut, merged
from .conditions import NAMED, SEARCHED, Hit, find_hits
from .dataset import open_table, read_rows
from .flights import safe_name
from .storage import StoredFile, is_url, local_copy

NS: Final = 1_000_000_000
LIMIT: Final = 100
NO_MESSAGE: Final = "the log has no message at these times; process it again with `companion batch`"


@dataclass(frozen=True, slots=True)
class Clip:
    """A clip to cut."""

    vehicle: str
    flight: str
    location: str  # of the log
    # begin_ns, end_ns: arrival of its messages
    begin_ns: int
    end_ns: int
    flight_s: float  # begin, in seconds of the flight
    output: Path

    def as_json(self) -> dict[str, Any]:
        """The object in `--json`."""
        return {
            "clip": str(self.output),
            "vehicle": self.vehicle,
            "flight": self.flight,
            "log": self.location,
            "begin_ns": self.begin_ns,
            "end_ns": self.end_ns,
            "flight_s": round(self.flight_s, 3),
        }

    def as_line(self) -> str:
        """The line that is printed. Seconds before the first frame of the flight do not count."""
        begin_s = max(0.0, self.flight_s)
        seconds = self.flight_s + (self.end_ns - self.begin_ns) / NS - begin_s
        return f"{self.output}  {seconds:.1f} s of {self.vehicle}/{self.flight} at {begin_s:.1f} s"


@dataclass(slots=True)
class Found:
    """The result."""

    clips: list[Clip] = field(default_factory=list)
    left_out: int = 0  # clips beyond the limit
    failed: dict[str, str] = field(default_factory=dict)  # log -> which of its clips are missing, and why
    damaged: dict[str, str] = field(default_factory=dict)  # logs that end early

    def as_json(self, rows: int) -> dict[str, Any]:
        """The object of `--json`. rows: number of rows that fulfil the condition."""
        return {
            "rows": rows,
            "clips": [clip.as_json() for clip in self.clips],
            "left_out": self.left_out,
            "damaged": self.damaged,
            "failed": self.failed,
        }


def plan_clips(dataset: str, hits: Iterable[Hit], folder: Path, before_s: float, after_s: float) -> list[Clip]:
    """The clips of hits: each with the time before and after it, overlapping ones joined. A clip is part of one log file:
    it ends where the log was rotated. Raises ValueError for hits of another dataset."""
    rows = read_rows(open_table(dataset, "flights"), f"{dataset}/flights", ["vehicle", "flight", "files", "begin_ns"])
    flights = {(row["vehicle"], row["flight"]): row for row in rows}
    clips: list[Clip] = []
    taken: set[Path] = set()
    for (vehicle, flight, file), group in itertools.groupby(hits, key=lambda h: (h.vehicle, h.flight, h.file)):
        row = flights.get((vehicle, flight))
        if row is None or not 0 <= file < len(row["files"]):
            raise ValueError(
                f"{vehicle}/{flight}, file {file}: {dataset} has no such log; give the dataset that the rows come from"
            )
        spans = [(h.begin_ns - round(before_s * NS), h.end_ns + round(after_s * NS)) for h in group]
        for begin_ns, end_ns in merged(spans):
            flight_s = 0.0 if row["begin_ns"] is None else (begin_ns - row["begin_ns"]) / NS
            name = f"{safe_name(vehicle)}_{safe_name(flight)}_{max(0.0, flight_s):09.3f}s"
            output = _free_name(folder, name, taken)
            taken.add(output)
            clips.append(Clip(vehicle, flight, row["files"][file], begin_ns, end_ns, flight_s, output))
    return clips


def _free_name(folder: Path, name: str, taken: set[Path]) -> Path:
    """The path of a clip. Clips of two files of a flight can begin at the same time, before its first frame: the second one
    gets a number."""
    output, number = folder / f"{name}.mcap", 2
    while output in taken:
        output, number = folder / f"{name}-{number}.mcap", number + 1
    return output


def cut_clips(clips: list[Clip], found: Found) -> None:
    """Cuts the clips, all of one log in one pass."""
    with tempfile.TemporaryDirectory(prefix="osape-find-") as copies, progress("find") as on_progress:
        for location, group in itertools.groupby(clips, key=lambda clip: clip.location):
            _cut_log(location, list(group), Path(copies), found, lambda: on_progress(len(found.clips) / len(clips)))


def _cut_log(location: str, clips: list[Clip], copies: Path, found: Found, on_clip: Callable[[], None]) -> None:
    """Cuts the clips of one log. copies: folder for a copy of a log that is not on this computer."""
    waiting = {clip.output: clip for clip in clips}

    def on_written(output: Path) -> None:
        found.clips.append(waiting.pop(output))
        on_clip()

    spans = [Span(c.begin_ns, c.end_ns, c.output) for c in clips]
    try:
        with local_copy(StoredFile(location, 0), copies) as path:
            damage = cut(path, spans, on_written)
        lost = bool(waiting)
    except (DriverError, ConfigError, OSError, ValueError) as error:
        damage, lost = error_text(error, spans[0].output.parent), True
    if lost:
        missing = "no clip" if len(waiting) == len(clips) else f"{len(waiting)} of {len(clips)} clips are missing"
        found.failed[location] = f"{missing}: {damage or NO_MESSAGE}"
    elif damage:
        found.damaged[location] = damage


def add_parser(subparsers: Any) -> None:
    """The command line of `companion find`."""
    names = "; ".join(f"{name}: {condition.doc}" for name, condition in NAMED.items())
    parser = subparsers.add_parser("find", epilog=f"Named conditions: {names}.")
    parser.add_argument("dataset", metavar="DATASET", help="directory or address written by `companion batch`")
    parser.add_argument(
        "condition",
        metavar="CONDITION",
        help="a named condition (below), a filter [[COLUMN, OPERATOR, VALUE], ...], or a Parquet file of rows",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="directory for the clips; needed without --list"
    )
    add_replace(parser)
    parser.add_argument("--table", choices=SEARCHED, help=f"table that a filter is applied to (default: {SEARCHED[0]})")
    seconds = number_in(float, 0.0, 600.0)
    parser.add_argument(
        "--before", type=seconds, default=2.0, metavar="S", help="seconds before each time (default: 2)"
    )
    parser.add_argument("--after", type=seconds, default=2.0, metavar="S", help="seconds after each time (default: 2)")
    parser.add_argument(
        "--limit",
        type=number_in(int, 1, 100_000),
        default=LIMIT,
        metavar="N",
        help=f"largest number of clips (default: {LIMIT})",
    )
    parser.add_argument("--list", action="store_true", help="list the clips without writing them")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: all clips are written; 1: clips of a log are missing. Raises UsageError."""
    if args.output is None and not args.list:
        raise UsageError("no directory for the clips is given; give -o DIR, or --list to write none")
    dataset = args.dataset if is_url(args.dataset) else os.path.realpath(args.dataset)
    hits = find_hits(dataset, args.condition, args.table)
    clips = plan_clips(dataset, hits, args.output or Path(), args.before, args.after)
    found = Found(left_out=max(0, len(clips) - args.limit))
    chosen = clips[: args.limit]
    if args.list:
        found.clips = chosen
    elif chosen:
        _write(chosen, args.output, args.replace, found)
    if args.json:
        print_json(found.as_json(len(hits)))
    else:
        _print_found(found, len(hits))
    if found.left_out:
        warn(f"--limit {args.limit}: {counted(found.left_out, 'clip')} left out")
    for text in found.damaged.values():
        warn(text)
    for location, text in found.failed.items():
        fail(f"{location}: {text}")
    return 1 if found.failed else 0


def _write(clips: list[Clip], folder: Path, replace: bool, found: Found) -> None:
    refuse_existing(*(clip.output for clip in clips), replace=replace)
    folder.mkdir(parents=True, exist_ok=True)
    ensure_compiled("extractor")
    try:
        cut_clips(clips, found)
    except KeyboardInterrupt as interrupt:
        done = f"wrote {len(found.clips)} of {counted(len(clips), 'clip')} to {folder}"
        raise KeyboardInterrupt(f"interrupted: {done}") from interrupt


def _print_found(found: Found, rows: int) -> None:
    print_line(f"{counted(rows, 'row')}, {counted(len(found.clips), 'clip')}")
    for clip in found.clips:
        print_line(clip.as_line())

"""The fidelity figures on scenes with known truth: one row a case, then the worst of each family.

Run `python -m benchmarks.fidelity.run --quick`, or with --scenes, --tilts, --ke, --seeds, --heights, --faults, or a
whole set of cases with --part. The seeds are those for tuning; figures to be published use --held-out. A single
case comes with --seed; benchmarks.fidelity.draw_case takes the same options and draws it.
Progress goes to stderr, the table to stdout, all figures to --json FILE."""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from benchmarks.fidelity.case import FAULTS, FRAMES
from benchmarks.fidelity.matrix import (
    FEW_TILTS_DEG,
    GOAL_KE,
    PARTS,
    QUICK_SCENES,
    TILTS_DEG,
    Settings,
    cases,
    in_families,
    run,
)
from benchmarks.fidelity.result import Case
from benchmarks.fidelity.text_report import print_report
from benchmarks.scenes.catalogue import HELD_OUT_SEEDS, SCENES, TUNING_SEEDS
from companion.argument_parser import ArgumentParser
from core.params import Params


def _floats(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


def _ints(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


def _tilts(text: str) -> list[tuple[float, float]]:
    """'0:0,30:0' -> [(0, 0), (30, 0)]: roll and pitch in degrees."""
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise argparse.ArgumentTypeError("expected roll:pitch pairs in degrees, such as 0:0,30:0")
    return [(float(roll), float(pitch)) for roll, pitch in pairs]


def _scenes(text: str) -> list[str]:
    try:
        return in_families(text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _faults(text: str) -> list[str]:
    names = text.split(",")
    unknown = [n for n in names if n not in FAULTS]
    if unknown:
        raise argparse.ArgumentTypeError(f"no faults {unknown[0]!r}; there are {', '.join(FAULTS)}")
    return names


def _parts(text: str) -> list[str]:
    names = text.split(",")
    unknown = [n for n in names if n not in PARTS]
    if unknown:
        raise argparse.ArgumentTypeError(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    return names


def _set(params: Params, settings: list[str]) -> Params:
    """Parameters with some of them set by NAME=VALUE. Raises ValueError for one that does not exist."""
    changes: dict[str, Any] = {}
    for text in settings:
        name, _, value = text.partition("=")
        if name not in {f.name for f in fields(Params)} or not value:
            raise ValueError(f"--set {text}: expected NAME=VALUE with a parameter of core/params.py")
        kind = type(getattr(params, name))
        changes[name] = value == "true" if kind is bool else kind(value)
    return replace(params, **changes)


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = ArgumentParser(prog="python -m benchmarks.fidelity.run", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="ten scenes, three tilts, one noise")
    parser.add_argument("--part", type=_parts, help=f"whole sets of cases: {', '.join(PARTS)}")
    parser.add_argument("--scenes", type=_scenes, help="names or families, separated by commas")
    parser.add_argument("--tilts", type=_tilts, help="roll:pitch pairs in degrees, e.g. 0:0,30:0,0:-30")
    parser.add_argument("--ke", type=_floats, help="noise, sigma = ke Z^2, e.g. 0.0015,0.005")
    parser.add_argument("--configured-ke", type=_floats, help="noise configured in the method; default: the true one")
    parser.add_argument("--heights", type=_floats, default=[2.0], help="of the camera above the ground, m")
    parser.add_argument("--seeds", type=int, default=1, help="how many (1)")
    parser.add_argument("--seed", type=_ints, help="just these seeds, e.g. 3,103")
    parser.add_argument("--held-out", action="store_true", help="the seeds that are for reporting only")
    parser.add_argument("--frames", type=int, default=FRAMES, help="frames in a row, the last of which is scored")
    parser.add_argument("--width", type=int, default=640, help="image width; the height is 3/4 of it")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of the extractor")
    parser.add_argument("--faults", type=_faults, default=["all"], help=f"of {', '.join(FAULTS)} (all)")
    parser.add_argument("--no-faults", action="store_true", help="noise only: no holes, mismatches, flying pixels")
    parser.add_argument("--no-grids", action="store_true", help="without the grid baseline")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (all processors)")
    parser.add_argument("--json", type=Path, help="write every figure there")
    args = parser.parse_args(arguments)
    args.scenes = args.scenes or list(QUICK_SCENES if args.quick else SCENES)
    args.tilts = args.tilts or list(FEW_TILTS_DEG if args.quick else TILTS_DEG)
    args.ke = args.ke or (list(GOAL_KE[:1]) if args.quick else list(GOAL_KE))
    args.faults = ["none"] if args.no_faults else args.faults
    if not 1 <= args.seeds <= len(TUNING_SEEDS):
        parser.error(f"--seeds: expected 1..{len(TUNING_SEEDS)}")
    try:
        args.params = _set(Params(), args.set)
    except ValueError as error:
        parser.error(str(error))
    return args


def asked(args: argparse.Namespace) -> list[Case]:
    """The cases that the command line asks for."""
    seeds = args.seed or list((HELD_OUT_SEEDS if args.held_out else TUNING_SEEDS)[: args.seeds])
    if args.part:
        return [case for name in args.part for case in PARTS[name].make(seeds)]
    configured = args.configured_ke
    return list(
        cases(
            args.scenes,
            seeds,
            args.tilts,
            args.ke,
            args.heights,
            args.faults,
            (lambda _: configured) if configured else (lambda ke: (ke,)),
            args.width,
        )
    )


def main(arguments: list[str] | None = None) -> int:
    """Runs the cases, prints the table and writes the JSON."""
    args = parse(arguments)
    grids = not args.no_grids and (not args.part or any(PARTS[name].grids for name in args.part))
    rows = run(asked(args), Settings(params=args.params, frames=args.frames, grids=grids, jobs=args.jobs))
    print_report(rows)
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Flies through random faults, and prints what contradicts the truth.

    python -m benchmarks.faults [--flights N] [--first SEED] [--seconds S] [--only NAME ... | --none]

Each flight has a field, a path and a sequence of faults of its own, which its number determines. Every second flight is with PX4,
the others with ArduPilot. The exit status is 1 if anything was sent that must not be sent, or if the output did not recover in
time."""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from drivers.mavlink.session_types import ARDUPILOT, PX4

from .flight import fly_faults
from .kinds import KINDS


def main() -> int:
    """Runs the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults")
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--only", nargs="+", choices=sorted(KINDS), metavar="NAME")
    parser.add_argument("--none", action="store_true", help="no faults: shows what is refused without one")
    parser.add_argument(
        "--verbose", action="store_true", help="print each violation, not only the first five of a flight"
    )
    args = parser.parse_args()
    names = () if args.none else tuple(args.only or KINDS)
    total: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    for seed in range(args.first, args.first + args.flights):
        kind = (PX4, ARDUPILOT)[seed % 2]
        judge = fly_faults(seed, kind, args.seconds, names)
        total += Counter(
            flights=1,
            faults=len(judge.faults),
            messages=judge.messages,
            clear_sectors=judge.clear,
            paths=judge.paths,
            planner_messages=judge.planner,
            worlds=judge.worlds,
            quiet_messages=judge.quiet,
            violations=len(judge.violations),
        )
        refused += judge.refused
        counts = f"{len(judge.faults)} faults, {judge.messages} messages, {judge.clear} clear sectors"
        print(f"flight {seed} {kind}: {counts}, {len(judge.violations)} violations", flush=True)
        for v in judge.violations if args.verbose else judge.violations[:5]:
            print(f"  {v}", flush=True)
    print(", ".join(f"{name}: {count}" for name, count in total.items()))
    print("blind without a fault: " + (", ".join(f"{n} {why}" for why, n in refused.items()) or "never"))
    return int(total["violations"] > 0)


if __name__ == "__main__":
    sys.exit(main())

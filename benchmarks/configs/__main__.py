"""Flies with random valid configurations, and prints what raises, and what contradicts the truth.

    python -m benchmarks.configs [--configs N] [--first SEED] [--seconds S] [--all-keys] [--faults]

Without --all-keys only those keys are drawn that must not make anything free, or whose meaning the judge knows: nothing may
contradict the truth. With it all keys are drawn, and only exceptions count. The exit status is 1 if anything was found."""

from __future__ import annotations

import argparse
import sys
import traceback
from collections import Counter

import numpy as np

from .draw import any_key, judged_key, random_config, toml
from .flight import ConfiguredFlight

SHARES = (0.1, 0.4, 1.0)
"""Greatest share of the keys that are set, in turn."""
ERRORS = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)
"""Errors of the service that are reported with their configuration."""


def main() -> int:
    """Runs the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.configs")
    parser.add_argument("--configs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--all-keys", action="store_true")
    parser.add_argument(
        "--faults", action="store_true", help="random faults as in benchmarks.faults; needs 10 s and more"
    )
    args = parser.parse_args()
    total: Counter[str] = Counter()
    for seed in range(args.first, args.first + args.configs):
        total += _flown(seed, args)
    print(", ".join(f"{name}: {count}" for name, count in total.items()))
    return int(total["exceptions"] + total["faults"] > 0 or (total["violations"] > 0 and not args.all_keys))


def _flown(seed: int, args: argparse.Namespace) -> Counter[str]:
    rng = np.random.default_rng([92, seed])
    wanted = any_key if args.all_keys else judged_key
    content, config, refused = random_config(rng, SHARES[seed % len(SHARES)], wanted, flies=True)
    try:
        flight = ConfiguredFlight(config, seed, args.seconds, faults=args.faults)
        flight.fly(args.seconds)
    except ERRORS:
        print(f"configuration {seed} raises:\n{toml(content)}\n{traceback.format_exc()}", flush=True)
        return Counter(configurations=1, exceptions=1)
    judge = flight.judge
    report = flight.service.report if flight.service is not None else None
    fault = "" if report is None else report.fault
    print(
        f"configuration {seed}: {judge.planner} models, {judge.clear} clear sectors, {len(judge.violations)} violations {fault}",
        flush=True,
    )
    if judge.violations and not args.all_keys:
        print("\n".join([toml(content), *map(str, judge.violations[:5])]), flush=True)
    return Counter(
        configurations=1,
        refused_before=refused,
        models=judge.planner,
        messages=judge.messages,
        clear_sectors=judge.clear,
        free_paths=judge.paths,
        worlds=judge.worlds,
        faults=int(bool(fault)),
        violations=len(judge.violations),
    )


if __name__ == "__main__":
    sys.exit(main())

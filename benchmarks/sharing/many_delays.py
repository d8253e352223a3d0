"""Delays of new obstacles of two vehicles over four scenes and several seeds of the radio, without alignment:
`python -m benchmarks.sharing.many_delays SCENE BYTES_PER_S SEEDS`, SCENE street or trees."""

from __future__ import annotations

import sys
from unittest.mock import patch

import numpy as np

from benchmarks.sharing.delays import delays
from benchmarks.sharing.flights import Part, errors, flown, length_of, scene_of, ways
from benchmarks.sharing.measure import NS, START_UP_S
from benchmarks.sharing.radio import Channel
from benchmarks.sharing.virtual import play
from companion.share.team import Team

SCENES = (1, 2, 3, 4)
IN_TIME_S = 0.5


def parts_of(name: str, seed: int, *, same_way: bool) -> list[Part]:
    """The flights of both vehicles."""
    scene, ways_of_both = scene_of(name, length_of(2), seed), ways(2, same_way=same_way)
    pairs = zip(ways_of_both, errors(2, seed), strict=True)
    return [flown(scene, way, error, seed + 100 * k) for k, (way, error) in enumerate(pairs)]


def measured(name: str, bytes_per_s: float, seeds: int, *, same_way: bool) -> tuple[list[float], int]:
    """Returns the delays, s, of all runs, and the number of obstacles that never arrived."""
    found, never = list[float](), 0
    for scene in SCENES:
        parts = parts_of(name, scene, same_way=same_way)
        for seed in range(seeds):
            outcomes, _, begin_ns = play(parts, bytes_per_s, Channel(), 1000 * scene + seed)
            for sender, receiver in (outcomes, outcomes[::-1]):
                since_ns = begin_ns + round(START_UP_S * NS)
                some, missing = delays(sender.confirmed, receiver.received, sender.number, since_ns)
                found, never = found + some, never + missing
    return found, never


def main() -> int:
    """0: the lines were printed."""
    name, bytes_per_s, seeds = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    with patch.object(Team, "align", return_value=False):
        for same_way in (False, True):
            found, never = measured(name, bytes_per_s, seeds, same_way=same_way)
            total, s = len(found) + never, np.array(found)
            p50, p95, p99 = np.quantile(s, [0.5, 0.95, 0.99])
            print(
                f"{name}{', same way' if same_way else ''}: {len(s)} new, {100 * (s <= IN_TIME_S + 1e-9).sum() / total:.1f} % "
                f"within {IN_TIME_S} s, p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.1f}, max {s.max():.1f} s, "
                f"never {100 * never / total:.1f} %",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())

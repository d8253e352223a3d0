"""The page of the merged world: accuracy, cost and bytes; `python -m benchmarks --only world`."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.markdown import table
from benchmarks.paper.cases import held_out
from benchmarks.peers.grid_prisms import CELLS_M
from benchmarks.world.cost import PLANES, SIZES, WAYS, Asked, Cost, asked, costs, observations
from benchmarks.world.flights import CONDITION, ESTIMATES, HZ, TRUE, flights, judged, renderings
from benchmarks.world.message_bytes import OCTOMAP_M, OCTOMAP_STEP, Bytes, measured
from benchmarks.world.plots import draw_growing, draw_steps
from benchmarks.world.truth import BEHIND_M, Step, Verdict, merged, verdict
from companion.bench.timing import one_core
from core.world.serialize import ON_DISK
from osape_client.world.decode import PLANE_RECORD

GROWING_PNG, STEPS_PNG = "world_growing.png", "world_steps.png"
SEEDS, QUICK_SEEDS = 2, 1
RADII_M = (0.2, 0.5)


def section(out: Path, quick: bool) -> str:
    """The Markdown of the page; its pictures go to `out`."""
    seeds = held_out(QUICK_SEEDS if quick else SEEDS)
    found: list[Verdict] = []
    sizes: list[Bytes] = []
    steps: dict[str, list[Step]] = {}
    for seed in seeds:
        for flight in flights(seed):
            print(f"world: {flight.name}, seed {seed}", file=sys.stderr, flush=True)
            rendered, views = renderings(flight, CONDITION, seed), judged(flight, seed)
            for estimate in ESTIMATES:
                m = merged(flight, estimate, seed, rendered)
                found.append(verdict(flight, estimate, m, rendered, views))
                if estimate is TRUE and seed == seeds[0]:
                    sizes.append(measured(flight.name, m, rendered))
                    steps[flight.name] = m.steps
    print("world: cost", file=sys.stderr, flush=True)
    with one_core():
        frames = observations(flights(seeds[0])[0], seeds[0], 30)
        cost = costs(frames, 3 if quick else 6, SIZES[:3] if quick else SIZES)
        queries = [asked(radius) for radius in RADII_M]
    out.mkdir(parents=True, exist_ok=True)
    draw_growing(out / GROWING_PNG, seeds[0])
    draw_steps(out / STEPS_PNG, steps)
    return page(found, sizes, cost, queries, len(seeds))


def page(
    found: Sequence[Verdict], sizes: Sequence[Bytes], cost: Sequence[Cost], queries: Sequence[Asked], seeds: int
) -> str:
    """The text around the tables."""
    true = [v for v in found if v.estimate == TRUE.name]
    around = [v.closed for v in true if not math.isnan(v.closed)]
    return "\n".join(
        [
            f"Flown around, a building and the shapes of Fig. 15 become closed solids: of their inside at least "
            f"{_p(min(around), 0)} is occupied in the true pose, {_p(float(np.median(around)), 0)} in the median. Of what a flight saw, the "
            f"world misses at most {_p(max(v.missed for v in true))} of the obstacle rays from other places. A frame costs "
            f"{cost[-1].add_ms:.2f} ms in a world of {cost[-1].planes:,} planes, {cost[-1].add_ms / cost[0].add_ms:.2f} "
            f"times that of {cost[0].planes:,}.\n",
            "## Against the truth\n",
            f"Simulated flights at {HZ:g} frames a second and 2 m/s, 320 x 240 pixels, noise ke 0.0015 and a camera's faults, "
            f"{seeds} held-out seeds: around a building (14 x 9 x 6 m), through an alley and back, past trees, around the "
            "shapes of Fig. 15. The world is then looked at from places that the flight never held, in exact views. *Pose "
            "noise*: 5 cm and 0.3 degrees from frame to frame. *Drift*: that, and 1 % of the way flown, in one direction; the "
            "world is held against the truth where the newest frame has it. *Closed*: share of the inside that is occupied. "
            "*Missed*: obstacle rays that pass more than max(0.5 m, 2 sigma) behind what is there, of those that end at "
            "something the flight saw (*all*: of all). *Phantom*: rays stopped more than 1 m before anything. *Distance*: of "
            "what was seen to the nearest plane. *False free*: of points on surfaces, those called free. *Unseen free*: of "
            f"places {', '.join(f'{m:g}' for m in BEHIND_M[:-1])} and {BEHIND_M[-1]:g} m behind surfaces that no frame can have "
            "seen, those called free. *Air*: of places half way to a surface, those known to be free. Worst of the seeds for "
            "closed, missed, phantom, false free and unseen free; medians for the others.\n",
            truth_table(found),
            "Far from a flight's end its drift shows: a wall seen a hundred metres of flight ago stands a metre off, and is "
            "*missed* where it stands too far behind. Drift needs another remedy than merging (jumps are detected, "
            "[merged world](../../explanation/merged-world.md)). Phantoms past trees are planes of single looks through leaves.\n",
            "## Growing\n",
            f"![Worlds after a tenth, a third, two thirds and all of a flight]({GROWING_PNG})\n",
            "Seen from above: planes, closed solids filled, free cells at the height of the flight, the way flown. Planes run "
            "past corners as they were seen; solids end at them.\n",
            f"![Planes and bytes over the frames]({STEPS_PNG})\n",
            "## Cost of a frame\n",
            f"Frames of the flight around the building into worlds with a plane every ten metres, those nearby the same in "
            f"all; taken in turns in one process on one core, thread time, medians. *Changes*: what is streamed of it. "
            f"{PLANE_RECORD.itemsize} bytes a plane on the wire, {ON_DISK.itemsize} on disk.\n",
            cost_table(cost),
            "## Bytes of a flight\n",
            f"In the true pose, first seed. *Disk*: the saved world, moments included. *Stream*: all messages of the flight, "
            "five a second with a snapshot each 10 s, free space included; *planes*: of those the planes. *Grid*: outlines in "
            "the manner of 3DP of the cells that two frames found occupied, 8 bytes a vertex and a polygon, without free "
            f"space. *OctoMap*: its binary stream at {OCTOMAP_M:g} m of occupied leaves alone, and with free space, "
            f"given each frame in {OCTOMAP_STEP}.\n",
            bytes_table(sizes),
            "## Questions\n",
            f"{WAYS:,} straight ways of about 1.7 m against {PLANES} planes in 80 x 80 m with free cells, in one call, one "
            "core, thread time, median of five; the index is built within. Answers are those of brute force and of shapely "
            "(tests/client/test_world_space.py).\n",
            table(
                ("radius", "ways a second", "occupied", "free", "unknown"),
                ([f"{q.radius_m:g} m", f"{q.per_s:,.0f}", *(_p(a, 0) for a in q.answers)] for q in queries),
            ),
        ]
    )


TRUTH_HEAD = (
    "flight",
    "estimate",
    "closed",
    "missed",
    "all",
    "phantom",
    "distance, m",
    "p95, m",
    "false free",
    "unseen free",
    "air",
    "planes",
    "of all frames",
)


def truth_table(found: Sequence[Verdict]) -> str:
    """A row for each flight and estimate."""
    rows = []
    for name in dict.fromkeys(v.flight for v in found):
        for estimate in ESTIMATES:
            mine = [v for v in found if v.flight == name and v.estimate == estimate.name]
            median = {
                f: float(np.median([getattr(v, f) for v in mine]))
                for f in ("mean_m", "p95_m", "air", "planes", "frame_planes")
            }
            worst = {
                f: _greatest([getattr(v, f) for v in mine])
                for f in ("missed", "missed_all", "phantom", "false_free", "unseen_free")
            }
            rows.append(
                [
                    name,
                    estimate.name,
                    _p(-_greatest([-v.closed for v in mine]), 0),
                    *(_p(worst[f]) for f in ("missed", "missed_all", "phantom")),
                    f"{median['mean_m']:.3f}",
                    f"{median['p95_m']:.2f}",
                    *(_p(worst[f], 2) for f in ("false_free", "unseen_free")),
                    _p(median["air"], 0),
                    *(f"{median[f]:.0f}" for f in ("planes", "frame_planes")),
                ]
            )
    return table(TRUTH_HEAD, rows, words=2) + "\n"


def _greatest(values: Sequence[float]) -> float:
    """The greatest of the known values; nan: none is known."""
    return max((v for v in values if not math.isnan(v)), default=math.nan)


def cost_table(cost: Sequence[Cost]) -> str:
    """A row for each size."""
    head = ["planes", "a frame, ms", "p99", "ratio", "changes, ms", "bytes a plane"]
    rows = [
        [
            f"{c.planes:,}",
            f"{c.add_ms:.3f}",
            f"{c.p99_ms:.2f}",
            f"{c.add_ms / cost[0].add_ms:.2f}",
            f"{c.changes_ms:.3f}",
            f"{c.memory_bytes:.0f}",
        ]
        for c in cost
    ]
    return table(head, rows) + "\n"


def bytes_table(sizes: Sequence[Bytes]) -> str:
    """A row for each flight."""
    grids = [f"grid {cell:g} m" for cell in CELLS_M]
    heads = ["flight", "frames", "planes", "disk", "stream", "planes", "stream a frame", *grids, "OctoMap", "with free"]
    rows = []
    for b in sizes:
        peer = [f"{n:,}" if n is not None else "not installed" for n in (b.octomap, b.octomap_free)]
        cells = [
            b.flight,
            str(b.frames),
            str(b.planes),
            f"{b.disk:,}",
            f"{b.stream:,}",
            f"{b.stream_planes:,}",
            f"{b.stream / b.frames:,.0f}",
            *(f"{b.grids[cell]:,}" for cell in CELLS_M),
            *peer,
        ]
        rows.append(cells)
    return table(heads, rows) + "\n"


def _p(share: float, digits: int = 1) -> str:
    return "-" if math.isnan(share) else f"{100.0 * share:.{digits}f} %"

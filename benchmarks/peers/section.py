"""What others make of the same frames, side by side in one run; `python -m benchmarks --only peers`."""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from benchmarks.fidelity.matrix import FEW_TILTS_DEG, GOAL_KE, cases, spread
from benchmarks.fidelity.result import Case
from benchmarks.hardware_info import Stamp, stamp
from benchmarks.pages import INDEX, SECTIONS, index, page
from benchmarks.peers.grid_prisms import EPSILON_CELLS, HOLE_M, LAYER_M, MIN_POINTS, MIN_SHARE
from benchmarks.peers.methods import Peer
from benchmarks.peers.open3d_patches import THIN_M
from benchmarks.peers.participants import contestants
from benchmarks.peers.plots import draw_scatter, draw_times
from benchmarks.peers.run import CLOUD, Figures, run_case, time_peers
from benchmarks.peers.sequences.section import BRIEF as BRIEF_FLIGHTS
from benchmarks.peers.sequences.section import FULL as FULL_FLIGHTS
from benchmarks.peers.sequences.section import HEADING as SEQUENCES
from benchmarks.peers.sequences.section import QUICK as QUICK_FLIGHTS
from benchmarks.peers.sequences.section import sequences
from benchmarks.peers.tables import SHOWN, figures_table, groups, sentences, storage_table, times_table
from benchmarks.scenes.catalogue import FAMILIES, HELD_OUT_SEEDS
from companion.bench.timing import one_core

JUDGED = ("structured", "unstructured")
ERROR_PNG, RAYS_PNG, TIME_PNG = "peers_error_over_bytes.png", "peers_missed_over_stopped.png", "peers_time.png"
PARTS = ("frames", "sequences")
TIME_TILTS_DEG = ((0, 0), (10, -10))
TIME_SCENES = {"structured": "street", "unstructured": "trees"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How much is measured: scenes of each family, tilts, noise; rounds of timing over `seeds` scenes, and how long a
    slow peer may take over one kind of frame."""

    scenes: int
    tilts: tuple[tuple[float, float], ...]
    kes: tuple[float, ...]
    rounds: int
    seeds: int
    budget_s: float


FULL = Effort(scenes=100, tilts=FEW_TILTS_DEG, kes=GOAL_KE, rounds=60, seeds=3, budget_s=40.0)
BRIEF = Effort(scenes=6, tilts=((0, 0), (10, -10)), kes=GOAL_KE, rounds=30, seeds=1, budget_s=15.0)
QUICK = Effort(scenes=2, tilts=((0, 0),), kes=GOAL_KE[:1], rounds=5, seeds=1, budget_s=4.0)


def section(out: Path, quick: bool) -> str:
    """The page: runs every method and draws the pictures into `out`; progress goes to stderr."""
    frames = compared(out, QUICK if quick else FULL)
    return f"{frames}\n\n{sequences(out, QUICK_FLIGHTS if quick else FULL_FLIGHTS)}"


def compared(out: Path, effort: Effort) -> str:
    """The page of that effort."""
    with one_core():
        peers, absent = contestants()
        timings = time_peers(peers, timed_cases(effort), effort.rounds, effort.budget_s)
    rows = judge(judged_cases(effort))
    out.mkdir(parents=True, exist_ok=True)
    draw_times(out / TIME_PNG, timings)
    distance = ("mean_m", "distance of a true point to the surface, m, median case")
    draw_scatter(out / ERROR_PNG, rows, ("bytes", "bytes a frame, median case"), distance, (1.0, 1e-3))
    stopped, missed = ("open_stopped", "open rays stopped, %"), ("missed", "obstacle rays missed, %")
    draw_scatter(out / RAYS_PNG, rows, stopped, missed, (0.01, 0.001))
    tables = [
        f"### {family}, ke {ke:g} ({len(next(iter(found.values())))} frames)\n\n{figures_table({k: v for k, v in found.items() if k in SHOWN}, absent)}"
        for (family, ke), found in groups(rows).items()
    ]
    said = "\n".join(f"- {line}" for line in sentences(rows, timings))
    gone = "".join(f"\n\n**{name} was not run**: {why}." for name, why in absent)
    return "\n\n".join(
        [
            f"{HEAD}{gone}",
            scene_names({r.case: r.family for r in rows}),
            "## Figures",
            _LEGEND,
            f"![Distance over bytes]({ERROR_PNG})\n![Missed over stopped]({RAYS_PNG})",
            *tables,
            "## Storage and precision beside the grid",
            _STORAGE,
            storage_table(rows),
            "## Time",
            _TIME.format(cloud=CLOUD),
            times_table([t for t in timings if t.peer in SHOWN], absent),
            f"![Time of a frame]({TIME_PNG})",
            "## Comparison",
            "From the figures above, ours being `safe`; medians over the frames, shares over all rays.",
            said,
            _FAIR,
        ]
    )


def scene_names(families: dict[Case, str]) -> str:
    """What was looked at, from the cases themselves."""
    tilts = dict.fromkeys(f"{c.roll_deg:+.0f}/{c.pitch_deg:+.0f}" for c in families)
    names = {f: ", ".join(dict.fromkeys(c.scene for c in families if families[c] == f)) for f in families.values()}
    scenes = "; ".join(f"{family[:1].upper()}{family[1:]}: {found}" for family, found in names.items())
    seed = ", ".join(str(s) for s in sorted({c.seed for c in families}))
    return _SCENES.format(frames=len(families), tilts=", ".join(tilts), scenes=scenes, seed=seed)


def timed_cases(effort: Effort) -> dict[str, list[Case]]:
    """Frames of each kind: one scene of each family, level and tilted."""
    seeds = HELD_OUT_SEEDS[: effort.seeds]
    return {kind: list(cases([name], seeds, TIME_TILTS_DEG, GOAL_KE[:1])) for kind, name in TIME_SCENES.items()}


def judged_cases(effort: Effort) -> list[Case]:
    """The cases of the figures, in an order in which those of one view come together."""
    scenes = [name for family in JUDGED for name in _spread(FAMILIES[family], effort.scenes)]
    return list(spread(scenes, HELD_OUT_SEEDS[:1], effort.tilts, kes=effort.kes))


def _spread(names: tuple[str, ...], count: int) -> list[str]:
    """At most `count` of the names, evenly over all of them."""
    step = max(1, len(names) // count)
    return list(names[::step][:count])


@functools.cache
def _of_this_process() -> list[Peer]:
    return contestants()[0]


def _judge(case: Case) -> list[Figures]:
    return run_case(case, _of_this_process())


def judge(todo: list[Case]) -> list[Figures]:
    """All peers on all cases, on all processors, in the order of the cases."""
    found: list[Figures] = []
    with multiprocessing.get_context("spawn").Pool(os.cpu_count()) as pool:
        for i, rows in enumerate(pool.imap(_judge, todo, chunksize=2)):
            found.extend(rows)
            print(f"\rpeers: {i + 1}/{len(todo)} {todo[i].name}            ", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return found


HEAD = f"""Every frame goes to all; all are judged by the same rays and the same points.

- **OSAPE, safe** is ours as it flies, **OSAPE, paper** the stages as printed. Both start from the depth image and the attitude.
- **3DP grid** is our own compiled code in the manner of the paper's baseline: a grid of occupied cells for each {LAYER_M:g} m of height, outlined by polygons, one plane a side. A cell is occupied when it holds {MIN_POINTS} points at least, and {100 * MIN_SHARE:.0f} % of what something of the least height right across it would show at its distance. Outlines are simplified by Douglas-Peucker with {EPSILON_CELLS:g} cells, free spots narrower than {HOLE_M:g} m are filled, sides on one line are one.
- **OctoMap** (pyoctomap) gets the frame's points inserted into an empty tree with all their rays, the library's own chances, points of one leaf as one hit.
- **Open3D planar patches** come of the cloud thinned to {THIN_M:g} m, normals of 30 neighbours; **Open3D VoxelGrid** holds the cubes with a point in them.

All but ours get what ours has to find: the true ground (its points are taken out), the true noise, and pixels that are sorted by the rules of ours: the range cut before the clip shows through the noise, flying pixels out, specks of fewer than 7 pixels out."""
_SCENES = """Frames: {frames} of 640x480, 2 m above the ground (lower under ceilings), with noise sigma_Z = ke Z², 5 % dropout, blob holes, 0.2 % of 2x2 mismatches and flying pixels, at roll and pitch of {tilts} degrees. {scenes}. Seeds {seed}, of those by which nothing was chosen."""
_LEGEND = """Medians over the frames (worst frame) for sizes and distances, shares over all rays together (worst frame). *Distance*: of a visible true obstacle point to the surface of the model; *to the body*: 0 where it is inside of one. *Missed*: obstacle rays let pass more than max(0.5 m, 2 sigma) beyond the truth. *Phantom*: rays stopped more than max(1 m, 3 sigma) before the truth, farther than that from everything true; *over the open*: the same of rays to ground and sky. *Open rays stopped*: at all, near an obstacle or not. Prisms of the grid count as bodies with lids, cubes as cubes. *Bytes*: 8 a vertex and 8 a prism (ours and the grid's), the binary stream of a tree of what is occupied (OctoMap), 6 a voxel, 36 a patch. Ours holds free space, margins and flags besides, OctoMap's tree free space; neither is counted. The tables leave out coarser cells; the pictures show all."""
_STORAGE = """Ours (safe) over the grid's, case by case: median (worst; in how many a goal is missed). The goals: planes and bytes at most 0.5 of the simplified 0.8 m grid, error at most 0.2 (structured) or 1 (unstructured) of the 0.1 m grid. *Front sides*: only those of the grid's sides that face the camera, since ours is made of nothing else. *Not simplified*: sides on one line merged, nothing else. *Of all pixels*: the grid as it comes without any sorting of pixels: every cell with 3 measured points above the ground, mismatches and the near tail of what lies beyond the range included; ours sorts its pixels, so this one is no fair comparison, only an old one."""
_TIME = """One thread on one core, after warm-up, all in turn on each frame; processor time of the whole process, median (99th percentile); how many times that of ours, without and with *{cloud}*, from which they start; the wall's median; how many frames. Ours: depth image to planes, prisms and free space. Below 1 is faster than ours."""
_FAIR = """## What this does not say

- OctoMap is made for many frames of one place, where its probabilities average out the noise; here it has one frame, as all have. [Sequences of frames](#sequences-of-frames) are below.
- A voxel keeps what is there and nothing more. Ours fills gaps that are too small to pass, by intent: that costs open rays stopped and shows in the distances of foliage.
- The distance to a surface is unfavourable for bodies: where noise makes a wall a metre thick, the truth is in the middle of it. *To the body* is unfavourable for sheets: a body that is thick enough contains every true point. Both are given; phantom shows which bodies are too thick.
- A patch stands for what is flat, and what is not flat it leaves out: its missed rays are what a plane extractor costs in foliage.

Again: `python -m benchmarks --only peers`, a rough look with `--quick`."""


def main(arguments: list[str] | None = None) -> int:
    """Writes the shortened page in docs/research/benchmarks, or one of its two parts: `python -m benchmarks.peers.section
    --brief`."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.section", description=main.__doc__)
    parser.add_argument("--brief", action="store_true", required=True, help="a fifth of the work; else: make bench")
    parser.add_argument("--only", choices=PARTS, help="this part; the other one stays as it is")
    parser.add_argument(
        "--out", type=Path, default=Path("docs/research/benchmarks"), help="folder of the page and its pictures"
    )
    args = parser.parse_args(arguments)
    file = args.out / "peers.md"
    old = split_page(file.read_text() if file.exists() else "")
    begun = time.monotonic()

    def stamped() -> Stamp:
        minutes = (time.monotonic() - begun) / 60.0
        command = f"{parser.prog} --brief" + (f" --only {args.only}" if args.only else "")
        return replace(stamp([], minutes=minutes, quick=False), command=command)

    text = old.frames
    if args.only != "sequences":
        frames = compared(args.out, BRIEF)
        text = page(next(s for s in SECTIONS if s.name == "peers"), frames, stamped()).strip()
    flights = old.sequences
    if args.only != "frames":
        begun = time.monotonic()
        flights = sequences(args.out, BRIEF_FLIGHTS)
        flights = flights.replace(SEQUENCES, f"{SEQUENCES}\n\n{stamped().markdown().strip()}", 1)
    file.write_text(f"{text}\n\n{flights}".strip() + "\n")
    (args.out / INDEX).write_text(index(args.out))
    return 0


class Parts(NamedTuple):
    """The Markdown of the two parts of the page."""

    frames: str
    sequences: str


def split_page(text: str) -> Parts:
    """The parts of a page, each empty where it is not there."""
    frames, heading, rest = text.partition(f"{SEQUENCES}\n")
    return Parts(frames.strip(), f"{heading}{rest}".strip())


if __name__ == "__main__":
    sys.exit(main())

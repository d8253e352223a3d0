"""The part of the peers' page on methods that merge the frames of a flight."""

from __future__ import annotations

import functools
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.peers.sequences.frame_input import GROUND_CUT_M, POSES
from benchmarks.peers.sequences.judge import ASIDE_DEG, Figures
from benchmarks.peers.sequences.ours import FRAME, TRACKS, WORLD
from benchmarks.peers.sequences.plots import draw
from benchmarks.peers.sequences.run import JUDGED, SPEED_M_S, Case, Maker, makers, run_case
from benchmarks.peers.sequences.tables import sentences, summary_table
from benchmarks.peers.sequences.tsdf import BLOCK, TRUNCATION, WEIGHT
from benchmarks.peers.sequences.wavemap import CLEANED_EVERY, SCALING_FREE, SCALING_OCCUPIED, SIGMA_AT_M
from benchmarks.scenes.catalogue import HELD_OUT_SEEDS
from benchmarks.tracking.sequences import HZ
from companion.bench.timing import ONE_THREAD

HEADING: Final = "## Sequences of frames"
PICTURE: Final = "peers_sequences.png"
KES: Final = (0.0015, 0.005)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What is flown. width: of the image, pixels; left_out: methods that take too long."""

    scenes: tuple[str, ...]
    kes: tuple[float, ...] = KES
    judged: tuple[int, ...] = JUDGED
    width: int = 640
    left_out: tuple[str, ...] = ()


FULL: Final = Plan(scenes=("street", "trees", "alley", "tunnel", "movers"))
BRIEF: Final = Plan(scenes=("street", "trees", "tunnel", "movers"), width=320, left_out=("OctoMap 0.1 m",))
QUICK: Final = Plan(scenes=("street",), kes=KES[:1], judged=(5, 10), width=320)


def sequences(out: Path, plan: Plan) -> str:
    """The Markdown of that part, from its heading on; its picture goes to `out`."""
    _, absent = makers()
    rows = judge(cases(plan))
    out.mkdir(parents=True, exist_ok=True)
    draw(out / PICTURE, rows)
    return text(plan, rows, absent)


def cases(plan: Plan) -> list[Case]:
    """All flights; those of one noise come together."""
    return [
        Case(
            scene=scene,
            ke_per_m=ke,
            seed=HELD_OUT_SEEDS[0],
            judged=plan.judged,
            width=plan.width,
            left_out=plan.left_out,
        )
        for ke in plan.kes
        for scene in plan.scenes
    ]


@functools.cache
def _of_this_process() -> list[Maker]:
    return makers()[0]


def _run(case: Case) -> list[Figures]:
    return run_case(case, _of_this_process())


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started within have one thread in every library."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


def judge(todo: Sequence[Case]) -> list[Figures]:
    """All methods on all flights, on all processors, in the order of the flights. A process is used for one flight, so that
    the memory of large maps is freed."""
    found: list[Figures] = []
    with _one_thread(), multiprocessing.get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=1) as pool:
        for case, rows in zip(todo, pool.imap(_run, todo, chunksize=1), strict=True):
            found.extend(rows)
            print(f"peers: sequence {case.scene}, ke {case.ke_per_m:g}", file=sys.stderr, flush=True)
        pool.close()  # a process that is terminated instead prints a trace of wavemap's logging library
        pool.join()
    return found


def text(plan: Plan, rows: Sequence[Figures], absent: Sequence[tuple[str, str]]) -> str:
    """The words and the tables."""
    first, last = plan.judged[0], plan.judged[-1]
    gone = "".join(f"\n\n**{name} was not run**: {why}." for name, why in absent)
    gone += "".join(f"\n\n**{name} was not run** in this shortened page: it takes too long." for name in plan.left_out)
    tables = [
        f"### {pose}, ke {ke:g}, all scenes\n\n{summary_table([r for r in rows if r.frames == last], ke, pose)}"
        for ke in plan.kes
        for pose in POSES
    ]
    flown = _FLOWN.format(
        scenes=", ".join(plan.scenes), frames=f"{first} and {last}", width=plan.width, height=plan.width * 3 // 4
    )
    better = "\n".join(f"- {line}" for line in sentences(rows, last, (FRAME, TRACKS, WORLD)))
    picture = f"![Shares of rays]({PICTURE})"
    words = [f"### Where others are better after {last} frames", better, _FOUND]
    return "\n\n".join([HEADING, flown, _METHODS + gone, _BUILD, _LEGEND, picture, *tables, *words])


_FLOWN = f"""Flights northwards at {SPEED_M_S:g} m/s with a swaying attitude, {HZ:g} frames a second of {{width}}x{{height}} pixels with all image faults: {{scenes}}. *Movers*: two people who walk and a car that crosses. Every method merges the same frames and is judged after {{frames}} of them (the tables: after the last) from the view of the newest frame, by the same rays as above. The pose is true, or its position drifts by 5 % of the way to north and as much to east (0.11 m/s; 0.44 m after 50 frames); the attitude is true. A map is placed by the newest reported pose, as a planner would do, so that an error of the pose that all frames share costs nothing."""
_METHODS = f"""- **OSAPE, frame**: the newest frame alone. **OSAPE, tracks**: all tracks of the tracker after this frame. **OSAPE, world**: all planes of the merged world. Default parameters; each from the depth image as the camera delivers it. Margins are not counted.
- **OctoMap** (pyoctomap), leaves of 0.1 and 0.2 m: all points with their rays, points of one leaf as one hit, the library's own probabilities: hit 0.7, miss 0.4, clamped to 0.12 and 0.97, occupied from 0.5.
- **Open3D TSDF**, the VoxelBlockGrid, voxels of 0.1 and 0.2 m: blocks of {BLOCK} voxels around the measured surfaces, truncation at {TRUNCATION:g} voxels, judged by its mesh of voxels with at least {WEIGHT:g} observations; the library's own values, and its own scheme, which updates only the blocks near the surfaces of the newest frame.
- **wavemap** (pywavemap 2.2.1), cells of 0.1 and 0.2 m: hashed chunked wavelet octree, continuous ray model with the scalings of its examples ({SCALING_FREE:g} free, {SCALING_OCCUPIED:g} occupied), its one standard deviation set to that of the camera at {SIGMA_AT_M:g} m, thresholded and pruned every {CLEANED_EVERY} frames; a cell is occupied above log-odds 0, except where it was never observed.

The others get without measuring it: the true noise, pixels that are sorted as above (here with the ground, whose rays clear space), and the true ground: a cube or triangle whose centre is less than {GROUND_CUT_M:g} m above it is not counted. Nothing of theirs was tuned on these scenes, and nothing of ours."""
_BUILD = """wavemap has no wheel and is no dependency. For these figures it was built from commit db4f2ff of github.com/ethz-asl/wavemap with g++ 12, cmake 3.25, nanobind 3.1.0 and scikit-build-core 1.1.2: `apt install libeigen3-dev libgoogle-glog-dev libboost-dev`, then in its folder `library/python` `pip install nanobind scikit-build-core` and `pip install --no-build-isolation --no-deps .`. Pixels without a measurement are given to it as -100 m: with 0 it makes an obstacle of up to 6 standard deviations at the camera."""
_FOUND = """The causes of the phantoms of the merged world are in [notes on the merged world](../world-notes.md#beside-maps-of-cubes)."""
_LEGEND = f"""*Missed*, *phantom* (here of obstacle and open rays together), *open rays stopped*: as above, over all rays of all scenes (worst scene). *Missed aside*: the same as missed from the same place, turned by {abs(ASIDE_DEG[0]):g} degrees to either side, of the rays that end at something that two frames had in view: what a map remembers. *Error along the ray*: absolute difference of stop and truth of the obstacle rays that are stopped anywhere, median (95th percentile); *bias*: median of the difference, negative: too near. *Bytes*: as sent or stored, free space included where the method has it: our messages, OctoMap's binary stream, wavemap's file; of the TSDF the blocks in use, 8 bytes a voxel. *CPU*: of one thread, median of the frames since the last judged one; that of ours includes the extraction, that of the others leaves out the sorting of pixels. Medians of the scenes for all but the rays."""

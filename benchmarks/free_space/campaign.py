"""Random scenes against the free-range profile: how many claimed cells are wrong, and where.

    python -m benchmarks.free_space.campaign --frames 5000 --seed 1
    python -m benchmarks.free_space.campaign --matrix --frames 0
    python -m benchmarks.free_space.campaign --worlds 200 --sectors 2000 --readers 2000 --frames 0
    python -m benchmarks.free_space.campaign --unusual 4000 --rigs 1000 --frames 0

Frames are judged by every claimed cell of their profile, worlds (flights of 12 frames) by every free cell, sectors by every
clear one, rigs (one to four cameras) by every sector that is clear or has an obstacle, readers by what osape_client.Space answers. Prints each wrong scene, and a summary as JSON in the last line. Exits with 1 where anything is wrong, or nothing is called free.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass

from benchmarks.free_space.biased_frames import biased_frame
from benchmarks.free_space.blank_frames import blank_frame
from benchmarks.free_space.hard_frames import hard_frames
from benchmarks.free_space.matrix import matrix_frames
from benchmarks.free_space.near_frames import near_frame
from benchmarks.free_space.random_frames import RandomFrame, random_frame
from benchmarks.free_space.readers import judge_readers
from benchmarks.free_space.rigs import judge_rig, random_rig
from benchmarks.free_space.unusual_frames import unusual_frame
from benchmarks.free_space.volume import WrongCell, wrong_cells
from benchmarks.free_space.worlds import judge_sectors, judge_world
from benchmarks.open_air.open_claims import as_free
from core.extractor import Extractor
from core.open_sky_params import OpenSkyParams
from core.params import Params


@dataclass(slots=True)
class Counts:
    """Counts of a campaign: all frames and invalid ones, free cells, wrong ones and the frames with wrong cells."""

    frames: int = 0
    invalid: int = 0
    cells: int = 0
    wrong: int = 0
    wrong_frames: int = 0
    deepest_m: float = 0.0
    worlds: int = 0
    world_cells: int = 0
    wrong_world_cells: int = 0
    sector_frames: int = 0
    clear_sectors: int = 0
    wrong_sectors: int = 0
    rigs: int = 0
    rig_sectors: int = 0
    wrong_rig_sectors: int = 0
    reader_frames: int = 0
    reader_cells: int = 0
    wrong_reader_cells: int = 0
    free_points: int = 0
    wrong_points: int = 0

    @property
    def without_claims(self) -> list[str]:
        """What was run in which nothing was called free, so that nothing was checked."""
        each = {
            "frames": (self.frames, self.cells),
            "worlds": (self.worlds, self.world_cells),
            "sectors": (self.sector_frames, self.clear_sectors),
            "rigs": (self.rigs, self.rig_sectors),
            "readers": (self.reader_frames, self.reader_cells),
        }
        return [name for name, (run, claimed) in each.items() if run and not claimed]

    @property
    def any_wrong(self) -> bool:
        """Whether anything called free was not."""
        sectors = self.wrong_sectors + self.wrong_rig_sectors
        return self.wrong + self.wrong_world_cells + sectors + self.wrong_reader_cells + self.wrong_points > 0


def judge(r: RandomFrame, extractor: Extractor, below_ground: bool) -> tuple[list[WrongCell], int, bool, str]:
    """(wrong cells, cells claimed, whether the model is valid, what ground it found) of one frame. Open space is judged as
    free space."""
    model, _ = extractor.extract(r.frame.depth_mm, r.frame.info, r.frame.R_level_optical)
    wrong, cells = wrong_cells(r.frame, as_free(model), r.ke_per_m, extractor.params, below_ground=below_ground)
    ground = f"ground {model.ground.height_m:.2f} m" if model.ground.seen else "no ground"
    return wrong, cells, model.valid, ground


def describe(r: RandomFrame, wrong: list[WrongCell], ground: str) -> str:
    """One line about a wrong frame: its camera and its worst cell."""
    worst = max(wrong, key=lambda w: w.deep_m)
    name = r.frame.scene.names[worst.solid] if worst.solid >= 0 else "ground"
    return (
        f"{r.frame.scene.name} {r.number}: {len(wrong)} cells, {r.frame.info.max_range_m:g} m camera of {r.frame.info.intrinsics.width} px, "
        f"ke {r.ke_per_m:g}, pitch {r.pitch_deg:.1f}, roll {r.roll_deg:.1f}, {-r.frame.position_ned_m[2]:.2f} m up, {ground}; "
        f"worst: {name} at {worst.range_m:.2f} m in a cell free to {worst.free_to_m:.2f} m, azimuth "
        f"{math.degrees(worst.azimuth_rad):.1f}, z {worst.z_m:.2f} m, layer {worst.layer}, direction {worst.direction}"
    )


def run_frames(frames: Iterable[RandomFrame], below_ground: bool, counts: Counts) -> None:
    """Judges frames; wrong ones go to stdout."""
    extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
    for r in frames:
        wrong, cells, valid, ground = judge(r, extractor, below_ground)
        counts.frames += 1
        counts.invalid += not valid
        counts.cells += cells
        if wrong:
            counts.wrong += len(wrong)
            counts.wrong_frames += 1
            counts.deepest_m = max(counts.deepest_m, max(w.deep_m for w in wrong))
            print(describe(r, wrong, ground), flush=True)


def run_worlds(first: int, worlds: int, seed: int, counts: Counts) -> None:
    """Checks the worlds of this number of flights; wrong ones are printed."""
    extractor = Extractor(Params())
    for number in range(first, first + worlds):
        wrong, cells, _ = judge_world(seed, number, extractor)
        counts.worlds += 1
        counts.world_cells += cells
        counts.wrong_world_cells += len(wrong)
        if len(wrong):
            print(
                f"world {number}: {len(wrong)} of {cells} free cells in a solid or never seen, the first at {wrong[0].round(2)}",
                flush=True,
            )


def run_sectors(first: int, frames: int, seed: int, counts: Counts) -> None:
    """Checks the clear sectors of this number of frames; wrong ones are printed."""
    extractor = Extractor(Params())
    for number in range(first, first + frames):
        wrong, clear = judge_sectors(random_frame(seed, number), extractor)
        counts.sector_frames += 1
        counts.clear_sectors += clear
        counts.wrong_sectors += len(wrong)
        if wrong:
            print(f"sectors of frame {number}: {wrong} of {clear} clear ones hold a solid", flush=True)


def run_rigs(first: int, rigs: int, seed: int, counts: Counts) -> None:
    """Checks the sectors around this number of vehicles with random cameras; wrong ones are printed."""
    extractor = Extractor(Params())
    for number in range(first, first + rigs):
        rig = random_rig(seed, number)
        judged = judge_rig(rig, extractor)
        counts.rigs += 1
        counts.rig_sectors += judged.clear + judged.obstacles
        counts.wrong_rig_sectors += len(judged.wrong)
        for sector, at_m, sent_m in judged.wrong:
            print(
                f"rig {number} of {len(rig.cameras)} cameras: sector {sector} reaches to {sent_m:.2f} m, a solid stands at {at_m:.2f} m",
                flush=True,
            )


def run_readers(first: int, frames: int, seed: int, counts: Counts) -> None:
    """Checks the answers of `Space` for this number of frames; wrong ones are printed."""
    extractor = Extractor(Params())
    for number in range(first, first + frames):
        c = judge_readers(random_frame(seed, number), extractor)
        counts.reader_frames += 1
        counts.reader_cells += c.cells
        counts.wrong_reader_cells += c.wrong_cells
        counts.free_points += c.points
        counts.wrong_points += c.wrong_points
        counts.deepest_m = max(counts.deepest_m, c.deepest_m)
        if c.wrong_cells or c.wrong_points:
            print(
                f"readers of frame {number}: {c.wrong_cells} of {c.cells} cells, {c.wrong_points} of {c.points} free points, "
                f"{c.where}",
                flush=True,
            )


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument(
        "--matrix", action="store_true", help="the fidelity run's scenes seen by short, pitched cameras too"
    )
    parser.add_argument(
        "--below-ground",
        action="store_true",
        help="judge frames as a caller who does not treat the model's ground as solid",
    )
    parser.add_argument(
        "--near", type=int, default=0, help="frames with things nearer than the minimum range, which are not measured"
    )
    parser.add_argument(
        "--blank", type=int, default=0, help="frames in which some things are not measured at any range"
    )
    parser.add_argument(
        "--biased",
        type=int,
        default=0,
        help="frames whose depths are all too great, by the bias that the camera states",
    )
    parser.add_argument(
        "--hard",
        action="store_true",
        help="views of thin, near and cut-off things, steps of the ground and steep cameras, with open space",
    )
    parser.add_argument("--worlds", type=int, default=0)
    parser.add_argument("--sectors", type=int, default=0, help="frames whose sectors are judged")
    parser.add_argument(
        "--unusual",
        type=int,
        default=0,
        help="frames of cameras with other sizes, lenses, attitudes, noise and defects",
    )
    parser.add_argument(
        "--rigs", type=int, default=0, help="vehicles with one to four such cameras, whose sectors are judged"
    )
    parser.add_argument(
        "--readers", type=int, default=0, help="frames whose answers are judged, below the ground that was found too"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first frame")
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args(arguments)
    counts = Counts()
    numbers = range(a.first, a.first + a.frames)
    run_frames((random_frame(a.seed, number) for number in numbers), a.below_ground, counts)
    if a.matrix:
        run_frames(matrix_frames(a.seed), a.below_ground, counts)
    run_frames((near_frame(a.seed, number) for number in range(a.first, a.first + a.near)), a.below_ground, counts)
    run_frames((blank_frame(a.seed, number) for number in range(a.first, a.first + a.blank)), a.below_ground, counts)
    run_frames((biased_frame(a.seed, number) for number in range(a.first, a.first + a.biased)), a.below_ground, counts)
    run_frames(
        (unusual_frame(a.seed, number) for number in range(a.first, a.first + a.unusual)), a.below_ground, counts
    )
    if a.hard:
        run_frames(hard_frames(a.seed), a.below_ground, counts)
    run_worlds(a.first, a.worlds, a.seed, counts)
    run_sectors(a.first, a.sectors, a.seed, counts)
    run_rigs(a.first, a.rigs, a.seed, counts)
    run_readers(a.first, a.readers, a.seed, counts)
    for name in counts.without_claims:
        print(f"{name}: nothing was called free in any of them, so nothing was checked", flush=True)
    print(json.dumps(asdict(counts)))
    return 1 if counts.any_wrong or counts.without_claims else 0


if __name__ == "__main__":
    sys.exit(main())

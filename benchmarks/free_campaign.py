"""Random scenes against the free-range profile: how many claimed cells are wrong, and where.

    python -m benchmarks.free_campaign --frames 5000 --seed 1

Prints each wrong frame with its worst cell, and a summary as JSON in the last line. Exits with 1 where anything is wrong.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass

from benchmarks.free_volume import WrongCell, wrong_cells
from benchmarks.random_frames import RandomFrame, random_frame
from core.extractor import Extractor
from core.params import Params


@dataclass(slots=True)
class Counts:
    """Of a campaign: frames in all and those that say nothing, cells called free, wrong ones and the frames they are in."""

    frames: int = 0
    invalid: int = 0
    cells: int = 0
    wrong: int = 0
    wrong_frames: int = 0
    deepest_m: float = 0.0


def judge(r: RandomFrame, extractor: Extractor) -> tuple[list[WrongCell], int, bool, str]:
    """(wrong cells, cells claimed, whether the model is valid, what ground it found) of one frame."""
    model, _ = extractor.extract(r.frame.depth_mm, r.frame.info, r.frame.R_level_optical)
    wrong, cells = wrong_cells(r.frame, model, r.ke_per_m, extractor.params)
    ground = f"ground {model.ground.height_m:.2f} m" if model.ground.seen else "no ground"
    return wrong, cells, model.valid, ground


def describe(r: RandomFrame, wrong: list[WrongCell], ground: str) -> str:
    """One line about a wrong frame: its camera and its worst cell."""
    worst = max(wrong, key=lambda w: w.deep_m)
    name = r.frame.scene.names[worst.solid] if worst.solid >= 0 else "ground"
    return (
        f"frame {r.number}: {len(wrong)} cells, {r.frame.info.max_range_m:g} m camera of {r.frame.info.intrinsics.width} px, "
        f"ke {r.ke_per_m:g}, pitch {r.pitch_deg:.1f}, roll {r.roll_deg:.1f}, {-r.frame.position_ned_m[2]:.2f} m up, {ground}; "
        f"worst: {name} at {worst.range_m:.2f} m in a cell free to {worst.free_to_m:.2f} m, azimuth "
        f"{math.degrees(worst.azimuth_rad):.1f}, z {worst.z_m:.2f} m, layer {worst.layer}, direction {worst.direction}"
    )


def run(first: int, frames: int, seed: int) -> Counts:
    """Judges frames first..first + frames - 1; wrong ones go to stdout."""
    extractor, counts = Extractor(Params()), Counts()
    for number in range(first, first + frames):
        r = random_frame(seed, number)
        wrong, cells, valid, ground = judge(r, extractor)
        counts.frames += 1
        counts.invalid += not valid
        counts.cells += cells
        if wrong:
            counts.wrong += len(wrong)
            counts.wrong_frames += 1
            counts.deepest_m = max(counts.deepest_m, max(w.deep_m for w in wrong))
            print(describe(r, wrong, ground), flush=True)
    return counts


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="number of the first frame")
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args(arguments)
    counts = run(a.first, a.frames, a.seed)
    print(json.dumps({name: getattr(counts, name) for name in Counts.__slots__}))
    return 1 if counts.wrong else 0


if __name__ == "__main__":
    sys.exit(main())

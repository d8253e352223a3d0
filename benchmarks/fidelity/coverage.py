"""Coverage of the published margins: the share of true obstacle points that no plane, less its margin, leaves in front.

Run `python -m benchmarks.fidelity.coverage`. A true point is covered where its ray meets a plane before it, or where it lies within
a plane's margin of that plane. The frames are ray-cast, so the truth is known."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.case import FRAMES, frames_of, model_of, true_rays
from benchmarks.fidelity.matrix import FEW_TILTS_DEG, GOAL_KE, spread
from benchmarks.fidelity.metrics import Rays, stops
from benchmarks.fidelity.result import Case
from benchmarks.scenes.catalogue import TUNING_SEEDS
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.params import Params
from core.types import FrameModel
from drivers.simulation.source import Rendered

BINS_M = (0.0, 4.0, 8.0, 12.0, 20.0)
"""Edges of the bins of true range."""
SCENES = ("wall", "street", "paper_corridor", "courtyard", "trees", "mixture", "rubble", "pole_ranges")
NOISES = {"white": "white", "correlated": "all"}
"""Name -> benchmarks.fidelity.case.FAULTS."""
ROUNDING_M = 0.002
"""Depth is delivered in millimetres, planes are float32."""
_AT_ONCE = 4096

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Coverage:
    """points, covered: (bins,) true obstacle points by their range, and those that are covered; frames, invalid: all frames, and
    those without a valid model, whose points are not among them."""

    points: Counts
    covered: Counts
    frames: int = 1
    invalid: int = 0

    def __add__(self, other: Coverage) -> Coverage:
        return Coverage(
            self.points + other.points,
            self.covered + other.covered,
            self.frames + other.frames,
            self.invalid + other.invalid,
        )

    def shares(self) -> Floats:
        """(bins,) share that is covered; nan without points."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covered / self.points)


def within_margin(points_m: Floats, planes: Floats, margins_m: Floats) -> NDArray[np.bool_]:
    """(P,) whether a point (P, 3) lies within the margin of any plane (N, 6), each as a finite rectangle."""
    a, edge = planes[:, 0:2], planes[:, 2:4] - planes[:, 0:2]
    length2 = np.maximum((edge * edge).sum(axis=1), 1e-12)
    found = np.zeros(len(points_m), bool)
    for start in range(0, len(points_m), _AT_ONCE):
        p = points_m[start : start + _AT_ONCE]
        off = p[:, None, 0:2] - a
        t = np.clip((off * edge).sum(axis=2) / length2, 0.0, 1.0)
        flat = off - t[..., None] * edge
        above = np.maximum(0.0, np.maximum(planes[:, 4] - p[:, 2:3], p[:, 2:3] - planes[:, 5]))
        distance = np.sqrt((flat * flat).sum(axis=2) + above * above)
        found[start : start + _AT_ONCE] = (distance <= margins_m + ROUNDING_M).any(axis=1)
    return found


def is_covered(frame: Rendered, rays: Rays, planes: Floats, margins_m: Floats) -> NDArray[np.bool_]:
    """(P,) whether each true obstacle point of a frame, in the order of `rays.obstacle`, is covered by planes (N, 6)."""
    depth, _ = stops(planes, frame.info.intrinsics, frame.R_level_optical)
    covered = (depth * rays.per_depth)[rays.obstacle] <= rays.range_m[rays.obstacle] + ROUNDING_M
    if len(planes):
        rest = frame.truth.points_level_cam_m[rays.obstacle][~covered]
        covered[~covered] = within_margin(rest, planes, margins_m)
    return np.asarray(covered)


def coverage(frame: Rendered, rays: Rays, model: FrameModel) -> Coverage:
    """How many true obstacle points of a frame are covered, by range."""
    covered = is_covered(frame, rays, model.planes.astype(np.float64), model.margin_m.astype(np.float64))
    bins = np.minimum(np.digitize(rays.range_m[rays.obstacle], BINS_M) - 1, len(BINS_M) - 2)
    return Coverage(np.bincount(bins, minlength=len(BINS_M) - 1), np.bincount(bins[covered], minlength=len(BINS_M) - 1))


def of_cases(todo: Iterable[Case], extractor: Extractor) -> Coverage:
    """The sum over cases; the last of their frames counts, as in the fidelity run. Those without a valid model are counted as
    such."""
    nothing = np.zeros(len(BINS_M) - 1, np.int64)
    total = Coverage(nothing, nothing, frames=0)
    for case in todo:
        frames = frames_of(case, FRAMES)
        model = model_of(frames, extractor)
        if model.valid:
            rays = true_rays(case, frames[-1], extractor.params.min_obstacle_height_m)
            total += coverage(frames[-1], rays, model)
        else:
            total += Coverage(nothing, nothing, invalid=1)
    return total


def main(argv: Sequence[str] | None = None) -> int:
    """Prints a row for each noise, level and kind."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--scenes", default=",".join(SCENES), help="names, separated by commas")
    parser.add_argument("--seeds", type=int, default=1, help="how many (1)")
    args = parser.parse_args(argv)
    extractor = Extractor(Params())
    scenes, seeds = args.scenes.split(","), TUNING_SEEDS[: args.seeds]
    names = "".join(f"{f'{a:g}-{b:g} m':>10}" for a, b in itertools.pairwise(BINS_M))
    print(
        f"{'noise':<12}{'ke':>8}{names}{'invalid':>10}  % of the true obstacle points covered; {len(scenes)} scenes, tilts {FEW_TILTS_DEG}"
    )
    for name, faults in NOISES.items():
        for ke in GOAL_KE:
            got = of_cases(spread(scenes, seeds, FEW_TILTS_DEG, kes=[ke], faults=[faults]), extractor)
            print(
                f"{name:<12}{ke:>8g}"
                + "".join(f"{100 * share:>10.2f}" for share in got.shares())
                + f"{got.invalid:>10}"
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

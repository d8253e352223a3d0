"""The sets of cases of the fidelity run, and their execution on all processors.

`base` is the set for which goals are stated; each other set varies one property in representative scenes."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmarks.fidelity.case import FAULTS, FRAMES, run_case
from benchmarks.fidelity.result import Case, Row
from benchmarks.scenes.catalogue import FAMILIES, SCENES, another_seed
from companion.bench.timing import ONE_THREAD
from core.extractor import Extractor
from core.params import Params

TILTS_DEG = ((0, 0), (10, 0), (-10, 0), (0, 10), (0, -10), (30, 0), (-30, 0), (0, 30), (0, -30))
"""Roll and pitch: level, and each alone."""
FEW_TILTS_DEG = ((0, 0), (30, 0), (0, -30))
HIGH_TILTS_DEG = ((0, 0), (0, -10), (0, -30))
GOAL_KE = (0.0015, 0.005)
"""Noise, sigma = ke Z^2, for which the goals are stated; the others are rows."""
MORE_KE = (0.008, 0.01)
HEIGHTS_M = (0.7, 1.2, 2.0, 4.0, 7.0, 10.0)
FEW_SCENES = (
    "street", "paper_window", "courtyard", "stairs", "overhang", "trees", "rubble", "tree_before_wall", "bushes",
    "pole_ranges", "wire_ranges", "open",
)  # fmt: skip
"""Representative scenes for sets that vary one property."""
HIGH_SCENES = (
    "towers",
    "roofs",
    "crossing",
    "street",
    "containers",
    "forest",
    "conifers",
    "boulders",
    "mixture",
    "open",
)
"""Scenes that show something from high above too."""

Tilts = Sequence[tuple[float, float]]
Seeds = Sequence[int]


def cases(
    scenes: Iterable[str],
    seeds: Seeds,
    tilts: Tilts = TILTS_DEG,
    kes: Iterable[float] = GOAL_KE,
    heights: Iterable[float] = (2.0,),
    faults: Iterable[str] = ("all",),
    configured: Callable[[float], Iterable[float]] = lambda ke: (ke,),
    width: int = 640,
) -> Iterator[Case]:
    """Every combination; cases with the same view are adjacent. configured: the noise configured in the extractor, by the
    true one."""
    kes, heights, faults = list(kes), list(heights), list(faults)
    for scene, seed, height, (roll, pitch) in itertools.product(scenes, seeds, heights, tilts):
        for ke, wrong in itertools.product(kes, faults):
            for tell in configured(ke):
                yield Case(
                    scene=scene,
                    roll_deg=roll,
                    pitch_deg=pitch,
                    ke_per_m=ke,
                    configured_ke_per_m=tell,
                    height_m=height,
                    seed=seed,
                    faults=wrong,
                    width=width,
                )


def spread(scenes: Iterable[str], seeds: Seeds, tilts: Tilts, **others: Any) -> Iterator[Case]:
    """As `cases`, with other seeds at each tilt, which varies the shapes of a scene."""
    names = list(scenes)
    for i, tilt in enumerate(tilts):
        yield from cases(names, [another_seed(s, i * len(seeds)) for s in seeds], [tilt], **others)


def _wrong_ke(ke: float) -> tuple[float, ...]:
    return ke / 3.0, ke, 3.0 * ke


@dataclass(frozen=True, slots=True)
class Part:
    """A set of cases by its seeds; grids: with the grid baseline, which costs most of the time."""

    title: str
    make: Callable[[Seeds], Iterator[Case]]
    grids: bool = False


PARTS: dict[str, Part] = {
    "base": Part("all scenes, tilts and both noises, all faults", lambda s: spread(SCENES, s, TILTS_DEG), grids=True),
    "noise": Part("more noise", lambda s: spread(SCENES, s, FEW_TILTS_DEG, kes=MORE_KE)),
    "faults": Part("each fault alone", lambda s: spread(FEW_SCENES, s, FEW_TILTS_DEG, faults=FAULTS)),
    "heights": Part("height above ground", lambda s: spread(HIGH_SCENES, s, HIGH_TILTS_DEG, heights=HEIGHTS_M)),
    "configured": Part("wrong configured noise", lambda s: spread(FEW_SCENES, s, FEW_TILTS_DEG, configured=_wrong_ke)),
}
"""Name -> cases."""
QUICK_SCENES = (
    "wall",
    "window",
    "street",
    "paper_corridor",
    "trees",
    "mixture",
    "bushes",
    "pole_ranges",
    "wires",
    "open",
)


def quick(seeds: Seeds) -> Iterator[Case]:
    """A rough look: ten scenes, three tilts, both noises."""
    return spread(QUICK_SCENES, seeds, FEW_TILTS_DEG)


def in_families(names: Iterable[str]) -> list[str]:
    """Scenes by names of scenes or families. Raises ValueError for one that does not exist."""
    found = [n for name in names for n in FAMILIES.get(name, (name,))]
    unknown = [n for n in found if n not in SCENES]
    if unknown:
        raise ValueError(f"no scene {unknown[0]!r}; there are {', '.join([*FAMILIES, *SCENES])}")
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How cases are run. frames: in a row, the last of which is scored."""

    params: Params = field(default_factory=Params)
    frames: int = FRAMES
    grids: bool = True
    jobs: int = 1


_worker: list[tuple[Extractor, Settings]] = []
"""Of a process of the pool: its extractor."""


def _start(settings: Settings) -> None:
    _worker[:] = [(Extractor(settings.params), settings)]


def _run_group(group: list[Case]) -> list[Row]:
    extractor, settings = _worker[0]
    rows = []
    for case in group:
        try:
            rows.append(run_case(case, extractor, settings.frames, settings.grids))
        finally:
            if len(rows) < 1 + group.index(case):
                print(f"\nfailed: {case.name}", file=sys.stderr)
    return rows


def run(todo: Sequence[Case], settings: Settings, label: str = "") -> list[Row]:
    """The rows of cases, in their order; progress goes to stderr. The same for any number of jobs."""
    keys = ("scene", "seed", "height_m", "roll_deg", "pitch_deg", "width")
    groups = [list(g) for _, g in itertools.groupby(todo, lambda c: [getattr(c, k) for k in keys])]
    rows: list[Row] = []
    begun = time.monotonic()

    def collect(results: Iterable[list[Row]]) -> None:
        for result in results:
            rows.extend(result)
            left_min = (time.monotonic() - begun) / len(rows) * (len(todo) - len(rows)) / 60.0
            text = f"{label} {len(rows)}/{len(todo)}, {left_min:.1f} min left, {result[-1].case.name}"
            print(f"\r{text:<100.100}", end="", file=sys.stderr, flush=True)

    if settings.jobs <= 1 or len(groups) < 2:
        _start(settings)
        collect(map(_run_group, groups))
    else:
        os.environ.update(ONE_THREAD)
        # a new interpreter each: threads of libraries do not survive a fork
        context = multiprocessing.get_context("spawn")
        with context.Pool(min(settings.jobs, len(groups)), _start, (settings,)) as pool:
            collect(pool.imap(_run_group, groups))
    print(file=sys.stderr)
    return rows

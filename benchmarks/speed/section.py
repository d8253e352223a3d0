"""How long a frame takes, stage by stage, for all kinds and sizes of images; `python -m benchmarks --only speed`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.scenes.catalogue import FAMILIES
from benchmarks.speed.cases import KE_PER_M, KINDS, SEED, SIZE, SIZES, TILT_DEG, crowd, kind_sequence, scene_sequence
from benchmarks.speed.plots import draw_curves, draw_kinds, draw_stages
from benchmarks.speed.reference import WORDS, Reference
from benchmarks.speed.tables import (
    GOALS,
    Timed,
    curve_table,
    floor_words,
    goals_table,
    kinds_table,
    scenes_table,
    stage_table,
)
from companion.bench.frames import Flight, FrameSequence, Measured, measure, render_sequence
from companion.bench.timing import one_core
from core.extractor import Extractor

WIDTHS = (160, 240, 320, 480, 640, 800, 960, 1280)
CROWDS = (0, 1, 2, 4, 8, 16, 32, 64)
SCENE_TILTS_DEG = (0.0, TILT_DEG)


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """Extent of the measurement. runs: per kind at 640x480 (half of it at other sizes); watched: measured by stage;
    budget_s: time limit per kind; scenes: largest number per family; too_slow_ms: a kind that takes longer is not
    measured at larger sizes."""

    runs: int
    watched: int
    images: int
    budget_s: float
    too_slow_ms: float
    scenes: int
    widths: tuple[int, ...]
    crowds: tuple[int, ...]


FULL = Effort(
    runs=300, watched=60, images=8, budget_s=60.0, too_slow_ms=10_000.0, scenes=1000, widths=WIDTHS, crowds=CROWDS
)
QUICK = Effort(
    runs=20, watched=5, images=2, budget_s=5.0, too_slow_ms=1000.0, scenes=2, widths=(320, 640), crowds=(0, 8, 32)
)


class Lap:
    """One run: the extractor, the reference workload between frames, and progress on stderr."""

    def __init__(self, effort: Effort) -> None:
        self.effort, self.reference = effort, Reference()
        self._extractor = Extractor()
        print("speed: compiling what is not compiled yet", file=sys.stderr, flush=True)
        for kind in KINDS[:2]:  # level and tilted
            Flight(self._extractor, kind_sequence(kind, (160, 120), KE_PER_M[0], 1)).frame()

    def time(self, what: str, make: Callable[[], FrameSequence], runs: int, watched: int = 0) -> Measured:
        """Times some footage."""
        print(f"speed: {what}", file=sys.stderr, flush=True)
        interleaved = (self.reference.run,)
        budget_s = self.effort.budget_s
        return measure(make(), self._extractor, runs, watched=watched, budget_s=budget_s, interleaved=interleaved)


def section(out: Path, quick: bool) -> str:
    """The Markdown of the page; its pictures go to `out`."""
    lap = Lap(QUICK if quick else FULL)
    with one_core():
        timed: dict[tuple[int, int], list[Timed]] = {}
        for size in SIZES:  # small ones first
            timed[size] = list(kinds_at(lap, size, [t for rows in timed.values() for t in rows]))
        sizes = _sizes(lap)
        crowds = _crowds(lap)
        families = _families(lap)
    reference_ms = lap.reference.times().cpu()
    main = timed[SIZE]
    parts = [
        t.measured for t in main if t.ke_per_m == KE_PER_M[0] and t.measured.valid and t.measured.times.cpu() < 1000.0
    ]
    draw_kinds(out / "speed_kinds.png", main)
    draw_stages(out / "speed_stages.png", parts)
    draw_curves(out / "speed_curves.png", sizes, crowds)
    runs = lap.effort.runs
    return "\n".join(
        [
            summary(main, families),
            "## Against the goals\n",
            "640x480 uint16 to planes, prisms and free ranges, one thread. "
            "The paper's own figure is 18.6 ms, in C++ on an i7-8700K, without free ranges.\n",
            goals_table(main, KINDS, lap.effort.too_slow_ms),
            "![Median and 99th percentile of every kind of frame](speed_kinds.png)\n",
            *(f"## All kinds, {w}x{h}\n\n{kinds_table(rows, reference_ms)}" for (w, h), rows in timed.items()),
            left_out(timed, lap.effort.too_slow_ms),
            f"Medians of {runs} frames (640x480; half of that at other sizes; fewer where {runs} would take more than "
            f"{lap.effort.budget_s:g} s) that differ in their noise, one after the other as in flight. Tilted is {TILT_DEG:g} degrees, "
            f"the scenes are those of the held-out seed {SEED}. *Blind*: the frame is invalid. "
            f"The reference workload ({WORDS}) took {reference_ms:.2f} ms of the processor, {lap.reference.times().wall():.2f} ms by the "
            "wall, and ran between all frames.\n",
            "## Where the time goes\n",
            stage_table(parts),
            "![The stages of each kind of frame](speed_stages.png)\n",
            floor_words(parts[:4]) + "\n",
            "## Over the size of the image, and over the number of strips\n",
            "![Time over pixels, and over strips](speed_curves.png)\n",
            _size_table(sizes),
            _crowd_table(crowds, lap.effort.crowds),
            "## Every scene\n",
            f"Medians of {max(3, runs // 10)} frames of each scene of the fidelity page, 640x480; tilted: rolled by {TILT_DEG:g} degrees.\n",
            scenes_table(families, [f"{'tilted' if tilt else 'level'}, ke {ke:g}" for tilt, ke in _scene_columns()]),
        ]
    )


def summary(timed: list[Timed], families: dict[str, list[list[Measured]]]) -> str:
    """A paragraph for the index."""
    said = []
    for ke in KE_PER_M:
        parts = []
        for goal in GOALS:
            worst = max(t.p50() for t in timed if t.ke_per_m == ke and goal.holds_for(t.kind))
            parts.append(f"{goal.name} {worst:.1f} ms (must: {goal.must_ms:g}, aim: {goal.aim_ms:g})")
        said.append(f"at ke {ke:g} {', '.join(parts)}")
    slowest = max((m for scenes in families.values() for scene in scenes for m in scene), key=lambda m: m.times.cpu())
    return (
        f"640x480 on one thread, medians of the processor's time: {'; '.join(said)}. "
        f"The slowest of all simulated scenes ({slowest.name}) takes {slowest.times.cpu():.1f} ms.\n"
    )


def kinds_at(lap: Lap, size: tuple[int, int], before: list[Timed]) -> Iterator[Timed]:
    """Every kind at a size. before: the same at the size before, the smaller one."""
    runs, watched = (lap.effort.runs, lap.effort.watched) if size == SIZE else (max(3, lap.effort.runs // 2), 0)
    slow = {t.kind for t in before if t.p50() > lap.effort.too_slow_ms}
    for ke in KE_PER_M:
        for kind in KINDS:
            if kind in slow:
                continue
            what = f"{kind.name}, {size[0]}x{size[1]}, ke {ke:g}"
            measured = lap.time(what, partial(kind_sequence, kind, size, ke, lap.effort.images), runs, watched)
            yield Timed(kind=kind, size=size, ke_per_m=ke, measured=measured)


def left_out(timed: dict[tuple[int, int], list[Timed]], too_slow_ms: float) -> str:
    """Kinds that took too long to be measured at every size."""
    named = {kind.name for kind in KINDS}
    said = []
    for (w, h), rows in timed.items():
        missing = sorted(named - {t.kind.name for t in rows})
        if missing:
            said.append(f"{w}x{h}: {', '.join(missing)}")
    if not said:
        return ""
    return (
        f"Not measured, since a smaller image took more than {too_slow_ms / 1000.0:g} s already: {'; '.join(said)}.\n"
    )


def _sizes(lap: Lap) -> dict[str, list[tuple[tuple[int, int], Measured]]]:
    """Street and trees, rolled, over the size of the image."""
    kinds = {kind.scene: kind for kind in KINDS if kind.spoil is None and kind.roll_deg}
    found: dict[str, list[tuple[tuple[int, int], Measured]]] = {}
    for name, kind in kinds.items():
        for width in lap.effort.widths:
            size = (width, width * 3 // 4)
            make = partial(kind_sequence, kind, size, KE_PER_M[0], lap.effort.images)
            measured = lap.time(f"{name}, {size[0]}x{size[1]}", make, max(3, lap.effort.runs // 5))
            found.setdefault(name, []).append((size, measured))
    return found


def _crowds(lap: Lap) -> dict[str, list[Measured]]:
    """More and more things in view."""
    found: dict[str, list[Measured]] = {}
    for name, foliage in (("boxes and poles", False), ("small trees", True)):
        for things in lap.effort.crowds:
            made = crowd(things, foliage)
            found.setdefault(name, []).append(
                lap.time(
                    f"{things} {name}",
                    partial(render_sequence, "crowd", made, SIZE, roll_deg=5.0, seed=SEED),
                    max(3, lap.effort.runs // 5),
                )
            )
    return found


def _scene_columns() -> list[tuple[float, float]]:
    """(roll in degrees, noise) of the table of all scenes."""
    return [(tilt, ke) for ke in KE_PER_M for tilt in SCENE_TILTS_DEG]


def _families(lap: Lap) -> dict[str, list[list[Measured]]]:
    """Every scene of every family, a row a scene."""
    found: dict[str, list[list[Measured]]] = {}
    for family, names in FAMILIES.items():
        for name in names[: lap.effort.scenes]:
            row = [
                lap.time(
                    f"{name}, rolled {tilt:g}, ke {ke:g}",
                    partial(scene_sequence, name, SIZE, ke, 2, tilt),
                    max(3, lap.effort.runs // 10),
                )
                for tilt, ke in _scene_columns()
            ]
            found.setdefault(family, []).append(row)
    return found


def _size_table(sizes: dict[str, list[tuple[tuple[int, int], Measured]]]) -> str:
    """Milliseconds and nanoseconds a pixel."""
    first = next(iter(sizes.values()))
    rows = [(f"{w}x{h}", [points[i][1] for points in sizes.values()]) for i, ((w, h), _) in enumerate(first)]
    return curve_table(["image", *(x for name in sizes for x in (f"{name}, ms", "ns a pixel"))], rows, pixels=True)


def _crowd_table(crowds: dict[str, list[Measured]], counts: tuple[int, ...]) -> str:
    """Strips and milliseconds."""
    rows = [(str(count), [measured[i] for measured in crowds.values()]) for i, count in enumerate(counts)]
    return curve_table(["things", *(x for name in crowds for x in (f"{name}: strips", "ms"))], rows, pixels=False)

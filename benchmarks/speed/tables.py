"""The tables of the speed page, as Markdown. Times are milliseconds of processor time unless stated otherwise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from benchmarks import markdown
from benchmarks.speed.cases import Kind
from companion.bench.frames import Measured
from companion.bench.stage_trace import in_order


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """What was measured of one kind of frame at one size and noise."""

    kind: Kind
    size: tuple[int, int]
    ke_per_m: float
    measured: Measured

    def p50(self) -> float:
        """Median, ms."""
        return self.measured.times.cpu()

    def p99(self) -> float:
        """99th percentile, ms."""
        return self.measured.times.cpu(99)

    def tail(self) -> float:
        """99th percentile over the median."""
        return self.p99() / self.p50()


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """What must be reached, what is aimed at, what would be splendid (ms; None: not named), for some kinds."""

    name: str
    holds_for: Callable[[Kind], bool]
    must_ms: float
    aim_ms: float
    stretch_ms: float | None = None

    def verdict(self, worst_ms: float) -> str:
        """The best of them that the slowest of the kinds reaches."""
        named = (("stretch", self.stretch_ms), ("aim", self.aim_ms), ("must", self.must_ms))
        return next((name for name, ms in named if ms is not None and worst_ms <= ms), "**missed**")


GOALS: Final = (
    Goal(
        name="structured, level",
        holds_for=lambda k: k.family == "structured" and k.level,
        must_ms=4.0,
        aim_ms=1.2,
        stretch_ms=0.8,
    ),
    Goal(
        name="structured, tilted 20 degrees",
        holds_for=lambda k: k.family == "structured" and not k.level,
        must_ms=4.0,
        aim_ms=1.6,
        stretch_ms=1.2,
    ),
    Goal(name="foliage, level and tilted", holds_for=lambda k: k.family == "foliage", must_ms=8.0, aim_ms=3.0),
)
TAIL_GOAL: Final = 2.0

FLOORS_MS: Final = (
    ("bins of the pixels", 0.02),
    ("transpose", 0.04),
    ("histograms", 0.125),
    ("kernel", 0.025),
    ("peaks", 0.03),
    ("windows", 0.024),
)
"""C++ with AVX-512, each stage alone: what our stage of density, windows and strips is compared with."""
FLOORED_STAGE: Final = "density, windows, strips, rest"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; all columns but the first are set to the right."""
    return markdown.table(head, rows) + "\n"


def goals_table(timed: Sequence[Timed], kinds: Sequence[Kind], too_slow_ms: float) -> str:
    """Each goal and the slowest kind that it applies to, one column per noise. kinds: all that should have been
    measured; a missing one took more than too_slow_ms at a smaller size."""
    noises = sorted({t.ke_per_m for t in timed})
    rows = []
    for goal in GOALS:
        cells = []
        for ke in noises:
            worst = max(t.p50() for t in timed if t.ke_per_m == ke and goal.holds_for(t.kind))
            cells += [f"{worst:.2f}", goal.verdict(worst)]
        stretch = f"{goal.stretch_ms:g}" if goal.stretch_ms is not None else ""
        rows.append([goal.name, f"{goal.must_ms:g}", f"{goal.aim_ms:g}", stretch, *cells])
    for blind in (False, True):
        those = [t for t in timed if t.measured.valid is not blind]
        if {t.ke_per_m for t in those} == set(noises):
            tails = [max(t.tail() for t in those if t.ke_per_m == ke) for ke in noises]
            name = f"p99 / median, worst kind {'that is blind' if blind else 'with a model'}"
            rows.append([name, f"{TAIL_GOAL:g}", "", "", *_reached(tails, [TAIL_GOAL] * len(noises))])
    foliage = [max(t.p50() for t in timed if t.ke_per_m == ke and t.kind.family == "foliage") for ke in noises]
    for t in (t for t in timed if t.kind.family == "broken" and t.ke_per_m == noises[0]):
        same = [next(x for x in timed if x.kind is t.kind and x.ke_per_m == ke).p50() for ke in noises]
        rows.append([f"{t.kind.name}: no slower than foliage", "", "", "", *_reached(same, foliage)])
    missing = [kind.name for kind in kinds if kind not in {t.kind for t in timed}]
    rows += [
        [f"{name}: no slower than foliage", "", "", "", *[f"over {too_slow_ms:g}", "**missed**"] * len(noises)]
        for name in missing
    ]
    head = ["ms, median of the slowest kind", "must", "aim", "stretch"]
    return table(head + [x for ke in noises for x in (f"ke {ke:g}", "reached")], rows)


def _reached(values: Sequence[float], limits: Sequence[float]) -> list[str]:
    pairs = zip(values, limits, strict=True)
    return [x for v, limit in pairs for x in (f"{v:.2f}", "must" if v <= limit else "**missed**")]


def kinds_table(timed: Sequence[Timed], reference_ms: float) -> str:
    """Every kind at one size and every noise: both clocks, the tail, the ratio to the reference workload."""
    rows = []
    for t in sorted(timed, key=lambda t: t.ke_per_m):
        m = t.measured
        figures = (t.p50(), t.p99(), t.tail(), m.times.wall(), m.times.wall(99))
        planes = str(m.planes) if m.valid else "blind"
        ratio = f"{t.p50() / reference_ms:.1f}"
        rows.append([t.kind.name, f"{t.ke_per_m:g}", *(f"{x:.2f}" for x in figures), ratio, planes, str(len(m.times))])
    head = [
        "frame",
        "ke",
        "median",
        "p99",
        "p99 / median",
        "wall: median",
        "wall: p99",
        "median / reference",
        "planes",
        "frames",
    ]
    return table(head, rows)


def stage_table(columns: Sequence[Measured]) -> str:
    """Medians of each stage, one column a kind of frame; both clocks for the whole call."""
    rows = []
    for stage in in_order(stage for m in columns for stage in m.stages_ms):
        rows.append([stage, *(f"{m.stages_ms.get(stage, 0.0):.2f}" for m in columns)])
    rows.append(["between the stages", *(f"{m.rest_ms():.2f}" for m in columns)])
    rows.append(["**whole call, median**", *(f"**{m.times.cpu():.2f}**" for m in columns)])
    rows.append(["whole call, 99th percentile", *(f"{m.times.cpu(99):.2f}" for m in columns)])
    rows.append(["whole call, median, by the wall", *(f"{m.times.wall():.2f}" for m in columns)])
    rows.append(["planes", *(str(m.planes) for m in columns)])
    rows.append(["strips", *(str(m.strips) for m in columns)])
    return table(["ms", *(m.name for m in columns)], rows)


def floor_words(columns: Sequence[Measured]) -> str:
    """Our stage of density, windows and strips compared with the sum of its floors."""
    floor = sum(ms for _, ms in FLOORS_MS)
    parts = ", ".join(f"{name} {ms:g}" for name, ms in FLOORS_MS)
    ours = [(m.name, m.stages_ms.get(FLOORED_STAGE, 0.0)) for m in columns]
    said = "; ".join(f"{name} {ms:.2f} ms, {ms / floor:.0f} times the floor" for name, ms in ours)
    return (
        f"Floors measured elsewhere for single stages, in C++ with AVX-512 and without anything around them: {parts}, "
        f"together {floor:.2f} ms. Ours, from bins to finished strips (floors of cutting the irregular rest are not known): {said}."
    )


def curve_table(head: Sequence[str], rows: Sequence[tuple[str, Sequence[Measured]]], pixels: bool) -> str:
    """Medians along a curve: one row a point, (time, planes or ns a pixel or strip) a series."""
    return table(head, [[name, *(cell for m in row for cell in _point(m, name, pixels))] for name, row in rows])


def _point(m: Measured, name: str, pixels: bool) -> tuple[str, str]:
    if not pixels:
        return f"{m.strips}", f"{m.times.cpu():.2f}"
    width, height = (int(side) for side in name.split("x"))
    return f"{m.times.cpu():.2f}", f"{1e6 * m.times.cpu() / (width * height):.0f}"


def scenes_table(families: dict[str, list[list[Measured]]], columns: Sequence[str]) -> str:
    """Of each family the median scene and the slowest, one column a tilt and noise. families: rows a scene."""
    rows = []
    for family, scenes in families.items():
        cells = []
        for i in range(len(columns)):
            ordered = sorted((scene[i] for scene in scenes), key=lambda m: m.times.cpu())
            middle, worst = ordered[len(ordered) // 2], ordered[-1]
            cells.append(f"{middle.times.cpu():.2f}, {worst.times.cpu():.2f} ({worst.name})")
        rows.append([f"{family} ({len(scenes)})", *cells])
    return table(["median scene, slowest scene", *columns], rows)

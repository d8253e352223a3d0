"""Golden figures of a few frames, to detect a change that worsens the model.

All figures are better when smaller. A figure may exceed its golden value by a margin, since another processor type
rounds differently. Improvements always pass; `pytest --update-golden tests/benchmarks/test_regression.py` then updates
the golden values."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fidelity.case import run_case
from benchmarks.fidelity.result import Case, Row
from core.extractor import Extractor

GOLDEN = Path(__file__).with_name("regression.json")
Figures = dict[str, float | None]
Golden = dict[str, Figures]

WIDTH = 320
CASES: tuple[Case, ...] = tuple(
    Case(scene=scene, roll_deg=roll, pitch_deg=pitch, ke_per_m=ke, configured_ke_per_m=ke, seed=seed, width=WIDTH)
    for scene, roll, pitch, ke, seed in (
        ("street", 30.0, 0.0, 0.0015, 1),
        ("paper_window", 0.0, 0.0, 0.005, 2),
        ("overhang", 0.0, -10.0, 0.0015, 3),
        ("trees", 0.0, -30.0, 0.005, 4),
        ("rubble", -30.0, 0.0, 0.0015, 5),
        ("pole_ranges", 0.0, 0.0, 0.005, 6),
        ("wire_ranges", 0.0, 10.0, 0.0015, 7),
        ("no_ground", 0.0, 0.0, 0.005, 8),
        ("open", 10.0, 0.0, 0.005, 9),
    )
)
"""Of tuning seeds; together they hold what the goals are stated for."""


def _lost(row: Row) -> float:
    """Share of the rays of thin objects that are not kept, equally weighted over objects."""
    if row.family != "thin" or not row.recall:
        return math.nan
    return 1.0 - sum(r.kept for r in row.recall) / len(row.recall)


def _narrowed(row: Row) -> float:
    """Metres that the openings lose in width and height together; one larger than it is loses nothing."""
    some = [o for o in row.openings if o.to_be_passed]
    lost = [max(0.0, o.true_width_m - o.width_m) + max(0.0, o.true_height_m - o.height_m) for o in some]
    return sum(lost) if lost else math.nan


@dataclass(frozen=True, slots=True)
class Figure:
    """value of a row; it may exceed the golden one by share of it and by some of its own unit."""

    value: Callable[[Row], float]
    share: float
    more: float

    def limit(self, old: float) -> float:
        """The most that it may be."""
        return old + self.share * old + self.more


FIGURES: dict[str, Figure] = {
    "invalid": Figure(lambda r: float(not r.valid), 0.0, 0.0),
    # blinder. The goal for missed rays is 0.0005 of all; one strip of 20 rows is 0.001 of a frame of this size
    "missed": Figure(lambda r: r.score.missed, 0.1, 0.001),
    "missed_margin": Figure(lambda r: r.score.missed_margin, 0.1, 0.001),
    "false_free": Figure(lambda r: r.false_free, 0.0, 0.0001),
    "mean_m": Figure(lambda r: r.score.mean_m, 0.1, 0.003),
    "p95_m": Figure(lambda r: r.score.p95_m, 0.15, 0.01),
    "lost": Figure(_lost, 0.1, 0.02),
    # louder. The goal for phantoms is 0.005
    "phantom": Figure(lambda r: r.score.phantom, 0.1, 0.001),
    "phantom_open": Figure(lambda r: r.score.phantom_open, 0.1, 0.0005),
    "open_stopped": Figure(lambda r: r.score.open_stopped, 0.1, 0.005),
    "narrowed_m": Figure(_narrowed, 0.1, 0.1),
    "planes": Figure(lambda r: float(r.score.planes), 0.15, 2.0),
    "bytes": Figure(lambda r: float(r.bytes), 0.15, 64.0),
}
OF_THE_MEAN = 1.0 / 3.0
"""The mean over the cases may exceed its golden value by this share of the margin only: what moves one frame by
chance does not move them all."""
RAYS = "obstacle_rays"
"""Of the truth, not of the model: that the scene has not become another one."""


def measured() -> Golden:
    """The figures of all cases; None where a case has no such figure."""
    extractor = Extractor()
    return {case.name: figures(run_case(case, extractor, grids=False)) for case in CASES}


def figures(row: Row) -> Figures:
    """The figures of a row to six digits."""
    values = {name: f.value(row) for name, f in FIGURES.items()} | {RAYS: float(row.score.obstacle_rays)}
    return {name: float(f"{v:.6g}") if math.isfinite(v) else None for name, v in values.items()}


def worse(golden: Mapping[str, Figures], now: Mapping[str, Figures]) -> Iterator[str]:
    """Each figure outside of its margin, as text."""
    if golden.keys() != now.keys():
        yield f"other cases than the golden ones: {', '.join(sorted(golden.keys() ^ now.keys()))}"
    for case in (c for c in golden if c in now):
        before, after = golden[case], now[case]
        if abs((after[RAYS] or 0.0) - (before[RAYS] or 0.0)) > 0.002 * (before[RAYS] or 0.0):
            yield f"{case}: another scene, {before[RAYS]} -> {after[RAYS]} obstacle rays"
        for name, figure in FIGURES.items():
            old, new = before.get(name), after[name]
            if old is None or new is None:
                if old is not new:
                    yield f"{case}: {name} {old} -> {new}"
            elif new > figure.limit(old):
                yield f"{case}: {name} {old:g} -> {new:g}, at most {figure.limit(old):.6g}"
    for name, figure in FIGURES.items():
        old, new = means(golden, now, name)
        limit = old + OF_THE_MEAN * (figure.limit(old) - old)
        if new > limit:
            yield f"mean {name}: {old:g} -> {new:g}, at most {limit:.6g}"


def means(golden: Mapping[str, Figures], now: Mapping[str, Figures], name: str) -> tuple[float, float]:
    """Means of a figure, before and after, over the cases that have it in both; 0 where none has."""
    pairs = [(golden[c].get(name), now[c][name]) for c in now if c in golden]
    known = [(old, new) for old, new in pairs if old is not None and new is not None]
    count = max(1, len(known))
    return sum(old for old, _ in known) / count, sum(new for _, new in known) / count


def changes(golden: Mapping[str, Figures], now: Mapping[str, Figures]) -> str:
    """What an update changes: the figures that moved, better or worse, and their means over all cases."""
    lines = [f"{case}: new" for case in now if case not in golden]
    lines += [f"{case}: gone" for case in golden if case not in now]
    for case in now:
        moved = [
            f"{name} {old} -> {new}"
            for name, new in now[case].items()
            if case in golden and (old := golden[case].get(name)) != new
        ]
        lines += [f"{case}: {', '.join(moved)}"] if moved else []
    for name in FIGURES:
        old_mean, new_mean = means(golden, now, name)
        if old_mean != new_mean:
            lines.append(
                f"mean {name}: {old_mean:.6g} -> {new_mean:.6g} ({'worse' if new_mean > old_mean else 'better'})"
            )
    return "\n".join(lines) if lines else "as before"


def load() -> Golden:
    """The golden figures."""
    golden: Golden = json.loads(GOLDEN.read_text())
    return golden


def dumps(result: Mapping[str, Figures]) -> str:
    """JSON with a case on each line."""
    lines = [f" {json.dumps(case)}: {json.dumps(values, allow_nan=False)}" for case, values in result.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"

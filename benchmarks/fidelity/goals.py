"""The figures that the goals are stated for, each taken from a row, and what many rows have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.fidelity.result import Row


def grid_figure(row: Row, cell_m: float, figure: str) -> float:
    """A figure of the grid baseline; nan where it was not run."""
    found = [g for g in row.grids if g.cell_m == cell_m]
    return float(getattr(found[0], figure)) if found else math.nan


def plane_ratio(row: Row) -> float:
    """Planes over those of the 0.8 m grid."""
    return _ratio(row.score.planes, grid_figure(row, 0.8, "planes"))


def byte_ratio(row: Row) -> float:
    """Bytes of the prisms over those of the 0.8 m grid."""
    return _ratio(row.bytes, grid_figure(row, 0.8, "bytes"))


def error_ratio(row: Row) -> float:
    """Mean error over that of the 0.1 m grid from the same noisy depth."""
    return _ratio(row.score.mean_m, grid_figure(row, 0.1, "mean_m"))


def exact_ratio(row: Row) -> float:
    """Mean error over that of the 0.1 m grid from depth without noise."""
    return _ratio(row.score.mean_m, grid_figure(row, 0.1, "perfect_mean_m"))


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else math.nan


@dataclass(frozen=True, slots=True)
class Measure:
    """A figure: its value in a row, the unit it is shown in and the factor to it, the rays that it is a share
    of (None: none), and the goal of each family ("": of all) in the unit."""

    name: str
    value: Callable[[Row], float]
    unit: str = ""
    scale: float = 1.0
    rays: Callable[[Row], int] | None = None
    goals: tuple[tuple[str, float], ...] = ()

    def goal(self, family: str) -> float:
        """The goal of a family; nan: none is stated."""
        goals = dict(self.goals)
        return goals.get(family, goals.get("", math.nan))


def _obstacle_rays(row: Row) -> int:
    return row.score.obstacle_rays


def _open_rays(row: Row) -> int:
    return row.score.open_rays


MEASURES = (
    Measure("mean error / grid 0.1 m", error_ratio, goals=(("structured", 0.2), ("unstructured", 1.0))),
    Measure("mean error / grid 0.1 m, exact depth", exact_ratio),
    Measure("mean error", lambda r: r.score.mean_m, "m", 1.0, _obstacle_rays),
    Measure("95 % of the errors", lambda r: r.score.p95_m, "m"),
    Measure("missed", lambda r: r.score.missed, "%", 100.0, _obstacle_rays, (("", 0.05),)),
    Measure("missed, margin subtracted", lambda r: r.score.missed_margin, "%", 100.0, _obstacle_rays),
    Measure("missed, of measured rays", lambda r: r.score.missed_measured, "%", 100.0),
    Measure("obstacle in space called free", lambda r: r.false_free, "%", 100.0, _obstacle_rays),
    Measure("phantom", lambda r: r.score.phantom, "%", 100.0, _obstacle_rays, (("", 0.5),)),
    Measure("phantom over ground and sky", lambda r: r.score.phantom_open, "%", 100.0, _open_rays, (("", 0.5),)),
    Measure("open rays stopped", lambda r: r.score.open_stopped, "%", 100.0, _open_rays),
    Measure("open rays stopped early", lambda r: r.score.open_stopped_early, "%", 100.0, _open_rays),
    Measure("planes / grid 0.8 m", plane_ratio, goals=(("structured", 0.5), ("unstructured", 0.5))),
    Measure("bytes / grid 0.8 m", byte_ratio, goals=(("structured", 0.5), ("unstructured", 0.5))),
    Measure("planes", lambda r: float(r.score.planes)),
)


def measure(name: str) -> Measure:
    """A measure by its name."""
    return next(m for m in MEASURES if m.name == name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """A measure over rows, in its unit: worst, the row it is in, median, and of shares the figure over the
    rays of all rows together (nan: no such figure); over: in how many of `count` rows the goal is missed."""

    worst: float
    where: Row
    median: float
    pooled: float
    count: int
    over: int


def summary(m: Measure, rows: Iterable[Row], goal: float = math.nan) -> Summary | None:
    """The measure over the valid rows; None where none has it. Invalid frames are counted separately."""
    known = [(m.scale * m.value(r), r) for r in rows if r.valid and not math.isnan(m.value(r))]
    if not known:
        return None
    worst, where = max(known, key=lambda pair: pair[0])
    pooled = math.nan
    if m.rays is not None:
        weights = [m.rays(r) for _, r in known]
        pooled = sum(v * w for (v, _), w in zip(known, weights, strict=True)) / max(1, sum(weights))
    over = sum(v > goal for v, _ in known)
    return Summary(
        worst=worst, where=where, median=median(v for v, _ in known), pooled=pooled, count=len(known), over=over
    )


SAFE_MISSED, SAFE_PHANTOM = 0.0005, 0.005


def safe_range_m(rows: Sequence[Row]) -> int:
    """The greatest range, m, within which missed and phantom together over all rows stay within their goals,
    for it and for every shorter one; bins without rays end it."""
    obstacle = missed = phantom = 0
    safe = 0
    for i in range(len(rows[0].by_range.obstacle) - 1 if rows else 0):
        here = sum(r.by_range.obstacle[i] for r in rows)
        obstacle += here
        missed += sum(r.by_range.missed[i] for r in rows)
        phantom += sum(r.by_range.phantom[i] for r in rows)
        if missed > SAFE_MISSED * obstacle or phantom > SAFE_PHANTOM * obstacle or (obstacle and not here):
            break
        safe = i + 1
    return safe

"""The fidelity table as text: a line a case, openings, thin things, and the worst of each family."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from benchmarks.rows import Row

_HEAD = (
    f"{'scene':<14}{'roll/pitch':>10}{'h m':>5}{'ke (told)':>16}{'mean':>7}{'p95':>6}"
    f"{'miss%':>7}{'-marg%':>7}{'seen%':>7}{'phan%':>7}{'op.ph%':>7}{'op.st%':>7}"
    f"{'planes':>7}{'bytes':>7}{'3DP.8 n':>8}{'n/3DP':>7}{'B/3DP':>7}{'3DP.1 m':>8}{'exact':>7}{'ground':>8}{'ke est':>8}"
)


def print_report(rows: list[Row]) -> None:
    """Prints all rows and their summary."""
    print(_HEAD)
    for row in rows:
        print(_line(row))
    _print_openings(rows)
    _print_recall(rows)
    _print_worst(rows)


def _grid(row: Row, cell_m: float, figure: str) -> float:
    found = [g for g in row.grids if g.cell_m == cell_m]
    return float(getattr(found[0], figure)) if found else math.nan


def plane_ratio(row: Row) -> float:
    """Planes over those of the 0.8 m grid."""
    return _ratio(row.score.planes, _grid(row, 0.8, "planes"))


def byte_ratio(row: Row) -> float:
    """Bytes of the prisms over those of the 0.8 m grid."""
    return _ratio(row.bytes, _grid(row, 0.8, "bytes"))


def error_ratio(row: Row) -> float:
    """Mean error over that of the 0.1 m grid from the same noisy depth."""
    return _ratio(row.score.mean_m, _grid(row, 0.1, "mean_m"))


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else math.nan


def _line(row: Row) -> str:
    c, s = row.case, row.score
    shares = (s.missed, s.missed_margin, s.missed_measured, s.phantom, s.phantom_open, s.open_stopped)
    return (
        f"{c.scene[:13]:<14}{f'{c.roll_deg:+.0f}/{c.pitch_deg:+.0f}':>10}{c.height_m:>5.1f}"
        f"{f'{c.ke_per_m:g} ({c.told_per_m:g})':>16}{s.mean_m:>7.3f}{s.p95_m:>6.2f}"
        + "".join(f"{100 * share:>7.2f}" for share in shares)
        + f"{s.planes:>7}{row.bytes:>7}{_grid(row, 0.8, 'planes'):>8.0f}{plane_ratio(row):>7.2f}{byte_ratio(row):>7.2f}"
        f"{_grid(row, 0.1, 'mean_m'):>8.3f}{_grid(row, 0.1, 'perfect_mean_m'):>7.3f}"
        f"{row.ground_height_m:>8.2f}{row.ke_estimate_per_m:>8.4f}" + ("" if row.valid else "  INVALID")
    )


def _case_name(row: Row) -> str:
    c = row.case
    return f"{c.scene} {c.roll_deg:+.0f}/{c.pitch_deg:+.0f} h {c.height_m:g} ke {c.ke_per_m:g} seed {c.seed}"


def _print_openings(rows: list[Row]) -> None:
    if any(row.openings for row in rows):
        print("\nopenings: true size -> largest free rectangle, free share of the true opening")
    for row in rows:
        for o in row.openings:
            print(
                f"  {_case_name(row):<42}{o.true_width_m:.2f} x {o.true_height_m:.2f} -> "
                f"{o.width_m:.2f} x {o.height_m:.2f} m, {100 * o.free_share:.0f} %"
            )


def _print_recall(rows: list[Row]) -> None:
    thin = [row for row in rows if row.family == "thin"]
    if thin:
        print("\nthin things: share of their rays kept")
    for row in thin:
        kept = ", ".join(f"{r.distance_m:.1f} m ({r.width_px:.1f} px) {100 * r.kept:.0f} %" for r in row.recall)
        print(f"  {_case_name(row):<42}{kept}")
    for scene, ke in sorted({(row.case.scene, row.case.ke_per_m) for row in thin}):
        mine = [row for row in thin if (row.case.scene, row.case.ke_per_m) == (scene, ke)]
        names = sorted({r.name for row in mine for r in row.recall}, key=lambda name: _nearest(mine, name))
        means = [f"{name} {100 * _mean_kept(mine, name):.0f} %" for name in names]
        print(f"  ke {ke:g}, {scene}, mean of {len(mine)} cases: " + ", ".join(means))


def _nearest(rows: list[Row], name: str) -> float:
    return min(r.distance_m for row in rows for r in row.recall if r.name == name)


def _mean_kept(rows: list[Row], name: str) -> float:
    kept = [r.kept for row in rows for r in row.recall if r.name == name]
    return sum(kept) / len(kept)


@dataclass(frozen=True, slots=True)
class _Measure:
    """A figure of the summary: its value, what it is shown in, and the rays that it is a share of (None: none)."""

    name: str
    value: Callable[[Row], float]
    scale: float = 1.0
    unit: str = ""
    rays: Callable[[Row], int] | None = None


def _obstacle_rays(row: Row) -> int:
    return row.score.obstacle_rays


def _open_rays(row: Row) -> int:
    return row.score.open_rays


_MEASURES = (
    _Measure("mean error / 3DP 0.1 m", error_ratio),
    _Measure("mean error", lambda r: r.score.mean_m, 1.0, "m", _obstacle_rays),
    _Measure("missed", lambda r: r.score.missed, 100.0, "%", _obstacle_rays),
    _Measure("missed, margin subtracted", lambda r: r.score.missed_margin, 100.0, "%", _obstacle_rays),
    _Measure("phantom", lambda r: r.score.phantom, 100.0, "%", _obstacle_rays),
    _Measure("phantom over ground and sky", lambda r: r.score.phantom_open, 100.0, "%", _open_rays),
    _Measure("open rays stopped", lambda r: r.score.open_stopped, 100.0, "%", _open_rays),
    _Measure("planes / 3DP 0.8 m", plane_ratio),
    _Measure("bytes / 3DP 0.8 m", byte_ratio),
)


def _summary(measure: _Measure, rows: list[Row]) -> str:
    """Worst, median and, of shares, the figure over the rays of all cases together."""
    known = sorted(((measure.value(r), i) for i, r in enumerate(rows) if not math.isnan(measure.value(r))))
    if not known:
        return f"  {measure.name:<30}{'-':>9}"
    worst, where = known[-1]
    middle = measure.scale * median(value for value, _ in known)
    text = f"  {measure.name:<30}{measure.scale * worst:>9.3f} {measure.unit:<2} (median {middle:.3f}"
    if measure.rays is None:
        return f"{text})  {_case_name(rows[where])}"
    weights = [measure.rays(rows[i]) for _, i in known]
    pooled = sum(v * w for (v, _), w in zip(known, weights, strict=True)) / max(1, sum(weights))
    rays = measure.rays(rows[where])
    return f"{text}, all rays {measure.scale * pooled:.3f})  {_case_name(rows[where])}, {rays} rays"


def _print_worst(rows: list[Row]) -> None:
    for ke in sorted({row.case.ke_per_m for row in rows}):
        for family in sorted({row.family for row in rows}):
            mine = [row for row in rows if row.family == family and row.case.ke_per_m == ke]
            if not mine:
                continue
            # an invalid frame says nothing: it lets nothing pass, and is counted instead of scored
            silent = [_case_name(row) for row in mine if not row.valid]
            print(f"\nworst of {family}, ke {ke:g} ({len(mine) - len(silent)} cases)")
            if silent:
                print(f"  {len(silent)} more gave no valid model: {'; '.join(silent)}")
            for measure in _MEASURES:
                print(_summary(measure, [row for row in mine if row.valid]))

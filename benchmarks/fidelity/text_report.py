"""The fidelity table as text: a line per case, openings, thin objects, and the worst of each family."""

from __future__ import annotations

import math

from benchmarks.fidelity.goals import MEASURES, Measure, byte_ratio, error_ratio, plane_ratio, summary
from benchmarks.fidelity.result import Row

_HEAD = (
    f"{'scene':<16}{'roll/pitch':>10}{'h m':>5}{'ke (configured)':>16}{'faults':>8}{'mean':>7}{'p95':>6}"
    f"{'miss%':>7}{'-marg%':>7}{'seen%':>7}{'!free%':>7}{'phan%':>7}{'op.ph%':>7}{'op.st%':>7}{'early%':>7}"
    f"{'planes':>7}{'bytes':>7}{'n/grid':>7}{'B/grid':>7}{'err/grid':>9}{'ground':>8}{'ke est':>8}"
)


def print_report(rows: list[Row]) -> None:
    """Prints all rows and their summary."""
    print(_HEAD)
    for row in rows:
        print(_line(row))
    _print_openings(rows)
    _print_recall(rows)
    _print_worst(rows)


def _line(row: Row) -> str:
    c, s = row.case, row.score
    shares = (
        s.missed,
        s.missed_margin,
        s.missed_measured,
        row.false_free,
        s.phantom,
        s.phantom_open,
        s.open_stopped,
        s.open_stopped_early,
    )
    return (
        f"{c.scene[:15]:<16}{f'{c.roll_deg:+.0f}/{c.pitch_deg:+.0f}':>10}{c.height_m:>5.1f}"
        f"{f'{c.ke_per_m:g} ({c.configured_ke_per_m:.2g})':>16}{c.faults[:7]:>8}{s.mean_m:>7.3f}{s.p95_m:>6.2f}"
        + "".join(f"{100 * share:>7.2f}" for share in shares)
        + f"{s.planes:>7}{row.bytes:>7}{plane_ratio(row):>7.2f}{byte_ratio(row):>7.2f}{error_ratio(row):>9.2f}"
        f"{row.ground_height_m:>8.2f}{row.ke_estimate_per_m:>8.4f}" + ("" if row.valid else "  INVALID")
    )


def _print_openings(rows: list[Row]) -> None:
    if any(row.openings for row in rows):
        print("\nopenings: true size -> largest free rectangle, free share of the true opening")
    for row in rows:
        for o in row.openings:
            said = "passable" if o.passable else "closed"
            wrong = "  WRONG" if o.passable != o.to_be_passed else "  too large" if o.too_large else ""
            print(
                f"  {row.case.name:<46}{o.distance_m:>5.1f} m {o.angle_deg:>3.0f} deg  {o.true_width_m:.2f} x "
                f"{o.true_height_m:.2f} -> {o.width_m:.2f} x {o.height_m:.2f} m, {100 * o.free_share:.0f} %, {said}{wrong}"
            )


def _print_recall(rows: list[Row]) -> None:
    thin = [row for row in rows if row.family == "thin"]
    if thin:
        print("\nthin things: share of their rays kept")
    for row in thin:
        kept = ", ".join(f"{r.distance_m:.1f} m ({r.width_px:.1f} px) {100 * r.kept:.0f} %" for r in row.recall)
        print(f"  {row.case.name:<42}{kept}")


def _summary(measure: Measure, rows: list[Row], family: str) -> str:
    """Worst, median and, of shares, the figure over the rays of all cases together."""
    goal = measure.goal(family)
    s = summary(measure, rows, goal)
    if s is None:
        return f"  {measure.name:<38}{'-':>9}"
    text = f"  {measure.name:<38}{s.worst:>9.3f} {measure.unit:<2} (median {s.median:.3f}"
    if not math.isnan(s.pooled):
        text += f", all rays {s.pooled:.3f}"
    if not math.isnan(goal):
        text += f"; {s.over} of {s.count} over {goal:g}"
    rays = f", {measure.rays(s.where)} rays" if measure.rays else ""
    return f"{text})  {s.where.case.name}{rays}"


def _print_worst(rows: list[Row]) -> None:
    for ke in sorted({row.case.ke_per_m for row in rows}):
        for family in sorted({row.family for row in rows}):
            mine = [row for row in rows if row.family == family and row.case.ke_per_m == ke]
            if not mine:
                continue
            # an invalid frame is counted separately and not scored
            silent = [row.case.name for row in mine if not row.valid]
            print(f"\nworst of {family}, ke {ke:g} ({len(mine) - len(silent)} cases)")
            if silent:
                print(f"  {len(silent)} more gave no valid model: {'; '.join(silent)}")
            for measure in MEASURES:
                print(_summary(measure, mine, family))

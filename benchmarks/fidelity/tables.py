"""The fidelity figures as Markdown tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from benchmarks.fidelity.goals import MEASURES, Measure, measure, safe_range_m, summary
from benchmarks.fidelity.openings import OpeningSize
from benchmarks.fidelity.result import Row
from benchmarks.markdown import table
from benchmarks.scenes.catalogue import FAMILIES

SHORT = (
    measure("mean error"),
    measure("missed"),
    measure("obstacle in space called free"),
    measure("phantom"),
    measure("phantom over ground and sky"),
    measure("open rays stopped"),
    measure("planes"),
)
"""What is shown where something is varied."""
RANGES_M = (4, 6, 8, 10, 12, 16)


def number(value: float) -> str:
    """Three digits, plain."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf"
    return (
        f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}" if abs(value) >= 0.001 or value == 0 else f"{value:.4f}"
    )


def cell(m: Measure, rows: Sequence[Row], family: str = "", middle: str = "median") -> str:
    """'worst (median)' of a measure, or 'worst (all rays)' with middle = "pooled"; bold where the worst misses the
    goal."""
    goal = m.goal(family)
    s = summary(m, rows, goal)
    if s is None:
        return "-"
    inner = s.pooled if middle == "pooled" and not math.isnan(s.pooled) else s.median
    text = f"{number(s.worst)} ({number(inner)})"
    return f"**{text}**" if s.over else text


def _of(rows: Iterable[Row], family: str) -> list[Row]:
    return [r for r in rows if r.family == family]


def _name(m: Measure) -> str:
    return f"{m.name}, {m.unit}" if m.unit else m.name


def _goal(m: Measure, family: str = "") -> str:
    stated = m.goal(family)
    return "" if math.isnan(stated) else number(stated)


def goals_table(rows: Sequence[Row]) -> str:
    """Each measure for each family: worst case (median case)."""
    lines = []
    for m in MEASURES:
        goals = sorted({_goal(m, family) for family in FAMILIES} - {""}, key=float)
        lines.append([_name(m), ", ".join(goals), *(cell(m, _of(rows, family), family) for family in FAMILIES)])
    silent = [str(sum(not r.valid for r in _of(rows, family))) for family in FAMILIES]
    counts = [str(len(_of(rows, family))) for family in FAMILIES]
    lines += [["cases", "", *counts], ["of these without a valid model (not scored)", "", *silent]]
    return table(["worst (median) case", "goal", *FAMILIES], lines)


def worst_table(rows: Sequence[Row]) -> str:
    """Of each measure with a goal and each family and noise that has cases over it: the worst one by name."""
    lines = []
    for m in MEASURES:
        for family in FAMILIES:
            for ke in sorted({r.case.ke_per_m for r in rows}):
                s = summary(m, [r for r in _of(rows, family) if r.case.ke_per_m == ke], m.goal(family))
                if s is None or not s.over:
                    continue
                rays = "" if m.rays is None else f", {m.rays(s.where)} rays"
                over = f"{s.over} of {s.count}"
                lines.append(
                    [
                        _name(m),
                        family,
                        f"{ke:g}",
                        number(s.worst),
                        number(s.pooled),
                        over,
                        f"`{s.where.case.name}`{rays}",
                    ]
                )
    return table(["figure", "family", "ke", "worst", "all rays", "cases over the goal", "the worst case"], lines)


def varied(rows: Sequence[Row], key: Callable[[Row], Any], head: str, say: Callable[[Any], str] = str) -> str:
    """Short figures for a varied property: worst case (all rays, or median)."""
    lines = []
    for family in FAMILIES:
        mine = _of(rows, family)
        for value in dict.fromkeys(key(r) for r in mine):
            some = [r for r in mine if key(r) == value]
            lines.append([family, say(value), str(len(some)), *(cell(m, some, family, "pooled") for m in SHORT)])
    return table(["family", head, "cases", *(_name(m) for m in SHORT)], lines)


def range_table(rows: Sequence[Row]) -> str:
    """Missed and phantom rays up to each range, and the range up to which both goals hold."""
    lines = []
    for family in ("structured", "unstructured", "thin"):
        for ke in sorted({r.case.ke_per_m for r in rows}):
            some = [r for r in _of(rows, family) if r.case.ke_per_m == ke and r.valid]
            if some:
                shares = [_up_to(some, limit) for limit in RANGES_M]
                lines.append([family, f"{ke:g}", *shares, f"{safe_range_m(some)} m"])
    return table(["missed / phantom, %", "ke", *(f"to {m} m" for m in RANGES_M), "both goals hold to"], lines)


def _up_to(rows: Sequence[Row], limit_m: int) -> str:
    obstacle = sum(sum(r.by_range.obstacle[:limit_m]) for r in rows)
    if not obstacle:
        return "-"
    missed = sum(sum(r.by_range.missed[:limit_m]) for r in rows)
    phantom = sum(sum(r.by_range.phantom[:limit_m]) for r in rows)
    return f"{100 * missed / obstacle:.3f} / {100 * phantom / obstacle:.2f}"


def no_ground_table(rows: Sequence[Row]) -> str:
    """The rows in which no ground was found, by whether there is one."""
    lines = []
    for ke in sorted({r.case.ke_per_m for r in rows}):
        mine = [r for r in rows if not r.ground_seen and r.valid and r.case.ke_per_m == ke]
        lines.append([f"{ke:g}", str(len(mine)), *(cell(m, mine, "", "pooled") for m in SHORT)])
    return table(["no ground found, ke", "cases", *(_name(m) for m in SHORT)], lines)


def _openings(rows: Iterable[Row], wanted: Callable[[OpeningSize], bool]) -> list[tuple[Row, OpeningSize]]:
    """Those seen not too slantwise: from more than 45 degrees aside an opening is narrower than it is."""
    return [(r, o) for r in rows if r.valid for o in r.openings if o.angle_deg <= 45.0 and wanted(o)]


def openings_table(rows: Sequence[Row]) -> str:
    """The paper's openings one by one in their smallest and median size, then all that are to be passed or filled."""
    lines = []
    for ke in sorted({r.case.ke_per_m for r in rows}):
        mine = [r for r in rows if r.case.ke_per_m == ke]
        for width, height in ((2.9, 2.1), (5.8, 2.2)):
            lines.append(_size_line(mine, width, height, ke))
        to_pass, to_fill = _openings(mine, lambda o: o.to_be_passed), _openings(mine, lambda o: not o.to_be_passed)
        open_ones, large = sum(o.passable for _, o in to_pass), sum(o.too_large for _, o in to_pass)
        kept = sum(o.kept for _, o in to_pass)
        lines.append(
            [f"all of 2 x 1 m or more, ke {ke:g}", str(len(to_pass)), "", "", "", f"{kept}", f"{open_ones}", f"{large}"]
        )
        filled = sum(o.free_share == 0.0 for _, o in to_fill)
        open_ones = sum(o.passable for _, o in to_fill)
        lines.append(
            [f"smaller ones, ke {ke:g}: filled {filled}", str(len(to_fill)), "", "", "", "", f"{open_ones}", ""]
        )
    head = ["opening", "seen", "median", "narrowest", "lowest", "kept", "passable", "too large"]
    return table(head, lines)


def _size_line(rows: Sequence[Row], width: float, height: float, ke: float) -> list[str]:
    seen = [o for _, o in _openings(rows, lambda o: abs(o.true_width_m - width) + abs(o.true_height_m - height) < 0.01)]
    name = f"{width} x {height} m, ke {ke:g}"
    if not seen:
        return [name, "0", *["-"] * 6]
    widths, heights = sorted(o.width_m for o in seen), sorted(o.height_m for o in seen)
    middle = f"{widths[len(seen) // 2]:.2f} x {heights[len(seen) // 2]:.2f} m"
    counts = [sum(o.kept for o in seen), sum(o.passable for o in seen), sum(o.too_large for o in seen)]
    return [name, str(len(seen)), middle, f"{widths[0]:.2f} m", f"{heights[0]:.2f} m", *(str(n) for n in counts)]


def seeds_table(tuning: Sequence[Row], held_out: Sequence[Row]) -> str:
    """Both halves of the seeds side by side, over the same scenes, tilts and noises."""
    lines = []
    for m in MEASURES:
        for family in ("structured", "unstructured"):
            pair = [cell(m, _of(rows, family), family, "pooled") for rows in (tuning, held_out)]
            lines.append([_name(m), family, *pair])
    return table(["worst (all rays, or median) case", "family", "tuning seeds", "held-out seeds"], lines)

"""The side-by-side figures over many cases, as tables and sentences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.markdown import table
from benchmarks.peers.methods import NOT_SIMPLIFIED, UNSORTED
from benchmarks.peers.participants import PAPER, ROUGH, SAFE
from benchmarks.peers.run import CLOUD, Figures, Timing

FINE_GRID, ROUGH_GRID = "3DP grid 0.1 m", f"3DP grid {ROUGH:g} m"
GOALS = {"structured": 0.2, "unstructured": 1.0}
"""Mean error over that of the fine grid; planes and bytes over those of the rough one: STORAGE_GOAL."""
STORAGE_GOAL = 0.5
SHOWN = (
    SAFE,
    PAPER,
    FINE_GRID,
    ROUGH_GRID,
    "OctoMap 0.1 m",
    "OctoMap 0.2 m",
    "Open3D planar patches",
    "Open3D VoxelGrid 0.1 m",
    CLOUD,
)
"""The methods in the page's tables of figures and times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pooled:
    """A method over the cases of one family and noise. Medians over the cases, worst cases, and shares of all rays
    together, each share also in its worst case. silent: cases without a valid model, which are not scored."""

    peer: str
    unit: str
    cases: int
    silent: int
    primitives: float
    bytes: float
    mean_m: float
    worst_mean_m: float
    p95_m: float
    body_mean_m: float
    missed: tuple[float, float]
    phantom: tuple[float, float]
    phantom_open: tuple[float, float]
    open_stopped: tuple[float, float]


def pooled(rows: Sequence[Figures]) -> Pooled | None:
    """Of the rows of one method; None without a valid model."""
    heard = [r for r in rows if r.valid]
    if not heard:
        return None
    means = [r.mean_m for r in heard if not math.isnan(r.mean_m)]
    return Pooled(
        peer=rows[0].peer,
        unit=rows[0].unit,
        cases=len(rows),
        silent=len(rows) - len(heard),
        primitives=median(r.primitives for r in heard),
        bytes=median(r.bytes for r in heard),
        mean_m=median(means),
        worst_mean_m=max(means),
        p95_m=median(r.p95_m for r in heard if not math.isnan(r.p95_m)),
        body_mean_m=median(r.body_mean_m for r in heard if not math.isnan(r.body_mean_m)),
        missed=_share(heard, lambda r: (r.missed, r.obstacle_rays)),
        phantom=_share(heard, lambda r: (r.phantom, r.obstacle_rays)),
        phantom_open=_share(heard, lambda r: (r.phantom_open, r.open_rays)),
        open_stopped=_share(heard, lambda r: (r.open_stopped, r.open_rays)),
    )


def _share(rows: Sequence[Figures], part: Callable[[Figures], tuple[int, int]]) -> tuple[float, float]:
    """(over all rays, in the worst case)."""
    parts = [part(r) for r in rows if part(r)[1]]
    if not parts:
        return math.nan, math.nan
    return sum(p for p, _ in parts) / sum(w for _, w in parts), max(p / w for p, w in parts)


def groups(rows: Iterable[Figures]) -> dict[tuple[str, float], dict[str, list[Figures]]]:
    """Rows by (family, noise) and peer, in the order in which they first come."""
    out: dict[tuple[str, float], dict[str, list[Figures]]] = {}
    for r in rows:
        out.setdefault((r.family, r.case.ke_per_m), {}).setdefault(r.peer, []).append(r)
    return out


def number(value: float, digits: int) -> str:
    """A figure; "none" where there is no model to measure to."""
    return "-" if math.isnan(value) else "none" if math.isinf(value) else f"{value:,.{digits}f}"


def percent(share: tuple[float, float]) -> str:
    """Over all rays (in the worst case), in per cent."""
    return f"{number(100.0 * share[0], 2)} ({number(100.0 * share[1], 1)})"


FIGURES_HEAD = (
    "",
    "made of",
    "bytes",
    "distance, m",
    "95 %, m",
    "to the body, m",
    "missed, %",
    "phantom, %",
    "over the open, %",
    "open rays stopped, %",
)


def figures_table(peers: dict[str, list[Figures]], absent: Sequence[tuple[str, str]]) -> str:
    """All peers on one family in one noise."""
    lines = []
    for rows in peers.values():
        p = pooled(rows)
        if p is None:
            lines.append([rows[0].peer, "said nothing", *["-"] * 8])
            continue
        lines.append(
            [
                p.peer + (f" (silent in {p.silent} of {p.cases})" if p.silent else ""),
                f"{number(p.primitives, 0)} {p.unit}",
                number(p.bytes, 0),
                f"{number(p.mean_m, 3)} ({number(p.worst_mean_m, 2)})",
                number(p.p95_m, 2),
                number(p.body_mean_m, 3),
                *(percent(s) for s in (p.missed, p.phantom, p.phantom_open, p.open_stopped)),
            ]
        )
    lines.extend([[name, "not run", *["-"] * 8] for name, _ in absent])
    return table(FIGURES_HEAD, lines)


def ratios(
    peers: dict[str, list[Figures]], other: str, figure: Callable[[Figures], float], theirs: Callable[[Figures], float]
) -> list[float]:
    """The ratio of ours to another method, by case; cases without a valid model of ours, or with 0 for the other, are
    left out."""
    ours, others = peers.get(SAFE, []), peers.get(other, [])
    pairs = [(figure(a), theirs(b)) for a, b in zip(ours, others, strict=True) if a.valid] if others else []
    return [a / b for a, b in pairs if b > 0.0 and not math.isnan(a)]


def _ratio(values: list[float], goal: float) -> str:
    """Median (worst case; in how many the goal is missed)."""
    if not values:
        return "-"
    over = sum(v > goal for v in values)
    word = f", {over} of {len(values)} over {goal:g}" if not math.isinf(goal) else ""
    return f"{median(values):.2f} ({max(values):.2f}{word})"


def storage_table(rows: Iterable[Figures]) -> str:
    """Our planes, bytes and error over the grid's, family by family."""
    lines = []
    raw, unsorted = ROUGH_GRID + NOT_SIMPLIFIED, ROUGH_GRID + UNSORTED
    for (family, ke), peers in groups(rows).items():
        lines.append(
            [
                f"{family}, ke {ke:g}",
                _ratio(ratios(peers, ROUGH_GRID, lambda r: r.primitives, lambda r: r.primitives), STORAGE_GOAL),
                _ratio(ratios(peers, ROUGH_GRID, lambda r: r.bytes, lambda r: r.bytes), STORAGE_GOAL),
                _ratio(ratios(peers, ROUGH_GRID, lambda r: r.primitives, lambda r: r.facing), math.inf),
                _ratio(ratios(peers, raw, lambda r: r.primitives, lambda r: r.primitives), math.inf),
                _ratio(ratios(peers, unsorted, lambda r: r.primitives, lambda r: r.primitives), math.inf),
                _ratio(ratios(peers, FINE_GRID, lambda r: r.mean_m, lambda r: r.mean_m), GOALS.get(family, math.inf)),
            ]
        )
    head = [
        "",
        "planes / grid 0.8 m",
        "bytes / grid 0.8 m",
        "planes / its front sides",
        "planes / not simplified",
        "planes / of all pixels",
        "error / grid 0.1 m",
    ]
    return table(head, lines)


def times_table(timings: Sequence[Timing], absent: Sequence[tuple[str, str]]) -> str:
    """Medians of the processor's time, the 99th percentile, how many times ours that is without and with the cloud."""
    kinds = list(dict.fromkeys(t.kind for t in timings))
    found = {(t.kind, t.peer): t.times for t in timings}
    lines = []
    for name in dict.fromkeys(t.peer for t in timings):
        line = [name]
        for kind in kinds:
            t, ours, cloud = found[kind, name], found[kind, SAFE].cpu(), found[kind, CLOUD].cpu()
            whole = t.cpu() if name in (SAFE, PAPER, CLOUD) or name.endswith(UNSORTED) else t.cpu() + cloud
            line += [
                f"{t.cpu():.2f} ({t.cpu(99.0):.2f})",
                f"{t.cpu() / ours:.2f} ({whole / ours:.2f})",
                f"{t.wall():.2f}",
                str(len(t)),
            ]
        lines.append(line)
    lines.extend([[name, *["not run", "-", "-", "0"] * len(kinds)] for name, _ in absent])
    head = [""]
    for kind in kinds:
        head += [f"{kind}: ms (99 %)", "x ours (with cloud)", "wall, ms", "frames"]
    return table(head, lines)


def sentences(rows: Iterable[Figures], timings: Sequence[Timing]) -> list[str]:
    """Methods that are better than ours (safe) in a figure, from the measured values."""
    out = []
    found = {(t.kind, t.peer): t.times.cpu() for t in timings}
    for (family, ke), peers in groups(rows).items():
        sums = {name: pooled(mine) for name, mine in peers.items() if not name.endswith((NOT_SIMPLIFIED, UNSORTED))}
        ours = sums.get(SAFE)
        if ours is None:
            continue
        others = [p for name, p in sums.items() if p is not None and name not in (SAFE, PAPER)]
        both = [p.peer for p in others if p.bytes <= ours.bytes and p.mean_m <= ours.mean_m]
        surer = [p.peer for p in others if p.missed[0] <= ours.missed[0] and p.open_stopped[0] <= ours.open_stopped[0]]
        nearer = [f"{p.peer} ({p.bytes / ours.bytes:,.1f} times the bytes)" for p in others if p.mean_m < ours.mean_m]
        where = f"**{family}, ke {ke:g}**"
        out.append(
            f"{where}: neither larger nor farther from the truth than ours: {_list(both)}; nearer at all: {_list(nearer)}."
        )
        out.append(f"{where}: miss no more and stop no more open rays than ours: {_list(surer)}.")
    for kind in dict.fromkeys(t.kind for t in timings):
        ours_ms, cloud = found[kind, SAFE], found[kind, CLOUD]
        variants = (NOT_SIMPLIFIED, UNSORTED)
        mine = [(name, ms) for (k, name), ms in found.items() if k == kind and not name.endswith(variants)]
        faster = [name for name, ms in mine if name not in (SAFE, PAPER, CLOUD) and ms + cloud < ours_ms]
        out.append(f"**{kind}**: faster than ours with their cloud counted: {_list(faster)}.")
    return out


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) if names else "none"

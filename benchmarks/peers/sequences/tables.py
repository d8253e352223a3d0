"""The tables of the methods that merge frames, as Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.markdown import table
from benchmarks.peers.sequences.judge import Figures
from benchmarks.peers.tables import percent

Share = tuple[float, float]
"""Over all rays together, and in the worst scene; of 1, nan: no rays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pooled:
    """One method, noise, pose and number of frames over all scenes: medians of the scenes, and shares."""

    unit: str
    primitives: float
    bytes: float
    missed: Share
    phantom: Share
    open_stopped: Share
    aside_missed: Share
    error_m: float
    error_p95_m: float
    bias_m: float
    cpu_ms: float


def pooled(rows: Sequence[Figures]) -> Pooled:
    """Of at least one row, which differ in their scene alone."""

    def middle(value: Callable[[Figures], float]) -> float:
        known = [value(r) for r in rows if not math.isnan(value(r))]
        return median(known) if known else math.nan

    return Pooled(
        unit=rows[0].unit,
        primitives=middle(lambda r: r.primitives),
        bytes=middle(lambda r: r.bytes),
        missed=_share(rows, lambda r: (r.missed, r.obstacle_rays)),
        phantom=_share(rows, lambda r: (r.phantom, r.obstacle_rays + r.open_rays)),
        open_stopped=_share(rows, lambda r: (r.open_stopped, r.open_rays)),
        aside_missed=_share(rows, lambda r: (r.aside_missed, r.aside_rays)),
        error_m=middle(lambda r: r.error_m),
        error_p95_m=middle(lambda r: r.error_p95_m),
        bias_m=middle(lambda r: r.bias_m),
        cpu_ms=middle(lambda r: r.cpu_ms),
    )


def _share(rows: Sequence[Figures], part: Callable[[Figures], tuple[int, int]]) -> Share:
    parts = [part(r) for r in rows if part(r)[1]]
    if not parts:
        return math.nan, math.nan
    return sum(p for p, _ in parts) / sum(w for _, w in parts), max(p / w for p, w in parts)


Key = tuple[float, str, str, int]
"""ke_per_m, pose, method, frames."""


def groups(rows: Iterable[Figures]) -> dict[Key, list[Figures]]:
    """The rows of all scenes by what they share, in the order in which they first come."""
    found: dict[Key, list[Figures]] = {}
    for r in rows:
        found.setdefault((r.ke_per_m, r.pose, r.method, r.frames), []).append(r)
    return found


HEAD = (
    "method",
    "frames",
    "made of",
    "bytes",
    "missed, %",
    "phantom, %",
    "open rays stopped, %",
    "missed aside, %",
    "error along the ray, m (95 %)",
    "bias, m",
    "CPU, ms a frame",
)


def summary_table(rows: Iterable[Figures], ke_per_m: float, pose: str) -> str:
    """A line for each method and number of frames."""
    lines = []
    for (ke, of_pose, method, frames), mine in sorted(groups(rows).items(), key=lambda item: item[0][3]):
        if (ke, of_pose) == (ke_per_m, pose):
            p = pooled(mine)
            lines.append(
                [
                    method,
                    str(frames),
                    f"{p.primitives:,.0f} {p.unit}",
                    f"{p.bytes:,.0f}",
                    *(percent(s) for s in (p.missed, p.phantom, p.open_stopped, p.aside_missed)),
                    f"{p.error_m:.2f} ({p.error_p95_m:.1f})",
                    f"{p.bias_m:+.2f}",
                    f"{p.cpu_ms:.1f}",
                ]
            )
    return table(HEAD, lines)


def sentences(rows: Iterable[Figures], frames: int, ours: Sequence[str]) -> list[str]:
    """For each noise and pose and each of our methods: the others that are no worse in all shares of the newest view, and
    those whose stops are nearer to the truth."""
    found: dict[tuple[float, str], dict[str, Pooled]] = {}
    for (ke, pose, method, of_frames), mine in groups(rows).items():
        if of_frames == frames:
            found.setdefault((ke, pose), {})[method] = pooled(mine)
    lines = []
    for (ke, pose), methods in found.items():
        for name in (n for n in ours if n in methods):
            us, others = methods[name], {n: p for n, p in methods.items() if n not in ours}
            no_worse = [
                n for n, p in others.items() if all(a <= b for a, b in zip(_shares(p), _shares(us), strict=True))
            ]
            nearer = [n for n, p in others.items() if p.error_m < us.error_m]
            lines.append(
                f"ke {ke:g}, {pose}, {name}: miss no more, and stop no more rays where nothing is and over the open: "
                f"{_names(no_worse)}; smaller median error along the ray: {_names(nearer)}."
            )
    return lines


def _shares(p: Pooled) -> tuple[float, float, float]:
    return p.missed[0], p.phantom[0], p.open_stopped[0]


def _names(names: Sequence[str]) -> str:
    return ", ".join(names) if names else "none"

"""The pictures of the side-by-side page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.paper.plots import figure, label
from benchmarks.peers.methods import NOT_SIMPLIFIED, UNSORTED
from benchmarks.peers.participants import SAFE
from benchmarks.peers.run import CLOUD, Figures, Timing
from benchmarks.peers.tables import Pooled, groups, pooled

COLORS = {
    "OSAPE, safe": "#1f77b4",
    "OSAPE, paper": "#d62728",
    "3DP": "#2ca02c",
    "OctoMap": "#9467bd",
    "Open3D planar": "#8c564b",
    "Open3D Voxel": "#e67e22",
    CLOUD: "#7f7f7f",
}


def kind_of(peer: str) -> str:
    """The key of COLORS that a peer's name begins with."""
    return next((k for k in COLORS if peer.startswith(k)), CLOUD)


def _size_of(peer: str) -> str:
    """The cell size, which distinguishes methods of one kind."""
    words = peer.split()
    return f"{words[words.index('m') - 1]}" if "m" in words else ""


def draw_scatter(
    path: Path,
    rows: Sequence[Figures],
    x: tuple[str, str],
    y: tuple[str, str],
    least: tuple[float, float],
) -> None:
    """A panel a family: one figure of Pooled over another, log-log; x, y: (attribute, what it is called); a share is that
    over all rays, in per cent. Filled: the least noise; hollow: the greatest. least: what is smaller is drawn there."""
    found = groups(rows)
    families = list(dict.fromkeys(family for family, _ in found))
    noises = sorted({ke for _, ke in found})
    with figure(path, 1, len(families), 5.2 * len(families), 4.4) as axes:
        for ax, family in zip(axes[0], families, strict=True):
            for ke in noises:
                kinds: dict[str, list[tuple[float, float, str]]] = {}
                for name, mine in found.get((family, ke), {}).items():
                    p = pooled(mine)
                    at = (_value(p, x[0], least[0]), _value(p, y[0], least[1])) if p else (math.nan, math.nan)
                    if all(map(math.isfinite, at)) and not name.endswith((NOT_SIMPLIFIED, UNSORTED)):
                        kinds.setdefault(kind_of(name), []).append((*at, _size_of(name)))
                for kind, points in kinds.items():
                    face = COLORS[kind] if ke == noises[0] else "white"
                    ax.plot(
                        [p[0] for p in points],
                        [p[1] for p in points],
                        "o-",
                        color=COLORS[kind],
                        linewidth=0.8,
                        markersize=6,
                        markerfacecolor=face,
                        label=kind if ke == noises[0] else None,
                    )
                    for px, py, word in points:
                        ax.annotate(word, (px, py), textcoords="offset points", xytext=(5, 4), fontsize=6.5)
            for axis in (ax.xaxis, ax.yaxis):
                _logarithmic(axis)
            hollow = f"; hollow: {noises[-1]:g}" if len(noises) > 1 else ""
            label(ax, f"{family}, ke {noises[0]:g}{hollow}", x[1], y[1])


def _logarithmic(axis: Any) -> None:
    """A logarithmic axis with plain numbers at 1, 2 and 5, or at 1 alone where it is long."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _value(p: Pooled | None, name: str, least: float) -> float:
    """A figure to be drawn on a logarithmic axis."""
    value = getattr(p, name)
    return max(least, 100.0 * value[0] if isinstance(value, tuple) else float(value))


def draw_times(path: Path, timings: Sequence[Timing]) -> None:
    """A bar a peer, a panel a kind of frame: medians of the processor's time, logarithmic, ours as a line."""
    kinds = list(dict.fromkeys(t.kind for t in timings))
    with figure(path, 1, len(kinds), 5.6 * len(kinds), 4.6) as axes:
        for ax, kind in zip(axes[0], kinds, strict=True):
            mine = [t for t in timings if t.kind == kind]
            ms = [t.times.cpu() for t in mine]
            ax.barh(range(len(mine)), ms, color=[COLORS[kind_of(t.peer)] for t in mine])
            for i, value in enumerate(ms):
                ax.text(value * 1.05, i, f"{value:.1f}", va="center", fontsize=7)
            ours = next(t.times.cpu() for t in mine if t.peer == SAFE)
            ax.axvline(ours, color=COLORS[SAFE], linewidth=0.8, linestyle="--")
            ax.set_xscale("log")
            ax.set_xlim(0.5 * min(ms), 3.0 * max(ms))
            ax.set_yticks(range(len(mine)), [t.peer for t in mine])
            ax.invert_yaxis()
            label(ax, f"{kind}, 640x480", "ms a frame of one core, median", "", legend=False)

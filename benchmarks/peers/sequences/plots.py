"""The picture of the methods that merge frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.paper.plots import SERIES, figure, label
from benchmarks.peers.sequences.judge import Figures
from benchmarks.peers.sequences.tables import groups, pooled

PANELS: Final = (
    ("missed", "obstacle rays missed, %"),
    ("phantom", "rays stopped where nothing is, %"),
    ("open_stopped", "open rays stopped, %"),
    ("aside_missed", "missed aside, %"),
)
LEAST_PERCENT: Final = 0.003
"""Smaller shares are drawn there."""


def draw(path: Path, rows: Sequence[Figures]) -> None:
    """A row of panels for each noise, a line for each method: hollow after the fewer frames, filled after the more; a color
    for each pose. All scenes together."""
    found = groups(rows)
    kes = sorted({r.ke_per_m for r in rows})
    methods, poses = (list(dict.fromkeys(getattr(r, name) for r in rows)) for name in ("method", "pose"))
    most = max(r.frames for r in rows)
    with figure(path, len(kes), len(PANELS), 15.0, 0.6 + 0.36 * len(methods) * len(kes) + 0.8 * len(kes)) as axes:
        for line, ke in zip(axes, kes, strict=True):
            for ax, (name, text) in zip(line, PANELS, strict=True):
                for (of_ke, pose, method, frames), mine in found.items():
                    if of_ke != ke:
                        continue
                    color = SERIES[poses.index(pose)]
                    value = max(LEAST_PERCENT, 100.0 * getattr(pooled(mine), name)[0])
                    y = methods.index(method) + 0.24 * (poses.index(pose) - 0.5 * (len(poses) - 1))
                    text_of = f"{pose}, {frames} frames" if method == methods[0] else None
                    face = color if frames == most else "white"
                    ax.plot([value], [y], "o", color=color, markerfacecolor=face, markersize=5, label=text_of)
                ax.set_xscale("log")
                ax.set_xlim(0.7 * LEAST_PERCENT, 130.0)
                ax.set_yticks(range(len(methods)), methods if ax is line[0] else [""] * len(methods))
                ax.invert_yaxis()
                label(ax, f"ke {ke:g}", text, "", legend=ax is line[-1])

"""The pictures of the fidelity page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fidelity.goals import MEASURES, measure, summary
from benchmarks.fidelity.matrix import TILTS_DEG
from benchmarks.fidelity.metrics import RANGE_BINS
from benchmarks.fidelity.result import Row
from benchmarks.fidelity.thin import STEP_M, THINGS, curve
from benchmarks.paper.plots import SERIES, figure
from benchmarks.paper.plots import label as plain_label
from benchmarks.scenes.catalogue import FAMILIES, SCENES


def _kes(rows: Sequence[Row]) -> list[float]:
    return sorted({r.case.ke_per_m for r in rows})


def label(ax: Any, title: str, x: str, y: str, legend_at: str = "upper left") -> None:
    """Title and axes, with the legend at a given place: matplotlib's search for the best place is slow."""
    plain_label(ax, title, x, y, legend=False)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=7, loc=legend_at)


def draw_goals(rows: Sequence[Row], path: Path) -> None:
    """Worst and median case of each figure that has a goal, as multiples of it."""
    kes = _kes(rows)
    with figure(path, 1, len(kes), 5.5 * len(kes), 5.2) as axes:
        for ax, ke in zip(axes[0], kes, strict=True):
            names, worst, middle = [], [], []
            for m in MEASURES:
                for family in FAMILIES:
                    goal = m.goal(family)
                    s = summary(m, [r for r in rows if r.family == family and r.case.ke_per_m == ke], goal)
                    if s is not None and not math.isnan(goal):
                        names.append(f"{m.name}, {family}")
                        worst.append(s.worst / goal)
                        middle.append(s.median / goal)
            at = np.arange(len(names))
            colors = [SERIES[4] if value > 1.0 else SERIES[2] for value in worst]
            ax.barh(at, np.clip(worst, 0.01, 100.0), color=colors, alpha=0.75, label="worst case")
            ax.plot(np.clip(middle, 0.01, 100.0), at, "k|", markersize=9, label="median case")
            ax.axvline(1.0, color="black", linewidth=1.0)
            ax.set_xscale("log")
            ax.set_xlim(0.01, 100.0)
            ax.set_yticks(at, names)
            ax.invert_yaxis()
            label(ax, f"ke {ke:g}", "times the goal", "", "upper right")
            ax.tick_params(axis="y", labelsize=6)


def draw_thin(rows: Sequence[Row], path: Path) -> None:
    """Recall of poles and wires over range, a line a noise."""
    with figure(path, 1, len(THINGS), 9.0, 3.6) as axes:
        for ax, (title, scenes, prefix) in zip(axes[0], THINGS, strict=True):
            for color, ke in zip(SERIES, _kes(rows), strict=False):
                points = curve([r for r in rows if r.case.ke_per_m == ke], scenes, prefix)
                middle = [p.from_m + STEP_M / 2 for p in points]
                ax.plot(middle, [100 * p.kept for p in points], "o-", color=color, markersize=3, label=f"ke {ke:g}")
            ax.set_ylim(-3, 103)
            label(ax, title, "range, m", "rays kept, %", "lower left")


def draw_noise(rows: Sequence[Row], path: Path) -> None:
    """Error, missed and phantom over noise: median and worst case of each family."""
    shown = ("mean error", "missed", "phantom")
    with figure(path, 1, len(shown), 11.0, 3.6) as axes:
        for ax, name in zip(axes[0], shown, strict=True):
            m = measure(name)
            for color, family in zip(SERIES, ("structured", "unstructured", "thin"), strict=False):
                mine = [r for r in rows if r.family == family]
                found = [(ke, summary(m, [r for r in mine if r.case.ke_per_m == ke])) for ke in _kes(mine)]
                known = [(ke, s) for ke, s in found if s is not None]
                kes = [ke for ke, _ in known]
                middle = [s.median if math.isnan(s.pooled) or m.unit == "m" else s.pooled for _, s in known]
                ax.plot(kes, middle, "o-", color=color, markersize=3, label=family)
                ax.plot(kes, [s.worst for _, s in known], "^:", color=color, markersize=3, label=f"{family}, worst")
            label(ax, f"{name}, {m.unit}", "ke, 1/m", m.unit)
            if m.unit == "%":
                ax.set_yscale("symlog", linthresh=0.01)
                ax.axhline(m.goal(""), color="black", linewidth=0.8)


def draw_ranges(rows: Sequence[Row], path: Path) -> None:
    """Missed and phantom rays in each metre of true range, all cases of a noise together."""
    bins = np.arange(RANGE_BINS) + 0.5
    kinds = (("missed", 0.05), ("phantom", 0.5))
    with figure(path, 1, 2, 9.0, 3.6) as axes:
        for ax, (kind, goal) in zip(axes[0], kinds, strict=True):
            for color, ke in zip(SERIES, _kes(rows), strict=False):
                mine = [r.by_range for r in rows if r.case.ke_per_m == ke and r.valid]
                whole = np.sum([b.obstacle for b in mine], axis=0)
                part = np.sum([getattr(b, kind) for b in mine], axis=0)
                enough = whole > 2000
                ax.plot(bins[enough], 100 * part[enough] / whole[enough], ".-", color=color, label=f"ke {ke:g}")
            ax.axhline(goal, color="black", linewidth=0.8)
            ax.set_yscale("symlog", linthresh=0.01)
            label(ax, kind, "true range, m", "% of the obstacle rays there")


def draw_heatmap(rows: Sequence[Row], path: Path) -> None:
    """Missed and phantom of each scene at each tilt, the worse of all noises."""
    scenes = [s for s in SCENES if any(r.case.scene == s for r in rows)]
    with figure(path, 1, 2, 11.0, 1.2 + 0.17 * len(scenes)) as axes:
        for ax, (title, name) in zip(axes[0], (("missed", "missed"), ("phantom", "phantom")), strict=True):
            m = measure(name)
            grid = np.full((len(scenes), len(TILTS_DEG)), np.nan)
            for i, scene in enumerate(scenes):
                for j, tilt in enumerate(TILTS_DEG):
                    mine = [r for r in rows if r.case.scene == scene and (r.case.roll_deg, r.case.pitch_deg) == tilt]
                    s = summary(m, mine)
                    grid[i, j] = np.nan if s is None else s.worst
            _heat(ax, grid / m.goal(""), scenes, f"{title}, times the goal of {m.goal(''):g} %")


def _heat(ax: Any, grid: np.ndarray, scenes: Sequence[str], title: str) -> None:
    from matplotlib.colors import LogNorm

    image = ax.imshow(np.clip(grid, 0.05, None), norm=LogNorm(0.05, 20.0), cmap="RdYlGn_r", aspect="auto")
    ax.set_yticks(range(len(scenes)), scenes, fontsize=6)
    names = [f"{roll:+d}/{pitch:+d}" for roll, pitch in TILTS_DEG]
    ax.set_xticks(range(len(names)), names, fontsize=6, rotation=45)
    for i, j in zip(*np.nonzero(grid > 1.0), strict=True):
        ax.text(j, i, f"{grid[i, j]:.0f}", fontsize=5, ha="center", va="center")
    ax.set_title(title, fontsize=9, loc="left")
    ax.set_xlabel("roll/pitch, degrees", fontsize=7)
    ax.figure.colorbar(image, ax=ax, fraction=0.04)

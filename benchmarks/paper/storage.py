"""Figures 11, 12 and 14: planes, bytes and error beside the grid baseline, structured and unstructured scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.markdown import table
from benchmarks.paper.cases import (
    CAMERA,
    CONDITION_WORDS,
    CONDITIONS,
    EXACT,
    MODES,
    Condition,
    Figures,
    grid_name,
    held_out,
    measure,
    measure_grid,
    middle,
    named_frames,
    number,
    percent,
    progress,
    worst,
)
from benchmarks.paper.forms import params_of
from benchmarks.paper.plots import COLORS, figure, label, words
from benchmarks.peers.grid_prisms import CELLS_M
from benchmarks.scenes import catalogue as scenes
from core.params import Params

KINDS = ("structured", "unstructured")
QUICK = {"structured": ("wall", "street", "window"), "unstructured": ("trees", "mixture")}
METHODS = (*MODES, *(grid_name(cell) for cell in CELLS_M))
FINE, COARSE = grid_name(0.1), grid_name(0.8)
SHOWN = (*MODES, FINE, COARSE)
"""The methods of the tables, which leave out noise without other faults too; the pictures show all cells."""


def run(quick: bool) -> list[Figures]:
    """Every method on every scene of both kinds under every condition, level, 2 m above the ground."""
    todo = [
        (name, seed, condition)
        for kind in KINDS
        for name in (QUICK[kind] if quick else scenes.FAMILIES[kind])
        for condition in ((EXACT, CAMERA) if quick else CONDITIONS)
        for seed in held_out(2 if condition is CAMERA and not quick else 1)
    ]
    found = []
    for i, (name, seed, condition) in enumerate(todo):
        progress(f"storage and precision {i + 1}/{len(todo)}: {name}, seed {seed}, {condition.name}")
        found += one(name, seed, condition)
    return found


def one(name: str, seed: int, condition: Condition) -> list[Figures]:
    """All methods on one frame."""
    frames = named_frames(name, seed, condition)
    rows = [measure(frames, condition, name, seed, params_of(mode)) for mode in MODES]
    return rows + [measure_grid(frames[-1], condition, name, seed, Params(), cell) for cell in CELLS_M]


def of(rows: list[Figures], kind: str, condition: str, method: str) -> list[Figures]:
    """The rows of one method on one kind of scene under one condition."""
    return [r for r in rows if (r.family, r.condition, r.method) == (kind, condition, method)]


def ratios(rows: list[Figures], kind: str, condition: str, method: str, against: str, field: str) -> list[float]:
    """A figure of a method over that of another on the same frames; frames where the other has none are left out."""
    other = {(r.scene, r.seed): float(getattr(r, field)) for r in of(rows, kind, condition, against)}
    return [
        float(getattr(r, field)) / other[r.scene, r.seed]
        for r in of(rows, kind, condition, method)
        if other[r.scene, r.seed] > 0.0
    ]


def conditions_in(rows: list[Figures]) -> list[str]:
    """The conditions that were run, in their order."""
    return [c.name for c in CONDITIONS if any(r.condition == c.name for r in rows)]


def tables(rows: list[Figures]) -> str:
    """Medians over the frames of each kind with exact depth and with a camera's, with the worst frame."""
    parts = []
    for kind in KINDS:
        for condition in (EXACT.name, CAMERA.name):
            frames = len(of(rows, kind, condition, "safe"))
            lines = [_line(rows, kind, condition, method) for method in SHOWN]
            head = ["model", "planes", "of 0.8 m grid", "worst", "bytes", "error, m", "of 0.1 m grid", "worst"]
            head += ["missed, %", "phantom, %", "open stopped, %"]
            parts.append(f"{kind.capitalize()}, {CONDITION_WORDS[condition]}, {frames} frames:\n\n{table(head, lines)}")
    return "\n\n".join(parts)


def _line(rows: list[Figures], kind: str, condition: str, method: str) -> list[str]:
    mine = of(rows, kind, condition, method)
    planes = ratios(rows, kind, condition, method, COARSE, "planes")
    errors = ratios(rows, kind, condition, method, FINE, "mean_m")
    return [
        words(method),
        number(middle([float(r.planes) for r in mine]), 0),
        number(middle(planes)),
        number(worst(planes)),
        number(middle([float(r.bytes) for r in mine]), 0),
        number(middle([r.mean_m for r in mine]), 3),
        number(middle(errors)),
        number(worst(errors)),
        percent(middle([r.missed for r in mine]), 2),
        percent(middle([r.phantom for r in mine]), 2),
        percent(middle([r.open_stopped for r in mine])),
    ]


def draw(rows: list[Figures], path: Path, field: str, y: str, log: bool) -> None:
    """One picture for Fig. 11 (planes) or 12 (mean_m): a box a method over all frames, both kinds side by side."""
    condition = conditions_in(rows)[-1]
    with figure(path, 1, 2) as axes:
        for ax, kind in zip(axes[0], KINDS, strict=True):
            for i, method in enumerate(METHODS):
                values = [float(getattr(r, field)) for r in of(rows, kind, condition, method)]
                values = [v for v in values if not np.isnan(v)]
                if not values:
                    continue
                ax.plot([i] * len(values), values, "o", color=COLORS[method], markersize=3, alpha=0.6)
                ax.plot([i - 0.3, i + 0.3], [middle(values)] * 2, color=COLORS[method], linewidth=2.5)
                ax.annotate(
                    f"{middle(values):.0f}" if field == "planes" else f"{middle(values):.3f}",
                    (i + 0.32, middle(values)),
                    fontsize=7,
                    color=COLORS[method],
                    va="center",
                )
            ax.set_xticks(range(len(METHODS)), [words(m).replace(" (", "\n(").replace("d ", "d\n") for m in METHODS])
            ax.set_xlim(-0.6, len(METHODS) - 0.2)
            if log:
                ax.set_yscale("log")
            label(ax, f"{kind} ({CONDITION_WORDS[condition]})", "", y)

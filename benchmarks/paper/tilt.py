"""Figure 10: what the tilt of the camera does to the model, over roll and over pitch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.markdown import table
from benchmarks.paper.cases import (
    CAMERA,
    EXACT,
    MODES,
    PRINTED,
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
from core.params import Params

ANGLES_DEG = (-30.0, -20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 20.0, 30.0)
QUICK_DEG = (-30.0, 0.0, 30.0)
SCENES = ("corner", "street", "window", "trees", "stones", "mixture")
QUICK_SCENES = ("street", "trees")
AXES = ("roll", "pitch")
GRID = grid_name(0.1)
PAPERS_DEG = {"roll": PRINTED["tilt_deg"], "pitch": -PRINTED["tilt_deg"]}
"""The tilts of Fig. 10 in our signs: the paper's theta is positive nose down (Lemma 1), our pitch nose up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRow:
    """The figures of one method at one tilt about one axis (the other angle is 0), degrees; pitch is nose up."""

    axis: str
    angle_deg: float
    figures: Figures


def run(quick: bool) -> list[TiltRow]:
    """Both modes and the 0.1 m grid at every tilt under a camera's faults, at a few under exact depth."""
    todo = [
        (name, seed, condition, axis, angle)
        for name in (QUICK_SCENES if quick else SCENES)
        for seed in held_out(1)
        for condition in ((CAMERA,) if quick else (EXACT, CAMERA))
        for axis in AXES
        for angle in (QUICK_DEG if quick or condition is EXACT else ANGLES_DEG)
    ]
    found = []
    for i, (name, seed, condition, axis, angle) in enumerate(todo):
        progress(f"tilt {i + 1}/{len(todo)}: {name}, {condition.name}, {axis} {angle:+g}")
        found += one(name, seed, condition, axis, angle)
    return found


def one(name: str, seed: int, condition: Condition, axis: str, angle_deg: float) -> list[TiltRow]:
    """All methods on one tilted frame."""
    roll, pitch = (angle_deg, 0.0) if axis == "roll" else (0.0, angle_deg)
    frames = named_frames(name, seed, condition, roll, pitch)
    figures = [measure(frames, condition, name, seed, params_of(mode)) for mode in MODES]
    figures.append(measure_grid(frames[-1], condition, name, seed, Params(), 0.1))
    return [TiltRow(axis=axis, angle_deg=angle_deg, figures=f) for f in figures]


def of(rows: list[TiltRow], axis: str, angle_deg: float, method: str, condition: str) -> list[Figures]:
    """The figures of a method at one tilt, over the scenes."""
    return [
        r.figures
        for r in rows
        if (r.axis, r.angle_deg, r.figures.method, r.figures.condition) == (axis, angle_deg, method, condition)
    ]


def angles(rows: list[TiltRow]) -> list[float]:
    """The angles that were run under a camera's faults."""
    return sorted({r.angle_deg for r in rows if r.figures.condition == CAMERA.name})


def conditions(rows: list[TiltRow]) -> list[str]:
    """The conditions that were run, exact depth first."""
    return [c.name for c in (EXACT, CAMERA) if any(r.figures.condition == c.name for r in rows)]


def tables(rows: list[TiltRow]) -> str:
    """A line a tilt: level and the paper's two, and the worst of all."""
    lines = []
    shown = [("roll", 0.0), ("roll", 30.0), ("roll", -30.0), ("pitch", 30.0), ("pitch", -30.0)]
    for condition in conditions(rows):
        for axis, angle in shown:
            for method in MODES:
                mine = of(rows, axis, angle, method, condition)
                name = "level" if angle == 0.0 else f"{axis} {angle:+.0f}°"
                lines.append([condition, name, words(method), *_line(mine)])
    head = [
        "depth",
        "tilt",
        "model",
        "error, m",
        "worst",
        "planes",
        "missed, %",
        "worst",
        "phantom, %",
        "open stopped, %",
        "frames",
        "silent",
    ]
    return table(head, lines, words=3)


def _line(mine: list[Figures]) -> list[str]:
    return [
        number(middle([f.mean_m for f in mine]), 3),
        number(worst([f.mean_m for f in mine]), 3),
        number(middle([float(f.planes) for f in mine]), 0),
        percent(middle([f.missed for f in mine]), 2),
        percent(worst([f.missed for f in mine]), 2),
        percent(middle([f.phantom for f in mine]), 2),
        percent(middle([f.open_stopped for f in mine])),
        str(len(mine)),
        str(sum(f.silent for f in mine)),
    ]


def draw(rows: list[TiltRow], path: Path) -> None:
    """Error, planes and missed rays over roll and over pitch, medians over the scenes."""
    condition = conditions(rows)[-1]
    scenes_run = len({r.figures.scene for r in rows})
    panels = (
        ("mean_m", "mean error, m", 1.0),
        ("planes", "planes of a frame", 1.0),
        ("missed", "missed rays, %", 100.0),
    )
    with figure(path, 3, 2, height=8.6) as axes:
        for column, axis in enumerate(AXES):
            for row, (field, y, scale) in enumerate(panels):
                ax = axes[row][column]
                for method in (*MODES, GRID) if field == "mean_m" else MODES:
                    values = [
                        scale * middle([float(getattr(f, field)) for f in of(rows, axis, a, method, condition)])
                        for a in angles(rows)
                    ]
                    ax.plot(angles(rows), values, "o-", markersize=3, color=COLORS[method], label=words(method))
                shown = PAPERS_DEG[axis]
                ax.axvline(shown, color="black", linewidth=0.9, linestyle=":", label="tilt that the paper shows")
                ax.set_ylim(0.0, 1.15 * max(ax.get_ylim()[1], 1e-3))
                title = f"{axis}, median of {scenes_run} scenes" if row == 0 else ""
                label(ax, title, f"{axis} of the camera, degrees", y, legend=row == column == 0)

"""Figure 13 b, c: time and error over the sampling interval, error over noise.

The interval is `Params.column_step`: so many columns are pooled into one. The paper takes one
column of each group and skips the others; that is measured beside it by taking the others out of the depth image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.fidelity.metrics import recall
from benchmarks.markdown import table
from benchmarks.paper.cases import (
    NAN,
    NOISE,
    Condition,
    Figures,
    held_out,
    measure,
    measure_grid,
    middle,
    model_of,
    named_frames,
    noise_condition,
    number,
    percent,
    progress,
    rays_under,
)
from benchmarks.paper.forms import extractor_of, params_of
from benchmarks.paper.plots import COLORS, SERIES, figure, label, words
from core.params import Params
from drivers.simulation.source import Rendered

STEPS = (1, 2, 3, 4, 6, 8, 12, 16)
QUICK_STEPS = (1, 4, 16)
NOISES = (0.0, 0.0015, 0.005, 0.01)
QUICK_NOISES = (0.0, 0.005)
SCENES = {"structured": ("corner", "street", "window"), "unstructured": ("trees", "stones", "mixture")}
QUICK_SCENES = {"structured": ("street",), "unstructured": ("trees",)}
THIN = "poles"
SKIPPED_KE = 0.005
"""The noise under which skipping is measured beside pooling."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntervalRow:
    """One frame at one interval and noise. columns: pooled (ours), or skipped (the paper's way). thin: share of the rays
    of poles that the model keeps (nan: a scene of other things)."""

    step: int
    ke_per_m: float
    columns: str
    thin: float
    figures: Figures


def run(quick: bool) -> list[IntervalRow]:
    """Ours at every interval and noise, the printed form at a few; poles at every interval, pooled and skipped."""
    kinds, steps = (QUICK_SCENES, QUICK_STEPS) if quick else (SCENES, STEPS)
    todo = [
        (name, noise_condition(ke), step, "pooled", mode)
        for names in kinds.values()
        for name in names
        for ke in (QUICK_NOISES if quick else NOISES)
        for step in steps
        for mode in ("safe", "paper")
        if mode == "safe" or step in QUICK_STEPS
    ]
    todo += [(THIN, NOISE, step, columns, "safe") for step in steps for columns in ("pooled", "skipped")]
    skipped_at = noise_condition(SKIPPED_KE)
    todo += [
        (name, skipped_at, step, "skipped", "safe") for names in kinds.values() for name in names for step in steps
    ]
    found = []
    for i, (name, condition, step, columns, mode) in enumerate(todo):
        progress(f"sampling interval {i + 1}/{len(todo)}: {name}, ke {condition.ke_per_m:g}, every {step}, {mode}")
        for seed in held_out(1 if quick or name != THIN else 4):
            found.append(one(name, seed, condition, step, columns, params_of(mode, column_step=step)))
    for names in kinds.values():
        for name in names:
            for ke in QUICK_NOISES if quick else NOISES:
                progress(f"grid under noise: {name}, ke {ke:g}")
                found.append(grid(name, held_out(1)[0], noise_condition(ke)))
    return found


def one(name: str, seed: int, condition: Condition, step: int, columns: str, params: Params) -> IntervalRow:
    """The figures of one frame."""
    frames: Sequence[Rendered] = named_frames(name, seed, condition)
    if columns == "skipped":
        frames = [skip_columns(frame, step) for frame in frames]
    return IntervalRow(
        step=step,
        ke_per_m=condition.ke_per_m,
        columns=columns,
        thin=kept(frames, condition, params) if name == THIN else NAN,
        figures=measure(frames, condition, name, seed, params),
    )


def grid(name: str, seed: int, condition: Condition) -> IntervalRow:
    """The 0.1 m grid under the same noise, without any interval."""
    frames = named_frames(name, seed, condition)
    figures = measure_grid(frames[-1], condition, name, seed, Params(), 0.1)
    return IntervalRow(step=1, ke_per_m=condition.ke_per_m, columns="pooled", thin=NAN, figures=figures)


def skip_columns(frame: Rendered, step: int) -> Rendered:
    """The frame with one column of every `step` left, the others without a measurement."""
    depth = frame.depth_mm.copy()
    depth[:, np.arange(depth.shape[1]) % step != step // 2] = 0
    return replace(frame, depth_mm=depth)


def kept(frames: Sequence[Rendered], condition: Condition, params: Params) -> float:
    """Share of the rays of all named things that the model keeps."""
    model = model_of(frames, extractor_of(params))
    rays = rays_under(frames[-1], condition, params)
    found = recall(frames[-1], rays, model.planes.astype(np.float64))
    return sum(r.kept * r.rays for r in found) / sum(r.rays for r in found) if found else NAN


def of(
    rows: list[IntervalRow], method: str, step: int, ke: float, kind: str = "", columns: str = "pooled"
) -> list[Figures]:
    """The figures of a method at one interval and noise, of one kind of scene or of both."""
    return [
        r.figures
        for r in rows
        if (r.figures.method, r.step, r.ke_per_m, r.columns) == (method, step, ke, columns)
        and (r.figures.family == kind if kind else r.figures.scene != THIN)
    ]


def thin_kept(rows: list[IntervalRow], step: int, columns: str) -> float:
    """Share of the poles' rays kept, mean over seeds."""
    values = [r.thin for r in rows if r.figures.scene == THIN and (r.step, r.columns) == (step, columns)]
    return float(np.mean(values)) if values else NAN


def steps(rows: list[IntervalRow]) -> list[int]:
    """The intervals that were run."""
    return sorted({r.step for r in rows})


def noises(rows: list[IntervalRow]) -> list[float]:
    """The noise that was run on the structured and unstructured scenes."""
    return sorted({r.ke_per_m for r in rows if r.figures.scene != THIN})


def tables(rows: list[IntervalRow]) -> str:
    """A line an interval; then a line a noise."""
    kes = noises(rows)
    head = ["every n-th column", *(f"error, m, ke {ke:g}" for ke in kes), f"ke {SKIPPED_KE:g}, skipped"]
    head += ["planes", "missed, %", "poles kept, % (pooled)", "(skipped)"]
    lines = []
    for step in steps(rows):
        mine = of(rows, "safe", step, kes[-1])
        errors = [number(middle([f.mean_m for f in of(rows, "safe", step, ke)]), 3) for ke in kes]
        skipped = number(middle([f.mean_m for f in of(rows, "safe", step, SKIPPED_KE, columns="skipped")]), 3)
        planes, missed = middle([float(f.planes) for f in mine]), middle([f.missed for f in mine])
        thin = [percent(thin_kept(rows, step, columns), 0) for columns in ("pooled", "skipped")]
        lines.append([str(step), *errors, skipped, number(planes, 0), percent(missed, 2), *thin])
    by_noise = []
    for ke in kes:
        errors = [
            number(middle([f.mean_m for f in of(rows, method, 1, ke, kind)]), 3)
            for kind in SCENES
            for method in ("safe", "paper", "grid 0.1 m")
        ]
        by_noise.append([f"{ke:g}", *errors])
    named = [f"{kind}, {words(method)}" for kind in SCENES for method in ("safe", "paper", "grid 0.1 m")]
    return (
        f"Ours over the sampling interval, medians over the scenes of both kinds (planes, missed: ke {kes[-1]:g}; poles: "
        f"ke {NOISE.ke_per_m:g}):\n\n{table(head, lines)}\n\nMean error in m over noise, every column, medians:\n\n"
        f"{table(['ke, 1/m', *named], by_noise)}"
    )


def draw(rows: list[IntervalRow], path: Path) -> None:
    """Error over the interval, a curve a noise; error over noise, a curve a method; poles over the interval."""
    with figure(path, 1, 3, width=12.0) as axes:
        a, b, c = axes[0]
        for color, ke in zip(SERIES, noises(rows), strict=False):
            errors = [middle([f.mean_m for f in of(rows, "safe", step, ke)]) for step in steps(rows)]
            a.plot(steps(rows), errors, "o-", markersize=3, color=color, label=f"ours, ke {ke:g}")
        skipped = [middle([f.mean_m for f in of(rows, "safe", s, SKIPPED_KE, columns="skipped")]) for s in steps(rows)]
        a.plot(steps(rows), skipped, "o--", markersize=3, color=COLORS["skip"], label=f"skipped, ke {SKIPPED_KE:g}")
        a.set_ylim(bottom=0.0)
        label(a, "error over the sampling interval", "every n-th column", "mean error, m")
        for kind, line in zip(SCENES, ("-", "--"), strict=True):
            for method in ("safe", "paper", "grid 0.1 m"):
                errors = [middle([f.mean_m for f in of(rows, method, 1, ke, kind)]) for ke in noises(rows)]
                name = f"{words(method)}, {kind}"
                b.plot(noises(rows), errors, f"o{line}", markersize=3, color=COLORS[method], label=name)
        b.set_yscale("log")
        b.set_ylim(top=20.0 * b.get_ylim()[1])  # room for the names
        label(b, "error over noise, every column", "ke, 1/m (noise of depth = ke Z²)", "mean error, m")
        for columns, color in (("pooled", COLORS["safe"]), ("skipped", COLORS["skip"])):
            values = [100.0 * thin_kept(rows, step, columns) for step in steps(rows)]
            c.plot(steps(rows), values, "o-", markersize=3, color=color, label=f"columns {columns}")
        c.set_ylim(0.0, 104.0)
        label(c, "poles of 0.12 m at 4-15 m", "every n-th column", "rays kept, %")

"""The openings of Figure 8: how large a window and a passage are in the model, over distance and noise.

The paper's camera is a ZED of 672x376; so is ours here, 1.5 m above the ground."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.fidelity.openings import OpeningSize, in_view, opening_size
from benchmarks.markdown import table
from benchmarks.paper.cases import (
    MODES,
    PRINTED_OPENINGS,
    Condition,
    frames_of,
    held_out,
    middle,
    model_of,
    percent,
    progress,
    zed_info,
)
from benchmarks.paper.forms import extractor_of, mode_of, params_of
from benchmarks.paper.plots import COLORS, figure, label, words
from core.frames import horizontal_heading_rad, rotation_level_ned
from core.params import Params
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import Rendered

DISTANCES_M = (4.0, 6.0, 8.0, 10.0)
CONDITIONS = (
    Condition("exact", 0.0, False, 0.0015),
    Condition("ke 0.0015", 0.0015, True, 0.0015),
    Condition("ke 0.005", 0.005, True, 0.005),
    Condition("ke 0.01", 0.01, True, 0.01),
)
CAMERA_M = 1.5
SLIT_M = (1.2, 0.6)
"""Beside the window: too small to pass, to be filled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpeningRow:
    """One opening in one model; the size is the largest free rectangle in it, 0 x 0 where it was closed. free_share: of
    its area left free."""

    opening: str
    condition: str
    method: str
    distance_m: float
    seed: int
    width_m: float
    height_m: float
    free_share: float


def opening_scene(opening: str, distance_m: float, seed: int) -> Scene:
    """A facade with the window (sill 1 m) and a slit, or with the passage (from the ground), well in front of another
    wall. Raises ValueError for another name."""
    rng = np.random.Generator(np.random.PCG64(seed))
    aside, turn = rng.uniform(-0.2, 0.2), rng.uniform(-0.3, 0.3)
    s = SceneBuilder(opening)
    s.ground()
    a, b = (distance_m - turn, -8.0), (distance_m + turn, 8.0)
    if opening == "window":
        width, height = PRINTED_OPENINGS["window"][0]
        start = 8.0 - width / 2.0 + aside
        s.wall("facade", a, b, 5.5, ((start, 1.0, width, height), (start + width + 0.8, 1.6, *SLIT_M)))
    elif opening == "corridor":
        width, height = PRINTED_OPENINGS["corridor"][0]
        s.wall("facade", a, b, 5.5, ((8.0 - width / 2.0 + aside, 0.0, width, height),))
    else:
        raise ValueError(f"no opening {opening!r}; there are: {', '.join(PRINTED_OPENINGS)}")
    s.wall("back wall", (distance_m + 7.0, -14.0), (distance_m + 7.0, 14.0), 7.0)
    return s.build()


def sizes(frame: Rendered, planes: np.ndarray) -> list[OpeningSize]:
    """The openings of a frame in a model, a ground below the facade counting as closed; those not in view are left out."""
    planes = np.vstack([np.asarray(planes, np.float64).reshape(-1, 6), _ground_line(frame)])
    return [opening_size(o, frame, planes) for o in frame.scene.openings if in_view(o, frame)]


def _ground_line(frame: Rendered) -> np.ndarray:
    """A plane (1, 6) from the ground down along the first opening's wall: no vehicle passes there, and no model has it as an obstacle."""
    o = frame.scene.openings[0]
    to_level = rotation_level_ned(horizontal_heading_rad(frame.R_ned_optical))
    a, b = np.array([*o.a_m, 0.0]), np.array([*o.b_m, 0.0])
    along = (b - a) / np.linalg.norm(b - a)
    ends = [to_level @ (p - frame.position_ned_m) for p in (a - along, b + along)]
    ground = frame.scene.ground.z_m - frame.position_ned_m[2]
    return np.array([[*ends[0][:2], *ends[1][:2], ground, ground + 1.0]])


def run(quick: bool) -> list[OpeningRow]:
    """Both openings at all distances and noises, in both modes."""
    todo = [
        (opening, condition, distance, seed)
        for opening in PRINTED_OPENINGS
        for condition in (CONDITIONS[:2] if quick else CONDITIONS)
        for distance in (DISTANCES_M[1:2] if quick else DISTANCES_M)
        for seed in held_out(1 if quick else 3)
    ]
    found = []
    for i, (opening, condition, distance, seed) in enumerate(todo):
        progress(f"openings {i + 1}/{len(todo)}: {opening} at {distance:g} m, {condition.name}")
        for mode in MODES:
            found += one(opening, condition, distance, seed, params_of(mode))
    return found


def one(opening: str, condition: Condition, distance_m: float, seed: int, params: Params) -> list[OpeningRow]:
    """The rows of one frame: the opening, and the slit where there is one."""
    scene = opening_scene(opening, distance_m, seed)
    info = zed_info(condition.configured_ke_per_m)
    frames = frames_of(scene, condition, seed, position_ned_m=(0.0, 0.0, -CAMERA_M), info=info)
    planes = model_of(frames, extractor_of(params)).planes.astype(np.float64)
    rows = []
    for size in sizes(frames[-1], planes):
        slit = abs(size.true_width_m - SLIT_M[0]) < 0.01
        name = "slit" if slit else opening
        row = OpeningRow(
            opening=name,
            condition=condition.name,
            method=mode_of(params),
            distance_m=distance_m,
            seed=seed,
            width_m=size.width_m,
            height_m=size.height_m,
            free_share=size.free_share,
        )
        rows.append(row if size.free_share > 0.0 else replace(row, width_m=0.0, height_m=0.0))
    return rows


def of(rows: list[OpeningRow], opening: str, condition: str, method: str, distance_m: float = 0.0) -> list[OpeningRow]:
    """The rows of one opening, at one distance or at all."""
    return [
        r
        for r in rows
        if (r.opening, r.condition, r.method) == (opening, condition, method) and (distance_m in (0.0, r.distance_m))
    ]


def span(values: list[float]) -> str:
    """Least, median and greatest."""
    return f"{min(values):.2f} / {middle(values):.2f} / {max(values):.2f}" if values else "-"


def conditions(rows: list[OpeningRow]) -> list[str]:
    """The conditions that were run."""
    return [c.name for c in CONDITIONS if any(r.condition == c.name for r in rows)]


def tables(rows: list[OpeningRow]) -> str:
    """Width and height over all distances and seeds, beside the truth and the paper's figures; then the slit."""
    lines = []
    for opening, (true, printed) in PRINTED_OPENINGS.items():
        lines.append([opening, "printed", "its drone", f"{printed[0]:g}", f"{printed[1]:g}", "-"])
        for condition in conditions(rows):
            for mode in MODES:
                mine = of(rows, opening, condition, mode)
                share = percent(middle([r.free_share for r in mine]), 0)
                widths, heights = [r.width_m for r in mine], [r.height_m for r in mine]
                lines.append(
                    [
                        f"{opening}, {true[0]:g} x {true[1]:g} m",
                        words(mode),
                        condition,
                        span(widths),
                        span(heights),
                        share,
                    ]
                )
    slits = []
    for condition in conditions(rows):
        for mode in MODES:
            mine = of(rows, "slit", condition, mode)
            filled = sum(r.free_share < 0.02 for r in mine)
            slits.append(
                [condition, words(mode), f"{filled} of {len(mine)}", percent(middle([r.free_share for r in mine]), 0)]
            )
    distances = ", ".join(f"{d:g}" for d in sorted({r.distance_m for r in rows}))
    return (
        f"Least / median / greatest over distances of {distances} m and {len({r.seed for r in rows})} seeds:\n\n"
        f"{table(['opening', 'model', 'depth', 'width, m', 'height, m', 'area left free, %'], lines, words=3)}\n\n"
        f"The slit of {SLIT_M[0]:g} x {SLIT_M[1]:g} m beside the window, which no vehicle can pass:\n\n"
        f"{table(['depth', 'model', 'filled', 'left free, %'], slits, words=2)}"
    )


def draw(rows: list[OpeningRow], path: Path) -> None:
    """Width and height of both openings over distance, medians, the paper's figures as black points."""
    with figure(path, 2, 2, width=10.5, height=6.4) as axes:
        for row, (opening, (true, printed)) in enumerate(PRINTED_OPENINGS.items()):
            for column, side in enumerate(("width", "height")):
                ax = axes[row][column]
                for mode in MODES:
                    for condition, style in zip(conditions(rows), ("-", "--", "-.", ":"), strict=False):
                        distances = sorted({r.distance_m for r in of(rows, opening, condition, mode)})
                        values = [
                            middle([float(getattr(r, f"{side}_m")) for r in of(rows, opening, condition, mode, d)])
                            for d in distances
                        ]
                        name = f"{words(mode)}, {condition}"
                        ax.plot(distances, values, f"o{style}", markersize=3, color=COLORS[mode], label=name)
                ax.axhline(true[column], color="black", linewidth=0.8, linestyle=":", label="true size")
                ax.axhline(printed[column], color="black", linewidth=0.8, label="printed: the paper's model")
                ax.set_ylim(bottom=-0.1, top=1.25 * true[column])
                label(ax, f"{opening}: {side}", "distance of the wall, m", f"{side} in the model, m", legend=False)
        axes[0][1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.02, 1.0))

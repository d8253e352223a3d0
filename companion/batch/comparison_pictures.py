"""Pictures of a comparison: an overview of the fleet, and a time line of each flight to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..viewer.png import new_figure, save_figure
from .comparison import FlightDifference, PairedFrames

MOST_CHARACTERS = 120
"""Of the path of a dataset in a title; of a longer one the end is shown."""
_A, _B, _LOST, _NEW, _BLIND = "#1565c0", "#ef6c00", "#c62828", "#6a1b9a", "#9e9e9e"


def draw_overview(datasets: tuple[str, str], flights: Sequence[FlightDifference], path: Path) -> None:
    """Four panels: planes per frame, blind time, lost and new obstacles, changed frames. datasets: where A and B are."""
    figure = new_figure(1100, 800, layout="constrained")
    figure.suptitle(_sides(datasets), fontsize=9, parse_math=False)
    planes, blind, obstacles, changed = figure.subplots(2, 2).ravel()
    mean_a = [f.planes_a / max(1, f.valid_a) for f in flights]
    mean_b = [f.planes_b / max(1, f.valid_b) for f in flights]
    _scatter(planes, mean_a, mean_b, "planes per valid frame")
    _scatter(blind, [f.blind_s_a for f in flights], [f.blind_s_b for f in flights], "blind time, s")
    frames = np.array([max(1, f.frames) for f in flights], float)
    for values, color, style, label in (
        ([f.missed for f in flights], _LOST, "o-", "missed: nearest plane lost or farther in B"),
        ([f.phantom for f in flights], _NEW, "--", "phantom: nearest plane new or nearer in B"),
    ):
        shares = 100.0 * np.sort(np.array(values) / frames)[::-1]
        obstacles.plot(np.arange(1, len(shares) + 1), shares, style, color=color, label=label, clip_on=False)
    obstacles.set(title="missed and phantom obstacles", xlabel="number of the flight, sorted", ylabel="% of frames")
    obstacles.set_ylim(-0.02, max(1.0, obstacles.get_ylim()[1]))
    obstacles.xaxis.get_major_locator().set_params(integer=True)
    obstacles.legend(fontsize=8)
    changed.hist(100.0 * np.array([f.changed for f in flights]) / frames, bins=20, range=(0, 100), color=_B)
    changed.set(title="frames whose result changed", xlabel="% of frames", ylabel="flights")
    save_figure(figure, path)


def _scatter(axes: Any, a: Sequence[float], b: Sequence[float], title: str) -> None:
    most = max([*a, *b, 1.0]) * 1.05
    axes.plot([0, most], [0, most], color=_BLIND, linewidth=1)
    axes.scatter(a, b, s=14, color=_B, alpha=0.7, clip_on=False)
    axes.set(title=title, xlabel="A", ylabel="B", xlim=(0, most), ylim=(0, most))


def draw_flight(datasets: tuple[str, str], flight: FlightDifference, frames: PairedFrames, path: Path) -> None:
    """The distance of the nearest plane and the number of planes over time, with marks where the answer changed."""
    figure = new_figure(1100, 600, layout="constrained")
    near, planes = figure.subplots(2, 1, sharex=True)
    t_ns = np.array([row["t_exposure_ns"] for row in frames.a], np.int64)
    t_s = (t_ns - t_ns[0]) / 1e9 if len(t_ns) else np.zeros(0)
    for rows, color, label in ((frames.a, _A, "A"), (frames.b, _B, "B")):
        near.plot(t_s, _column(rows, "nearest_m"), color=color, label=f"{label}: nearest plane", linewidth=1.2)
        planes.plot(t_s, _column(rows, "planes"), color=color, label=f"{label}: planes", linewidth=1.0)
        blind = t_s[[not row["valid"] for row in rows]]
        planes.plot(blind, np.zeros(len(blind)), "|", color=color, markersize=12, label=f"{label}: blind")
    for kinds, color, label in (
        (("missed", "newly_blind"), _LOST, "missed or newly blind"),
        (("phantom", "newly_valid"), _NEW, "phantom or newly valid"),
    ):
        at = t_s[[kind in kinds for kind in frames.kinds]]
        near.plot(at, np.full(len(at), 0.0), "^", color=color, label=f"{label}: {len(at)}")
    title = f"{flight.vehicle}/{flight.flight}: {flight.changed} of {flight.frames} frames changed"
    figure.suptitle(f"{title}\n{_sides(datasets)}", fontsize=9, parse_math=False)
    near.set(ylabel="distance, m")
    planes.set(ylabel="planes", xlabel="s of the flight")
    for axes in (near, planes):
        axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, frameon=False)
        axes.set_ylim(bottom=-0.04 * axes.get_ylim()[1])  # marks at 0 are whole
    save_figure(figure, path)


def _sides(datasets: tuple[str, str]) -> str:
    """Where A and B are, a line each."""
    ends = [name if len(name) <= MOST_CHARACTERS else f"...{name[-MOST_CHARACTERS:]}" for name in datasets]
    return f"A: {ends[0]}\nB: {ends[1]}"


def _column(rows: Sequence[dict[str, Any]], name: str) -> Any:
    return np.array([np.nan if row[name] is None else row[name] for row in rows], float)

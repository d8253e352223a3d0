"""Figure 13 a, b and the table of processing times: one pinned thread, runs interleaved, medians after warm-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.markdown import table
from benchmarks.paper.cases import (
    CAMERA,
    MODES,
    PRINTED,
    grid_name,
    held_out,
    named_frames,
    number,
    progress,
    zed_info,
)
from benchmarks.paper.forms import extractor_of, params_of
from benchmarks.paper.plots import COLORS, figure, label, words
from benchmarks.peers.cloud import cloud_of
from benchmarks.peers.grid_prisms import CELLS_M, GridPrisms, grid_prisms
from companion.bench.host_info import host_info
from companion.bench.timing import Clock, Times, one_core
from core.params import Params
from core.types import ExtractorState
from drivers.simulation.source import Rendered

SCENES = {"structured": "street", "foliage": "trees"}
STEPS = (1, 2, 3, 4, 6, 8, 12, 16)
QUICK_STEPS = (1, 4, 16)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeRow:
    """Milliseconds of one thing on one frame. method: safe, paper or a grid; step: sampling interval; size: of the
    image; cpu: of the thread, wall: of the clock; medians, standard deviation and 99th percentile of `runs`."""

    kind: str
    method: str
    step: int
    size: str
    cpu_ms: float
    cpu_sd_ms: float
    cpu_p99_ms: float
    wall_ms: float
    runs: int


def interleaved(jobs: list[Callable[[], Any]], runs: int, warm_up: int = 2) -> list[Times]:
    """Times of `runs` calls of each job, taken in turns so that a busy machine troubles all alike."""
    for job in jobs:
        for _ in range(warm_up):
            job()
    clocks = [Clock() for _ in jobs]
    for _ in range(runs):
        for clock, job in zip(clocks, jobs, strict=True):
            clock.run(job)
    return [clock.times() for clock in clocks]


def run(quick: bool) -> list[TimeRow]:
    """The extractor in both modes and at all intervals, and the grid at all cells, on a structured and a foliage frame."""
    found = []
    with one_core():
        for kind, name in SCENES.items():
            progress(f"times: {kind}")
            seed = held_out(1)[0]
            frame = named_frames(name, seed, CAMERA, count=1)[0]
            small = named_frames(name, seed, CAMERA, count=1, info=zed_info(0.0015))[0]
            jobs: list[tuple[str, int, str, Callable[[], Any]]] = [
                (mode, step, "640x480", extraction(frame, params_of(mode, column_step=step)))
                for mode in MODES
                for step in (QUICK_STEPS if quick else STEPS)
            ]
            jobs += [(mode, 1, "672x376", extraction(small, params_of(mode))) for mode in MODES]
            jobs += [(grid_name(cell), 1, "640x480", gridding(frame, cell)) for cell in CELLS_M]
            runs = 5 if quick else 30
            spent = interleaved([job for *_, job in jobs], runs)
            found += [
                _row(kind, method, step, size, times)
                for (method, step, size, _), times in zip(jobs, spent, strict=True)
            ]
    return found


def _row(kind: str, method: str, step: int, size: str, times: Times) -> TimeRow:
    return TimeRow(
        kind=kind,
        method=method,
        step=step,
        size=size,
        cpu_ms=times.cpu(),
        cpu_sd_ms=float(np.std(times.cpu_ms)),
        cpu_p99_ms=times.cpu(99.0),
        wall_ms=times.wall(),
        runs=len(times),
    )


def extraction(frame: Rendered, params: Params) -> Callable[[], Any]:
    """Depth to planes and prisms, with the ground and the noise of a frame before known."""
    extractor = extractor_of(params)
    _, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=ExtractorState())
    return lambda: extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=state)


def gridding(frame: Rendered, cell_m: float) -> Callable[[], Any]:
    """Depth to points above the ground (which is given) to polygons on a grid."""

    def job() -> GridPrisms:
        cloud = cloud_of(frame, CAMERA.ke_per_m)
        return grid_prisms(cloud.points_m, cloud.ground_z_m, cell_m)

    return job


def of(rows: list[TimeRow], kind: str, method: str, step: int = 1, size: str = "640x480") -> TimeRow | None:
    """One row, None where it was not run."""
    found = [r for r in rows if (r.kind, r.method, r.step, r.size) == (kind, method, step, size)]
    return found[0] if found else None


def tables(rows: list[TimeRow]) -> str:
    """What the paper printed, then ours."""
    lines = [
        ["printed", "OSAPE, C++11, i7-8700K", "640x480", number(PRINTED["osape_ms"], 1), "3.0", "-", "-"],
        ["printed", "3DP, 0.1 m", "640x480", number(PRINTED["grid_0.1_ms"], 1), "-", "-", "-"],
        ["printed", "3DP, 0.8 m", "640x480", number(PRINTED["grid_0.8_ms"], 1), "-", "-", "-"],
        ["printed", "OSAPE on the drone", "672x376", number(PRINTED["drone_ms"], 0), "-", "-", "-"],
    ]
    for r in rows:
        if r.step == 1:
            times = [number(t, 1) for t in (r.cpu_ms, r.cpu_sd_ms, r.cpu_p99_ms, r.wall_ms)]
            lines.append([r.kind, words(r.method), r.size, *times])
    by_step = []
    for step in sorted({r.step for r in rows}):
        found = [of(rows, kind, mode, step) for kind in SCENES for mode in MODES]
        by_step.append([str(step), *("-" if r is None else number(r.cpu_ms, 1) for r in found)])
    runs = max((r.runs for r in rows), default=0)
    named = [f"{kind}, {words(mode)}" for kind in SCENES for mode in MODES]
    head = ["frame", "what", "image", "ms", "± sd", "99 %", "wall, ms"]
    return (
        f"{host_info().text()}; one thread on one core, medians of {runs} interleaved runs after warm-up, CPU time of the thread "
        f"(the last column: by the clock):\n\n{table(head, lines, words=3)}\n\nCPU ms over the sampling interval:\n\n"
        f"{table(['every n-th column', *named], by_step)}"
    )


def draw(rows: list[TimeRow], path: Path) -> None:
    """Time over the grid's cell, ours as lines across, the paper's figures as black points; time over the interval."""
    with figure(path, 1, 2) as axes:
        a, b = axes[0]
        for kind, style in zip(SCENES, ("-", "--"), strict=True):
            grids = [(cell, of(rows, kind, grid_name(cell))) for cell in CELLS_M]
            xy = [(cell, r.cpu_ms) for cell, r in grids if r is not None]
            a.plot(*zip(*xy, strict=True), f"o{style}", markersize=3, color=COLORS["grid 0.1 m"], label=f"grid, {kind}")
            for mode in MODES:
                r = of(rows, kind, mode)
                if r is not None:
                    a.axhline(
                        r.cpu_ms, color=COLORS[mode], linestyle=style, linewidth=1.2, label=f"{words(mode)}, {kind}"
                    )
                curve = [(s, of(rows, kind, mode, s)) for s in sorted({r.step for r in rows})]
                points = [(s, r.cpu_ms) for s, r in curve if r is not None]
                name = f"{words(mode)}, {kind}"
                b.plot(*zip(*points, strict=True), f"o{style}", markersize=3, color=COLORS[mode], label=name)
        printed = [PRINTED["grid_0.1_ms"], PRINTED["grid_0.8_ms"]]
        a.plot([0.1, 0.8], printed, "k^", markersize=6, label="printed: 3DP")
        error = PRINTED["osape_sd_ms"]
        for ax, x in ((a, 0.45), (b, 1.0)):
            ax.errorbar(
                [x], [PRINTED["osape_ms"]], yerr=[error], fmt="ks", markersize=4, capsize=3, label="printed: OSAPE"
            )
        a.set_yscale("log")
        a.set_ylim(top=3000.0)
        b.set_ylim(bottom=0.0)
        label(a, "time of a frame, 640x480", "grid cell, m", "CPU time, ms")
        label(b, "time over the sampling interval", "every n-th column", "CPU time, ms")

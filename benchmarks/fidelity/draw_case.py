"""Pictures of cases of the fidelity run: which rays are missed, phantom or stopped in the open, and by what.

Run `python -m benchmarks.fidelity.draw_case --scenes trees --tilts 0:-30 --ke 0.005 --seed 103 --out FOLDER`; it takes the
options of benchmarks.fidelity.run. One PNG a case."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.case import frames_of, model_of, true_rays
from benchmarks.fidelity.metrics import Rays, Verdict, judge, score
from benchmarks.fidelity.result import Case
from benchmarks.fidelity.run import asked, parse
from benchmarks.paper.plots import figure
from core.extractor import Extractor
from core.types import FrameModel
from drivers.simulation.source import Rendered

MISSED, PHANTOM, STOPPED, GROUND = (0.85, 0.0, 0.0), (0.85, 0.0, 0.85), (0.35, 0.55, 1.0), (0.8, 0.76, 0.7)


def draw_case(case: Case, extractor: Extractor, path: Path, count: int) -> None:
    """Draws the true view, the view of the model, the verdict on each ray and the plan from above as one PNG, of the
    last of `count` frames, as the fidelity run scores it."""
    frames = frames_of(case, count)
    model, last = model_of(frames, extractor), frames[-1]
    rays = true_rays(case, last, extractor.params.min_obstacle_height_m)
    planes, margins = model.planes.astype(np.float64), model.margin_m.astype(np.float64)
    verdict = judge(last, rays, planes, margins)
    s = score(last, rays, planes, margins, verdict)
    with figure(path, 2, 2, 13.0, 9.6) as axes:
        (truth, noisy), (judged, plan) = axes
        truth.imshow(_depth(last.truth.depth_m, last.truth.drawn_ground))
        truth.set_title(case.name, fontsize=9)
        noisy.imshow(_depth(last.depth_mm / 1000.0, np.zeros(last.depth_mm.shape, np.bool_)))
        seen = f"ground {model.ground.height_m:.2f} m" if model.ground.seen else "no ground"
        noisy.set_title(f"delivered; {seen}, ke {model.ke_per_m:.4f}, {model.stats.strips} strips", fontsize=9)
        judged.imshow(_judged(rays, verdict))
        judged.set_title(
            f"missed {100 * s.missed:.2f} % (red), phantom {100 * s.phantom:.2f} %, open {100 * s.phantom_open:.2f} % "
            f"(magenta), open stopped {100 * s.open_stopped:.1f} % (blue), mean {s.mean_m:.3f} m, {s.planes} planes",
            fontsize=8,
        )
        _plan(plan, last, rays, model)
        for ax in (truth, noisy, judged):
            ax.axis("off")


def _depth(depth_m: NDArray[np.float64], ground: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(H, W, 3) colours by disparity; white: nothing."""
    from matplotlib import colormaps

    with np.errstate(divide="ignore"):
        near = np.clip(4.0 / depth_m, 0.0, 1.0)
    image = np.asarray(colormaps["turbo"](near)[..., :3])
    image[~np.isfinite(depth_m) | (depth_m <= 0.0)] = 1.0
    image[ground] = 0.3 * image[ground] + 0.6
    return image


def _judged(rays: Rays, verdict: Verdict) -> NDArray[np.float64]:
    """(H, W, 3): obstacle rays grey, darker where the model stops them; faults in their colours."""
    image = np.ones((*rays.obstacle.shape, 3))
    image[rays.open & np.isfinite(rays.range_m)] = GROUND
    image[rays.solid] = 0.75
    image[rays.obstacle] = 0.6
    image[rays.obstacle & np.isfinite(verdict.stop_m)] = 0.4
    image[verdict.open_stopped] = STOPPED
    image[verdict.phantom] = PHANTOM
    image[verdict.missed] = MISSED
    return image


def _plan(ax: Any, frame: Rendered, rays: Rays, model: FrameModel) -> None:
    """True obstacle points (grey) and planes (blue) from above, forward upwards."""
    points = frame.truth.points_level_cam_m[rays.obstacle][::7]
    ax.plot(points[:, 1], points[:, 0], ",", color="#999999")
    for a_x, a_y, b_x, b_y, *_ in model.planes.tolist():
        ax.plot([a_y, b_y], [a_x, b_x], "-", color="#1f77b4", linewidth=1.0)
    ax.set_aspect("equal")
    ax.set_xlim(-12.0, 12.0)
    ax.set_ylim(-0.5, 20.0)
    ax.grid(alpha=0.3)


def main(arguments: list[str] | None = None) -> int:
    """Draws the requested cases."""
    own = argparse.ArgumentParser(add_help=False)  # the other arguments are those of the run
    own.add_argument("--out", type=Path, default=Path("bench-out"))
    mine, others = own.parse_known_args(arguments)
    args = parse(others)
    mine.out.mkdir(parents=True, exist_ok=True)
    extractor = Extractor(args.params)
    for case in asked(args):
        name = case.name.replace(" ", "_").replace("/", "_")
        path = mine.out / f"case_{name}.png"
        draw_case(case, extractor, path, args.frames)
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The fidelity figures on scenes with known truth: one row a scene, tilt and noise, then the worst of each.

Run `python -m benchmarks.fidelity --quick`, or with --scenes, --tilts, --ke, --seeds, --heights. Progress
goes to stderr, the table to stdout, all figures to --json FILE."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from benchmarks.grid_prisms import CELLS_M, grid_prisms, obstacle_points
from benchmarks.metrics import NAN, PLANE_BYTES, Rays, distances, rays_of, recall, score
from benchmarks.openings import in_view, opening_size
from benchmarks.report import print_report
from benchmarks.rows import Case, GridScore, Row
from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState, FrameModel
from drivers.scene_library import SCENES, make_scene
from drivers.sensor_model import PERFECT, TYPICAL
from drivers.simulated import Rendered, camera_info, render

FAMILIES = {
    "structured": ("wall", "corner", "street", "alley", "gable", "window", "tunnel", "cylinder_trapezoid_sphere"),
    "unstructured": ("trees", "stones", "mixture"),
    "thin": ("poles", "wires"),
    "ground": ("open", "slope", "ramp", "no_ground"),
}
TILTS_DEG = ((0, 0), (10, 0), (-10, 0), (0, 10), (0, -10), (30, 0), (-30, 0), (0, 30), (0, -30))
QUICK_TILTS_DEG = ((0, 0), (30, 0), (0, -30))
QUICK_SCENES = ("wall", "window", "street", "trees", "mixture", "poles", "open")
HIGHEST_M = {"tunnel": 2.2}
"""Scenes with a ceiling: the camera stays below it."""


def family_of(scene: str) -> str:
    """The family of a scene, by its name."""
    return next((family for family, names in FAMILIES.items() if scene in names), "other")


def frames_of(case: Case, count: int) -> list[Rendered]:
    """`count` frames of a case that differ in their noise only."""
    ke = case.ke_per_m
    sensor = replace(TYPICAL if case.faults else PERFECT, ke_per_m=ke).scaled_to(case.width)
    info = camera_info(case.width, case.width * 3 // 4, ke_per_m=case.told_per_m)
    scene = make_scene(case.scene, case.seed)
    height = min(case.height_m, HIGHEST_M.get(case.scene, math.inf))
    roll, pitch = math.radians(case.roll_deg), math.radians(case.pitch_deg)
    return [
        render(
            scene,
            info,
            roll_rad=roll,
            pitch_rad=pitch,
            position_ned_m=(0.0, 0.0, -height),
            sensor=sensor,
            seed=case.seed,
            frame=frame,
        )
        for frame in range(count)
    ]


def run_case(case: Case, params: Params, extractor: Extractor, frames: int = 2, grids: bool = True) -> Row:
    """Models a case and scores its last frame; the state goes on from frame to frame, as in flight."""
    rendered = frames_of(case, frames)
    state = ExtractorState()
    for r in rendered:
        model, state = extractor.extract(r.depth_mm, r.info, r.R_level_optical, state=state, keep_strips=False)
    last = rendered[-1]
    blind_px = TYPICAL.scaled_to(case.width).blind_left_px if case.faults else 0
    rays = rays_of(last, case.ke_per_m, params.min_obstacle_height_m, blind_px)
    planes = model.planes.astype(np.float64)
    return Row(
        case=case,
        family=family_of(case.scene),
        valid=model.valid,
        score=score(last, rays, planes, model.margin_m.astype(np.float64)),
        bytes=prism_bytes(model),
        plane_bytes=PLANE_BYTES * len(planes),
        prisms=len(model.prisms),
        ground_height_m=model.ground.height_m if model.ground.seen else NAN,
        ke_estimate_per_m=model.ke_per_m,
        grids=grid_scores(last, rays, case.ke_per_m) if grids else [],
        openings=[opening_size(o, last, planes) for o in last.scene.openings if in_view(o, last)],
        recall=recall(last, rays, planes),
    )


def prism_bytes(model: FrameModel) -> int:
    """Storage of a frame's prisms: two float32 a vertex, two heights a prism."""
    return sum(8 * len(p.vertices_m) + 8 for p in model.prisms)


def grid_scores(frame: Rendered, rays: Rays, ke_per_m: float) -> list[GridScore]:
    """The grid baseline at all its cell sizes."""
    points = frame.truth.points_level_cam_m[rays.obstacle]
    noisy = obstacle_points(frame, ke_per_m)
    exact_mm = np.where(frame.truth.depth_m <= frame.info.max_range_m, 1000.0 * frame.truth.depth_m, 0.0)
    exact = obstacle_points(replace(frame, depth_mm=np.rint(exact_mm).astype(np.uint16)), 0.0)
    ground_z = frame.scene.ground.z_m - float(frame.position_ned_m[2])
    found = []
    for cell in CELLS_M:
        model, perfect = grid_prisms(noisy, ground_z, cell), grid_prisms(exact, ground_z, cell)
        errors = [float(distances(points, m.planes).mean()) if len(points) else NAN for m in (model, perfect)]
        found.append(
            GridScore(
                cell_m=cell, planes=len(model.planes), bytes=model.bytes, mean_m=errors[0], perfect_mean_m=errors[1]
            )
        )
    return found


def cases(args: argparse.Namespace) -> Iterator[Case]:
    """The cases that the command line asks for."""
    for scene in args.scenes:
        for ke in args.ke:
            for told in args.told or [ke]:
                for roll, pitch in args.tilts:
                    for height in args.heights:
                        for seed in range(args.seeds):
                            yield Case(
                                scene=scene,
                                roll_deg=roll,
                                pitch_deg=pitch,
                                ke_per_m=ke,
                                told_per_m=told,
                                height_m=height,
                                seed=seed,
                                faults=not args.no_faults,
                                width=args.width,
                            )


def _floats(text: str) -> list[float]:
    return [float(part) for part in text.split(",")]


def _tilts(text: str) -> list[tuple[float, float]]:
    """'0:0,30:0' -> [(0, 0), (30, 0)]: roll and pitch in degrees."""
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise argparse.ArgumentTypeError("expected roll:pitch pairs in degrees, such as 0:0,30:0")
    return [(float(roll), float(pitch)) for roll, pitch in pairs]


def _scenes(text: str) -> list[str]:
    names = [n for part in text.split(",") for n in FAMILIES.get(part, (part,))]
    unknown = [n for n in names if n not in SCENES]
    if unknown:
        raise argparse.ArgumentTypeError(f"no scene {unknown[0]!r}; there are {', '.join([*FAMILIES, *SCENES])}")
    return names


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    everything = [n for names in FAMILIES.values() for n in names]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fidelity", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="seven scenes, three tilts, one noise")
    parser.add_argument("--scenes", type=_scenes, help="names or families, separated by commas")
    parser.add_argument("--tilts", type=_tilts, help="roll:pitch pairs in degrees, e.g. 0:0,30:0,0:-30")
    parser.add_argument("--ke", type=_floats, help="noise, sigma = ke Z^2, e.g. 0.0015,0.005")
    parser.add_argument("--told", type=_floats, help="noise told to the method; default: the true one")
    parser.add_argument("--heights", type=_floats, default=[2.0], help="of the camera above the ground, m")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--frames", type=int, default=2, help="frames in a row, the last of which is scored")
    parser.add_argument("--width", type=int, default=640, help="image width; the height is 3/4 of it")
    parser.add_argument("--mode", choices=("safe", "paper"), default="safe")
    parser.add_argument("--no-faults", action="store_true", help="noise only: no holes, mismatches, flying pixels")
    parser.add_argument("--no-grids", action="store_true", help="without the grid baseline")
    parser.add_argument("--json", type=Path, help="write every figure there")
    args = parser.parse_args(arguments)
    args.scenes = args.scenes or (list(QUICK_SCENES) if args.quick else everything)
    args.tilts = args.tilts or list(QUICK_TILTS_DEG if args.quick else TILTS_DEG)
    args.ke = args.ke or ([0.0015] if args.quick else [0.0015, 0.005])
    return args


def main(arguments: list[str] | None = None) -> int:
    """Runs the cases, prints the table and writes the JSON."""
    args = parse(arguments)
    params = Params(mode=args.mode)
    extractor = Extractor(params)
    todo, rows = list(cases(args)), []
    for i, case in enumerate(todo):
        tilt = f"{case.roll_deg:+.0f}/{case.pitch_deg:+.0f}"
        print(
            f"\r{i + 1}/{len(todo)} {case.scene} {tilt} ke {case.ke_per_m:g}        ",
            end="",
            file=sys.stderr,
            flush=True,
        )
        rows.append(run_case(case, params, extractor, args.frames, not args.no_grids))
    print(file=sys.stderr)
    print_report(rows)
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

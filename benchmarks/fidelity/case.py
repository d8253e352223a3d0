"""One case of the fidelity run: its frames, the model of the last of them, and all figures of that model."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from benchmarks.fidelity.free_truth import false_free
from benchmarks.fidelity.metrics import NAN, PLANE_BYTES, Rays, distances, judge, range_counts, rays_of, recall, score
from benchmarks.fidelity.openings import in_view, opening_size
from benchmarks.fidelity.result import Case, GridScore, Row
from benchmarks.peers.grid_prisms import CELLS_M, grid_prisms, obstacle_points
from benchmarks.scenes.catalogue import camera_pose, family_of, make_scene
from core.extractor import Extractor
from core.types import ExtractorState, FrameModel
from drivers.simulation.sensor_model import PERFECT, TYPICAL, SensorModel, measure
from drivers.simulation.source import Rendered, camera_info, render

FAULTS: dict[str, SensorModel] = {
    "none": PERFECT,
    "dropout": replace(PERFECT, dropout_share=TYPICAL.dropout_share),
    "holes": replace(PERFECT, holes=TYPICAL.holes),
    "mismatches": replace(PERFECT, mismatch_share=TYPICAL.mismatch_share),
    "flying": replace(PERFECT, flying_share=TYPICAL.flying_share),
    "all": TYPICAL,
    "white": replace(TYPICAL, noise_length_px=0.0),
    "smeared": replace(PERFECT, smear_px=9.0),
    "hidden": replace(TYPICAL, baseline_m=0.12),
}
"""Image faults besides noise, single and combined: 5 % dropout, blob holes, 0.2 % of 2x2 mismatches, flying pixels at
depth edges. "all" also lacks the left columns that the second imager does not see; these are not scored. "white": as
"all", with noise that is independent between pixels. "smeared": noise and ramped edges like those of a D435. "hidden": as "all",
without what the second imager, 0.12 m to the right, does not see beside near things."""


FRAMES = 4
"""Of a case, the last of which is scored: what the noise over time takes to be measured once."""


@functools.lru_cache(maxsize=2)
def _exact(scene: str, seed: int, roll_deg: float, pitch_deg: float, height_m: float, width: int) -> Rendered:
    """The exact view of a case: cases that differ in noise and faults only share it."""
    position, yaw = camera_pose(scene, seed, height_m)
    return render(
        make_scene(scene, seed),
        camera_info(width, width * 3 // 4),
        roll_rad=math.radians(roll_deg),
        pitch_rad=math.radians(pitch_deg),
        yaw_rad=yaw,
        position_ned_m=position,
    )


def frames_of(case: Case, count: int) -> list[Rendered]:
    """`count` frames of a case that differ in their noise only."""
    exact = _exact(case.scene, case.seed, case.roll_deg, case.pitch_deg, case.height_m, case.width)
    sensor = replace(FAULTS[case.faults], ke_per_m=case.ke_per_m).scaled_to(case.width)
    info = camera_info(case.width, case.width * 3 // 4, ke_per_m=case.configured_ke_per_m)
    return [
        replace(exact, info=info, depth_mm=measure(exact.truth.depth_m, info, sensor, case.seed, frame))
        for frame in range(count)
    ]


def model_of(frames: list[Rendered], extractor: Extractor) -> FrameModel:
    """The model of the last of some frames; the state is passed from frame to frame as in flight."""
    state = ExtractorState()
    for r in frames:
        model, state = extractor.extract(r.depth_mm, r.info, r.R_level_optical, state=state)
    return model


def true_rays(case: Case, frame: Rendered, min_height_m: float) -> Rays:
    """The true rays of a case's frame, without the columns that its camera never sees."""
    blind_px = FAULTS[case.faults].scaled_to(case.width).blind_left_px
    return rays_of(frame, case.ke_per_m, min_height_m, blind_px)


def run_case(case: Case, extractor: Extractor, frames: int = FRAMES, grids: bool = True) -> Row:
    """Models a case and scores its last frame."""
    rendered = frames_of(case, frames)
    model, last = model_of(rendered, extractor), rendered[-1]
    rays = true_rays(case, last, extractor.params.min_obstacle_height_m)
    planes, margins = model.planes.astype(np.float64), model.margin_m.astype(np.float64)
    verdict = judge(last, rays, planes, margins)
    return Row(
        case=case,
        family=family_of(case.scene),
        valid=model.valid,
        score=score(last, rays, planes, margins, verdict),
        by_range=range_counts(rays, verdict),
        false_free=false_free(model.free, rays, last.truth.points_level_cam_m),
        bytes=prism_bytes(model),
        plane_bytes=PLANE_BYTES * len(planes),
        prisms=len(model.prisms),
        ground_seen=model.ground.seen,
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

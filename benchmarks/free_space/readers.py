"""Checks the free points of `Space` and `WorldSpace` against the solids of random scenes.

`volume.py` checks the profile above the ground of the model. This module checks the queries themselves, for points of
radius 0, above and below that ground and beyond the edges of a roof that was detected as ground. The model is queried
in ned, which includes the transform of core/transformed.py."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import frame_space
from benchmarks.free_space.random_frames import RandomFrame
from benchmarks.free_space.volume import (
    SLACK_M,
    SLACK_SIGMAS,
    CellRays,
    cell_rays,
    first_solids,
    has_ground,
    heading_of,
)
from companion.pipeline.transform import LevelTransform, transform_model
from core.extractor import Extractor
from core.types import FrameModel
from drivers.simulation.source import Rendered
from osape_client.query.space import Occupancy, Space

Floats = NDArray[np.float64]
_STEP_M = 0.1
"""Distance between query points along a ray."""
_ANYWHERE = 1000
"""Number of additional random query points per frame."""
_AROUND = 8
"""Directions in which a free point must lie deep in a solid to be wrong."""


@dataclass(frozen=True, slots=True)
class ReaderCounts:
    """Of one frame: cells claimed by its profile, those with a ray that runs through free points into a solid, points
    answered FREE among those drawn anywhere, wrong ones of them; deepest_m: of the rays; where: of its first point in ned."""

    cells: int = 0
    wrong_cells: int = 0
    points: int = 0
    wrong_points: int = 0
    deepest_m: float = 0.0
    where: str = ""


def space_of(frame: Rendered, model: FrameModel) -> Space:
    """The reader of one frame, in ned."""
    x, y, z = (float(c) for c in frame.position_ned_m)
    return frame_space(transform_model(model, LevelTransform(heading_of(frame), (x, y, z))), (x, y, z))


def deep_in_solid(frame: Rendered, points: Floats, slack_m: Floats, least_m: float) -> NDArray[np.bool_]:
    """(N,) whether points (N, 3) of ned lie in a solid, and so do places slack_m (N,) around them at the same height."""
    deep = np.ones(len(points), np.bool_)
    for a in np.arange(_AROUND) * math.tau / _AROUND:
        to = np.tile([math.cos(a), math.sin(a), 0.0], (len(points), 1))
        for at in (np.zeros(len(points)), slack_m):
            _, which = first_solids(frame.scene, has_ground(frame.scene), points, to, at, at, least_m)
            deep &= which != -2
    return deep


def judge_readers(r: RandomFrame, extractor: Extractor) -> ReaderCounts:
    """Judges what `Space` answers over the claimed cells of one frame, and at points drawn anywhere around its camera."""
    frame, least_m = r.frame, extractor.params.min_obstacle_height_m
    model, _ = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical)
    if not model.valid:
        return ReaderCounts()
    space = space_of(frame, model)
    rays = cell_rays(frame, model)
    wrong, deepest_m, where = (np.zeros(0, np.int64), 0.0, "") if rays is None else _wrong_rays(r, space, rays, least_m)
    points = _anywhere(r, model)
    free = points[space.points(points) == Occupancy.FREE]
    range_m = np.hypot(*(free - frame.position_ned_m)[:, :2].T)
    bad = deep_in_solid(frame, free, np.fmax(SLACK_M, SLACK_SIGMAS * r.ke_per_m * range_m**2), least_m)
    if bad.any() and not where:
        where = f"at {free[bad][0].round(2)}"
    return ReaderCounts(
        0 if rays is None else rays.cells, len(np.unique(wrong)), len(free), int(bad.sum()), deepest_m, where
    )


def _wrong_rays(r: RandomFrame, space: Space, rays: CellRays, least_m: float) -> tuple[NDArray[np.int64], float, str]:
    """(cells (N,) of wrong rays, greatest depth, description of the first wrong point). A ray is wrong where
    consecutive free points lie deeper in a solid than the slack."""
    scene, drawn = r.frame.scene, has_ground(r.frame.scene)
    ends = np.minimum(rays.ends, rays.inside_to_m)  # beyond, what enters the layer is lower than a pixel
    hit_m, _ = first_solids(scene, drawn, rays.origins, rays.directions, rays.begins, ends, least_m)
    wrong, deepest_m, where = [], 0.0, ""
    # a ray that meets no solid, or only at its very end, cannot be wrong wherever the ground cuts it
    for i in np.flatnonzero(hit_m < ends - SLACK_M):
        at = np.arange(rays.begins[i] + 1e-3, ends[i], _STEP_M)
        points = rays.origins[i] + at[:, None] * rays.directions[i]
        free = space.points(points) == Occupancy.FREE
        edge = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
        for first, end in zip(edge[0::2], edge[1::2], strict=True):
            begin_m, end_m = at[first : first + 1], at[end - 1 : end]
            ray = rays.origins[i : i + 1], rays.directions[i : i + 1]
            solid_m, _ = first_solids(scene, drawn, *ray, begin_m, end_m, least_m)
            depth_m = max(float(rays.optical_depth(i, float(solid_m[0]))), 0.0) if np.isfinite(solid_m[0]) else 0.0
            slack_m = max(SLACK_M, SLACK_SIGMAS * r.ke_per_m * depth_m * float(np.nan_to_num(solid_m[0], posinf=0.0)))
            if solid_m[0] < end_m[0] - slack_m:
                wrong.append(int(rays.cell[i]))
                deepest_m = max(deepest_m, float(end_m[0] - solid_m[0]))
                where = where or f"at {points[end - 1].round(2)}, {end_m[0] - solid_m[0]:.2f} m deep"
    return np.array(wrong, np.int64), deepest_m, where


def _anywhere(r: RandomFrame, model: FrameModel) -> Floats:
    """(_ANYWHERE, 3) points of ned around the camera, to the range and the heights of its profile."""
    rng = np.random.Generator(np.random.PCG64([r.camera.seed, r.number, 2]))
    reach = 1.1 * r.frame.info.max_range_m
    layers = model.free.layer_edges_m.astype(np.float64)
    low = np.array([-reach, -reach, layers[0]])
    return np.asarray(r.frame.position_ned_m + rng.uniform(low, [reach, reach, layers[-1]], (_ANYWHERE, 3)))

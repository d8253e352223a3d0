"""How much of one frame's model is found again in the next one's.

Both models stand in one frame that does not move (`ned`). The planes of the first are covered with points, each for its
bit of area. Of those that the next exposure has in its image and range, a point is *found again* when some plane of the
next model lies within `reach_m` of it, in any direction. The share is taken once by area (a square metre far away counts as
one nearby) and once by the first camera's view (by solid angle: what looks large counts much). Parts that nearer things
hide from the next exposure count as lost: over a tenth of a second these are few."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import distances
from core.types import CameraInfo

STEP_M = 0.1
BORDER_PX = 8.0
"""Points this close to the image's border are not evaluated: strips are incomplete there."""
RANGE_SHARE = 0.95
"""Nor so close to the maximum range, where noise decides what is measured."""

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Seen:
    """A model and the camera that saw it. planes: (N, 6) a_x, a_y, b_x, b_y, top, bottom and position_m (3,) in ned;
    R_ned_optical: (3, 3)."""

    planes: Floats
    info: CameraInfo
    R_ned_optical: Floats
    position_m: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Shares of what could be found again (nan: nothing could), and the area of that, m^2."""

    by_area: float
    by_view: float
    area_m2: float


def found_again(first: Seen, following: Seen, reach_m: float) -> Found:
    """How much of the first model is found again in the following one."""
    points, area, normals = covered(first.planes)
    asked = in_image(points, following)
    points, area, normals = points[asked], area[asked], normals[asked]
    if not len(points):
        return Found(by_area=math.nan, by_view=math.nan, area_m2=0.0)
    ray = points - first.position_m
    range_m = np.maximum(np.linalg.norm(ray, axis=1), 1e-3)
    view = area * np.abs((ray * normals).sum(axis=1)) / range_m**3
    again = distances(points, following.planes) <= reach_m if len(following.planes) else np.zeros(len(points), np.bool_)
    seen = float(view.sum())
    return Found(
        by_area=float(area[again].sum() / area.sum()),
        by_view=float(view[again].sum()) / seen if seen > 0.0 else math.nan,
        area_m2=float(area.sum()),
    )


def covered(planes: Floats, step_m: float = STEP_M) -> tuple[Floats, Floats, Floats]:
    """(P, 3) points at most a step apart, the area (P,) that each represents, and its plane's normal (P, 3)."""
    points, areas, normals = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros((0, 3))]
    for a_x, a_y, b_x, b_y, top, bottom in planes.tolist():
        length, height = math.hypot(b_x - a_x, b_y - a_y), bottom - top
        if length <= 0.0 or height <= 0.0:
            continue
        across, down = math.ceil(length / step_m), math.ceil(height / step_m)
        t, z = np.meshgrid((np.arange(across) + 0.5) / across, top + height * (np.arange(down) + 0.5) / down)
        points.append(np.stack([a_x + t * (b_x - a_x), a_y + t * (b_y - a_y), z], axis=-1).reshape(-1, 3))
        areas.append(np.full(across * down, length * height / (across * down)))
        normals.append(np.tile([(a_y - b_y) / length, (b_x - a_x) / length, 0.0], (across * down, 1)))
    return np.concatenate(points), np.concatenate(areas), np.concatenate(normals)


def in_image(points_m: Floats, seen: Seen) -> Mask:
    """(P,) whether the camera has the point in its image, off the border, and well within its range."""
    k = seen.info.intrinsics
    optical = (points_m - seen.position_m) @ seen.R_ned_optical
    z = optical[:, 2]
    within = (z >= seen.info.min_range_m) & (z <= RANGE_SHARE * seen.info.max_range_m)
    depth = np.where(within, z, 1.0)
    u, v = k.fx * optical[:, 0] / depth + k.cx, k.fy * optical[:, 1] / depth + k.cy
    inside_u = (u >= BORDER_PX) & (u <= k.width - 1 - BORDER_PX)
    return np.asarray(within & inside_u & (v >= BORDER_PX) & (v <= k.height - 1 - BORDER_PX))

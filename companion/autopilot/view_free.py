"""The model of one camera as a function of places around the vehicle: which are free, and where a measured obstacle
ends the view.

Places are given in `level` at the moment of sending: origin of frd, x along the vehicle's heading, y right, z down."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.params import Params
from core.types import FrameModel, FreeEnd, Intrinsics

from ..pipeline.transform import LevelTransform

EDGE_SHARE = 0.05
"""Share of the image's width and height on each side that is left out."""
RING_M = Params().profile_ring_m
"""Default of [extractor] profile_ring_m."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Model of one camera in level at the moment of sending."""

    model: FrameModel
    transform: LevelTransform  # from the camera's level frame
    intrinsics: Intrinsics | None = None  # of the camera; None: not known
    R_optical_level: NDArray[np.float64] | None = None  # (3, 3) direction of the camera; None: not known
    ring_m: float = RING_M  # step of its free-range profile
    # sectors count open space as free. The memories of obstacles and of free space, and the guard, never do.
    open_counts: bool = False
    t_ns: int = 0  # exposure of the frame

    @property
    def place_m(self) -> tuple[float, float, float]:
        """Place (x, y, z) of the camera, from which its ranges are measured."""
        return self.transform.translation_m


def ground_z_m(view: View, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns z in level of the ground that this view found, at places x, y of any shape; inf if it found none."""
    ground = view.model.ground
    if not (view.model.valid and ground.seen):
        return np.full(np.shape(x), np.inf)
    cx, cy, cz = view.place_m
    out: NDArray[np.float64] = cz + ground.height_m + ground.slope_x * (x - cx) + ground.slope_y * (y - cy)
    return out


def ground_margin_m(view: View, range_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the height above the ground below which nothing is known, at a horizontal range from the camera, of the
    same shape.

    Pixels measured there count as ground. The profile excludes it from its layers, see
    core.stages.free_geometry.lowest_clear."""
    ground = view.model.ground
    return np.maximum(ground.tolerance_m, ground.noise_per_m * range_m)


def above_ground_share(
    view: View, x: NDArray[np.float64], y: NDArray[np.float64], height_m: float, range_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns the multiple of its length, (N,), up to which the ray to each place stays above the ground and its
    margin; inf: always.

    Args:
        view: model of a camera.
        x, y: (N,) places in level.
        height_m: their z relative to the camera.
        range_m: (N,) their horizontal range from the camera."""
    if not (view.model.valid and view.model.ground.seen):
        return np.full(len(x), np.inf)
    ground, (cx, cy, cz) = view.model.ground, view.place_m
    here = float(ground_z_m(view, np.array([cx]), np.array([cy]))[0]) - cz
    falls = height_m - ground.slope_x * (x - cx) - ground.slope_y * (y - cy)
    share = np.full(len(x), np.inf)
    for room_m, rate in ((here - ground.tolerance_m, falls), (here, falls + ground.noise_per_m * range_m)):
        # the camera is within the margin, as before take-off: only rays that rise out of it stay above
        end = np.where((room_m > 0.0) | (rate < 0.0), np.inf, 0.0)
        share = np.minimum(share, np.divide(max(room_m, 0.0), rate, out=end, where=rate > 0.0))
    return share


def in_image(view: View, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns the places of level, (N,), that lie in the image of a view, measured or not; all if its direction is
    not known.

    The outermost EDGE_SHARE is left out: the profile does not contain layers that are only partly in the image."""
    k = view.intrinsics
    if k is None or view.R_optical_level is None:
        return np.ones(len(x), bool)
    cx, cy, cz = view.place_m
    right, down, ahead = view.R_optical_level @ np.stack([x - cx, y - cy, z - cz])
    safe = np.maximum(ahead, 1e-6)
    u, v = k.fx * right / safe + k.cx, k.fy * down / safe + k.cy
    edge_u, edge_v = EDGE_SHARE * k.width, EDGE_SHARE * k.height
    out: NDArray[np.bool_] = (
        (ahead > 0.0) & (u > edge_u) & (u < k.width - 1 - edge_u) & (v > edge_v) & (v < k.height - 1 - edge_v)
    )
    return out


def _directions(
    view: View, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.intp], NDArray[np.float64]]:
    """Returns the directions of the profile for places.

    Returns:
        inside, of the shape of x: the profile has a direction for the place; for the M places inside, the index of
            the direction (M,) and the horizontal range from the camera (M,)."""
    cx, cy, _ = view.place_m
    edges = view.model.free.azimuth_edges_rad.astype(np.float64)
    # edges are not wrapped to one turn: the azimuth is taken within a turn from the first edge
    azimuth = edges[0] + np.mod(np.arctan2(y - cy, x - cx) - edges[0], math.tau)
    inside = azimuth < edges[-1]
    direction = np.searchsorted(edges, azimuth[inside], side="right") - 1
    return inside, direction, np.hypot(x[inside] - cx, y[inside] - cy)


def points_free(
    view: View,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    z: NDArray[np.float64],
    along_rays: bool = False,
    measured: bool = False,
) -> NDArray[np.bool_]:
    """Returns the points, (len(z), *x.shape), that the free-range profile of a view shows free. z: (heights,).

    A layer is free only from where all of it is in the image, which may be metres away for a tilted camera. With
    along_rays, a point is free also if its ray from the camera passes, at the point or behind it, through a part of
    any layer that was seen free, as long as the ray stays above the ground. Nothing is free below the ground, or less
    than `ground_margin_m` above it.

    Args:
        view: model of a camera.
        x, y: places in level, of one shape.
        z: (heights,).
        along_rays: see above.
        measured: open space does not count, even if the view has `open_counts`."""
    profile = view.model.free
    cz = view.place_m[2]
    inside, direction, range_m = _directions(view, x, y)
    lowest_m = ground_z_m(view, x[inside], y[inside]) - ground_margin_m(view, range_m)
    ray_ends = (
        [above_ground_share(view, x[inside], y[inside], height, range_m) for height in z - cz] if along_rays else []
    )
    layers = profile.layer_edges_m.astype(np.float64) - cz
    free = np.zeros((len(z), len(range_m)), bool)
    tables = [(profile.free_from_m, profile.free_to_m)]
    if view.open_counts and profile.has_open and not measured:
        tables.append((profile.open_from_m, profile.open_to_m))
    for from_m, to_m, row in ((a, b, row) for a, b in tables for row in np.flatnonzero((b > a).any(axis=0))):
        begins, ends = from_m[direction, row], to_m[direction, row]
        known = ends > begins
        for i, height_m in enumerate(z - cz):
            if along_rays:
                first, last = _share_of_ray(height_m, layers[row], layers[row + 1])
                if first > last:
                    continue
                last_m = np.minimum(last, ray_ends[i]) * range_m
                reached = np.maximum(np.maximum(begins, range_m), first * range_m) <= np.minimum(ends, last_m)
            elif layers[row] <= height_m < layers[row + 1]:
                reached = (begins <= range_m) & (range_m <= ends)
            else:
                continue
            free[i] |= known & reached
    free &= z[:, None] <= lowest_m
    out = np.zeros((len(z), *x.shape), bool)
    out[:, inside] = free
    return out


def _share_of_ray(height_m: float, top_m: float, bottom_m: float) -> tuple[float, float]:
    """Returns the multiples of its length between which the ray to a point at this height is in a layer; (inf, 0):
    never.

    All heights are relative to the camera, positive down."""
    if abs(height_m) < 1e-9:
        return (0.0, math.inf) if top_m <= 0.0 < bottom_m else (math.inf, 0.0)
    a, b = sorted((top_m / height_m, bottom_m / height_m))
    return (max(0.0, a), b) if b > 0.0 else (math.inf, 0.0)


def ended_by_obstacle(
    view: View, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Returns the places, (N,), before which the free range ends at a measured obstacle, or which belong to the
    measured ground.

    If a free range begins and ends at an obstacle, its pixels were measured: that obstacle is a plane of the model.
    If no free range begins although an obstacle was measured, pixels are missing; unless no ring before that obstacle
    has its whole layer in the image, in which case the profile does not decide.

    Args:
        view: model of a camera.
        x, y, z: (N,) places in level.
        share: (N,) multiple of the range to the place at which the last such ring may lie; 1 is the place itself."""
    out = np.zeros(len(x), bool)
    if not view.model.valid:
        return out
    profile, (cx, cy, _cz) = view.model.free, view.place_m
    edges = profile.layer_edges_m.astype(np.float64)
    inside, direction, range_m = _directions(view, x, y)
    row = np.searchsorted(edges, z[inside], side="right") - 1
    known = (row >= 0) & (row < len(edges) - 1)
    row = np.clip(row, 0, len(edges) - 2)
    begins, ends = profile.free_from_m[direction, row], profile.free_to_m[direction, row]
    tolerance_m = view.model.ground.tolerance_m  # at every range; within its noise nothing was seen, either
    by_obstacle = known & (profile.end[direction, row] == FreeEnd.OBSTACLE)
    behind = (ends > begins) & (range_m >= ends - 1e-3)
    last = share[inside]
    at_x, at_y = cx + last * (x[inside] - cx), cy + last * (y[inside] - cy)
    bottom = np.minimum(edges[row + 1], ground_z_m(view, at_x, at_y) - tolerance_m)
    whole = in_image(view, at_x, at_y, edges[row]) & in_image(view, at_x, at_y, bottom)
    out[inside] = by_obstacle & (behind | ((ends <= begins) & ~whole))
    return np.asarray(out | (z > ground_z_m(view, x, y) - tolerance_m))

"""Directions at the vehicle's own height: which are truly free, which the model calls free, which it closes by a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.free_space.volume import first_solids, has_ground, heading_of
from core.types import FrameModel
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
HALF_HEIGHT_M = 0.25
"""A direction is judged over this much above and below the camera."""
TO_M = 10.0
"""Up to this range."""
THERE_M, THERE_SIGMAS = 1.0, 3.0
"""A plane stands for a true surface within this distance of it, or within so much noise."""
_AZIMUTHS = 3
_ROUNDING_PX = 1e-3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Directions:
    """The judged directions of one frame. truly_free: (D,) no solid within TO_M; called_free: (D,) the profile says free up to
    TO_M; closed: (D,) a plane crosses it within TO_M; phantom: (D,) such a plane crosses it with no true surface near."""

    truly_free: Mask
    called_free: Mask
    closed: Mask
    phantom: Mask

    @property
    def false_stops(self) -> int:
        """Truly free directions closed by a plane that is not there."""
        return int((self.truly_free & self.phantom).sum())


def judged_azimuths(
    frame: Rendered, model: FrameModel, unmatched_left_px: int, unmatched_right_px: int = 0
) -> tuple[Floats, NDArray[np.int64]]:
    """(azimuths (D, 3) in level_cam, index of the direction in the profile (D,)) of the directions whose horizontal rays the
    camera sees, over their whole width, without those that reach into columns in which stereo never has a match."""
    edges = model.free.azimuth_edges_rad.astype(np.float64)
    if not model.valid:  # it has no profile
        edges = np.radians(np.linspace(-60.0, 60.0, 41))
    share = (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    azimuth = edges[:-1, None] + share * np.diff(edges)[:, None]
    whole = np.column_stack([edges[:-1], azimuth, edges[1:]])
    level = np.stack([np.cos(whole), np.sin(whole), np.zeros(whole.shape)], axis=-1)
    optical = level @ frame.R_level_optical
    k = frame.info.intrinsics
    ahead = optical[..., 2] > 1e-3
    z = np.where(ahead, optical[..., 2], 1.0)
    u, v = k.fx * optical[..., 0] / z + k.cx, k.fy * optical[..., 1] / z + k.cy
    # columns are as wide as a pixel around their centre
    first, last = unmatched_left_px - 0.5, k.width - unmatched_right_px - 0.5
    inside = ahead & (u >= first - _ROUNDING_PX) & (u <= last + _ROUNDING_PX) & (v >= 0) & (v < k.height)
    rows = np.flatnonzero(inside.all(axis=1))
    return azimuth[rows], rows


def truth(frame: Rendered, azimuth: Floats) -> Mask:
    """(D,) whether no solid and no ground stands in a direction within TO_M and HALF_HEIGHT_M."""
    heights = np.array([-HALF_HEIGHT_M, 0.0, HALF_HEIGHT_M])
    a, z = (x.ravel() for x in np.broadcast_arrays(azimuth[..., None], heights))
    heading = heading_of(frame) + a
    origins = np.tile(frame.position_ned_m, (len(a), 1))
    origins[:, 2] += z
    directions = np.stack([np.cos(heading), np.sin(heading), np.zeros(len(a))], axis=1)
    range_m, _ = first_solids(
        frame.scene, has_ground(frame.scene), origins, directions, np.zeros(len(a)), np.full(len(a), TO_M), 0.0
    )
    return np.asarray(~np.isfinite(range_m).reshape(len(azimuth), -1).any(axis=1))


def plane_ranges(planes: Floats, azimuth: Floats) -> Floats:
    """Range (N, M) at which horizontal rays of azimuths (M,) meet planes (N, 6) near the camera's height; inf: never."""
    p = np.asarray(planes, np.float64).reshape(-1, 6)
    c, s = np.cos(azimuth), np.sin(azimuth)
    ex, ey = (p[:, 2] - p[:, 0])[:, None], (p[:, 3] - p[:, 1])[:, None]
    ax, ay = p[:, 0][:, None], p[:, 1][:, None]
    determinant = ex * s - ey * c
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (ex * ay - ey * ax) / determinant
        along = (c * ay - s * ax) / determinant
        hit = (determinant != 0.0) & (r > 0.0) & (along >= 0.0) & (along <= 1.0)
    near = (p[:, 4] <= HALF_HEIGHT_M) & (p[:, 5] >= -HALF_HEIGHT_M)
    return np.where(hit & near[:, None], r, np.inf)


def judge_directions(frame: Rendered, model: FrameModel, unmatched_left_px: int = 0) -> Directions:
    """The directions of a frame against its truth. A model that is not valid calls nothing free and closes nothing."""
    azimuth, rows = judged_azimuths(frame, model, unmatched_left_px)
    free = truth(frame, azimuth)
    nothing = np.zeros(len(rows), np.bool_)
    if not model.valid:
        return Directions(truly_free=free, called_free=nothing, closed=nothing, phantom=nothing)
    layer = int(np.searchsorted(model.free.layer_edges_m, 0.0, side="right")) - 1
    to_m = model.free.free_to_m[rows, layer]
    called = (to_m > model.free.free_from_m[rows, layer]) & (to_m >= min(TO_M, 0.999 * frame.info.max_range_m))
    r = plane_ranges(model.planes.astype(np.float64), azimuth.ravel())
    flat = np.repeat(np.arange(len(rows)), _AZIMUTHS)
    plane, ray = np.nonzero(r < TO_M)
    closed, phantom = nothing.copy(), nothing.copy()
    closed[flat[ray]] = True
    solid = np.isfinite(frame.truth.depth_m) & ~frame.truth.drawn_ground
    surface = frame.truth.points_level_cam_m[solid]
    hits_r, a = r[plane, ray], azimuth.ravel()[ray]
    away = np.ones(len(ray), np.bool_)
    if len(surface) and len(ray):
        hits = np.stack([hits_r * np.cos(a), hits_r * np.sin(a), np.zeros(len(a))], axis=1)
        distance, _ = cKDTree(surface[:: max(1, len(surface) // 40_000)]).query(hits)
        away = distance > np.fmax(THERE_M, THERE_SIGMAS * frame.info.ke_per_m * hits_r**2)
    phantom[flat[ray[away]]] = True
    return Directions(truly_free=free, called_free=called, closed=closed, phantom=phantom)

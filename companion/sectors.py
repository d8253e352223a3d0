"""Distances around the vehicle in 72 sectors of 5 degrees, as OBSTACLE_DISTANCE wants them, from the models of cameras.

Everything here is in `level` at the moment of sending: origin of frd, x along the vehicle's heading, y right, z down.
Sector i is centred on i * 5 degrees clockwise from the nose. Each is one of three: an obstacle at a distance, seen to be
clear, or unseen; unseen is never clear.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical
from core.types import CameraInfo, FrameModel, Intrinsics

from .config_avoid import AvoidParams
from .reframe import LevelTransform

SECTORS = 72
STEP_RAD = math.tau / SECTORS
PARTS = 5
"""Of a sector, one degree each, by which it is told whether a camera looks into all of it."""
_EDGE_RAD = 1e-3
"""Not tuning: sectors overlap by so much, so that nothing falls between two of them."""


EDGE_SHARE = 0.05
"""Of the image's width and height on each side."""


class SectorState(IntEnum):
    """What is known of a sector."""

    UNSEEN = 0
    CLEAR = 1
    OBSTACLE = 2


@dataclass(frozen=True, slots=True, eq=False)
class SectorScan:
    """All (72,). state: uint8 SectorState. distance_m: float64 from the vehicle's hull to the nearest obstacle, inf where
    there is none. free_m: float64, how far from the vehicle's middle the sector was seen free, 0 where it was not.
    azimuth_rad: float64, direction of that nearest obstacle, the middle of the sector where there is none."""

    state: NDArray[np.uint8]
    distance_m: NDArray[np.float64]
    free_m: NDArray[np.float64]
    azimuth_rad: NDArray[np.float64]


Recall = Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]
"""Which places of level, x, y, z (N,), were seen free before and are looked at by nobody now."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One camera's model in level at the moment of sending. place_m: of the camera, where its ranges are counted from.
    intrinsics, R_optical_level: where its image looks in level; None: nobody knows."""

    model: FrameModel
    transform: LevelTransform
    intrinsics: Intrinsics | None = None
    R_optical_level: NDArray[np.float64] | None = None

    @property
    def place_m(self) -> tuple[float, float, float]:
        """x, y, z of the camera."""
        return self.transform.translation_m


def centres_rad() -> NDArray[np.float64]:
    """(72,) middles of the sectors, clockwise from the nose."""
    return np.arange(SECTORS, dtype=np.float64) * STEP_RAD


def scan(views: Sequence[View], avoid: AvoidParams, recall: Recall | None = None) -> SectorScan:
    """What the views say together: the nearest obstacle of any, free where any saw it free."""
    distance_m, azimuth_rad = np.full(SECTORS, np.inf), centres_rad()
    for view in views:
        if view.model.valid:
            distance, azimuth = plane_distances(view.model, avoid)
            azimuth_rad = np.where(distance < distance_m, azimuth, azimuth_rad)
            distance_m = np.minimum(distance_m, distance)
    distance_m = np.maximum(0.0, distance_m - avoid.radius_m)
    free_m, clear = seen_free(views, avoid, recall)
    state = np.where(clear, SectorState.CLEAR, SectorState.UNSEEN).astype(np.uint8)
    state[distance_m < avoid.max_distance_m] = SectorState.OBSTACLE
    return SectorScan(state, distance_m, free_m, azimuth_rad)


def plane_distances(model: FrameModel, avoid: AvoidParams) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(72,) horizontal distance from the origin to the nearest point of any plane in each sector, less the plane's
    margin, inf where there is none; (72,) azimuth of that point. Only planes that reach into the vehicle's band of
    height count."""
    planes = model.planes.astype(np.float64)
    inside = (planes[:, 4] < avoid.band_below_m) & (planes[:, 5] > -avoid.band_above_m)
    if not inside.any():
        return np.full(SECTORS, np.inf), centres_rad()
    distance, azimuth = segment_distances(planes[inside, 0:2], planes[inside, 2:4])
    distance -= model.margin_m[inside, None]
    nearest = distance.argmin(axis=0), np.arange(SECTORS)
    return distance[nearest].clip(0.0), azimuth[nearest]


def segment_distances(
    a_m: NDArray[np.float64], b_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both (N, 72): distance from the origin to the part of each segment a -> b that lies in each sector, inf where no
    part does; and the azimuth of its nearest point.

    A sector is the meeting of two half planes through the origin; each clips the segment at a share of its length."""
    low = centres_rad() - 0.5 * STEP_RAD - _EDGE_RAD
    high = centres_rad() + 0.5 * STEP_RAD + _EDGE_RAD
    # at least 0 inside: clockwise of the lower edge, counter-clockwise of the upper one
    sides = ((-np.sin(low), np.cos(low)), (np.sin(high), -np.cos(high)))
    first, last = np.zeros((len(a_m), SECTORS)), np.ones((len(a_m), SECTORS))
    for nx, ny in sides:
        at_a = a_m[:, 0:1] * nx + a_m[:, 1:2] * ny
        at_b = b_m[:, 0:1] * nx + b_m[:, 1:2] * ny
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = at_a / (at_a - at_b)
        enters, leaves = (at_a < 0.0) & (at_b >= 0.0), (at_a >= 0.0) & (at_b < 0.0)
        first = np.where(enters, np.maximum(first, crossing), first)
        last = np.where(leaves, np.minimum(last, crossing), last)
        last = np.where((at_a < 0.0) & (at_b < 0.0), -1.0, last)
    along = b_m - a_m
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)[:, None]
    nearest = -((a_m * along).sum(axis=1))[:, None] / length2
    share = np.clip(nearest, first, np.maximum(first, last))
    x, y = a_m[:, 0:1] + share * along[:, 0:1], a_m[:, 1:2] + share * along[:, 1:2]
    distance = np.where(first <= last, np.hypot(x, y), np.inf)
    known = np.isfinite(distance) & (distance > 1e-6)  # what goes through the origin lies in no direction
    return distance, np.where(known, np.arctan2(y, x), centres_rad())


def seen_free(
    views: Sequence[View], avoid: AvoidParams, recall: Recall | None = None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(free_m, clear), each (72,): how far along each sector it was seen free, and whether that reaches the farthest
    distance told, for a share `clear_share` of the sector's rays and of the height of the band.

    Rays are walked from near_m on: what is nearer no camera looks at over the whole band. A point is free where any
    view calls it free; rays start at the vehicle, views at their cameras. Sectors of which the views themselves see
    seen_share are completed by what is recalled."""
    rays = (centres_rad()[:, None] + np.linspace(-0.4, 0.4, avoid.rays) * STEP_RAD).ravel()
    ranges = np.arange(avoid.near_m, avoid.max_distance_m + avoid.step_m, avoid.step_m)
    x, y = np.cos(rays)[:, None] * ranges, np.sin(rays)[:, None] * ranges
    slices = -avoid.band_above_m + (np.arange(avoid.slices) + 0.5) / avoid.slices * (
        avoid.band_above_m + avoid.band_below_m
    )
    free = np.zeros((len(slices), *x.shape), bool)
    for view in views:
        if view.model.valid:
            free |= points_free(view, x, y, slices, along_rays=True)
    each = _reached(free, avoid)
    if recall is not None:
        whole = each >= len(ranges)
        enough = np.repeat(whole.mean(axis=1) >= avoid.seen_share, avoid.rays) & ~np.repeat(
            whole.all(axis=1), avoid.rays
        )
        i, ray, k = np.nonzero(~free & enough[None, :, None])
        free[i, ray, k] = recall(x[ray, k], y[ray, k], slices[i])
        each = _reached(free, avoid)
    # what at least clear_share of the rays and slices reach
    each = np.sort(each, axis=1)[:, ::-1]
    common = each[:, math.ceil(avoid.clear_share * each.shape[1]) - 1]
    free_m = np.where(common > 0, ranges[np.maximum(common - 1, 0)], 0.0)
    return free_m, common >= len(ranges)


def _reached(free: NDArray[np.bool_], avoid: AvoidParams) -> NDArray[np.int64]:
    """(72, slices * rays): how many samples of each ray and height are free from near_m on. free: (slices, rays, ranges)."""
    reached = np.logical_and.accumulate(free, axis=2).sum(axis=2)
    out: NDArray[np.int64] = reached.reshape(len(free), SECTORS, avoid.rays).transpose(1, 0, 2).reshape(SECTORS, -1)
    return out


def in_image(view: View, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which places of level lie in a view's image, seen or not; all where nobody knows where it looks.

    Not in its outermost EDGE_SHARE: of what only a part of a layer is in the image the profile says nothing."""
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


def points_free(
    view: View, x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], along_rays: bool = False
) -> NDArray[np.bool_]:
    """(len(z), *x.shape): which points of level the view's free-range profile calls free.

    A layer counts as free from where all of it is in the image on, which with a tilted camera may be metres away. What
    was seen through it there was seen through on the way, too: along_rays takes in every point whose ray from the camera
    runs, at it or behind it, through a part of any layer that was seen free."""
    profile = view.model.free
    cx, cy, cz = view.place_m
    edges = profile.azimuth_edges_rad.astype(np.float64)
    # edges are not wrapped to one turn: the azimuth is taken within a turn from the first edge
    azimuth = edges[0] + np.mod(np.arctan2(y - cy, x - cx) - edges[0], math.tau)
    inside = azimuth < edges[-1]
    range_m = np.hypot(x[inside] - cx, y[inside] - cy)
    direction = np.searchsorted(edges, azimuth[inside], side="right") - 1
    layers = profile.layer_edges_m.astype(np.float64) - cz
    out = np.zeros((len(z), *x.shape), bool)
    for row in np.flatnonzero((profile.free_to_m > profile.free_from_m).any(axis=0)):
        begins, ends = profile.free_from_m[direction, row], profile.free_to_m[direction, row]
        known = ends > begins
        for i, height_m in enumerate(z - cz):
            if along_rays:
                first, last = _share_of_ray(height_m, layers[row], layers[row + 1])
                reached = np.maximum(np.maximum(begins, range_m), first * range_m) <= np.minimum(ends, last * range_m)
            elif layers[row] <= height_m < layers[row + 1]:
                reached = (begins <= range_m) & (range_m <= ends)
            else:
                continue
            out[i][inside] |= known & reached
    return out


def _share_of_ray(height_m: float, top_m: float, bottom_m: float) -> tuple[float, float]:
    """Between which multiples of its length the ray to a point at this height, drawn on, runs through a layer; (inf, 0) where
    it does not. All heights count from the camera, downwards."""
    if abs(height_m) < 1e-9:
        return (0.0, math.inf) if top_m <= 0.0 < bottom_m else (math.inf, 0.0)
    a, b = sorted((top_m / height_m, bottom_m / height_m))
    return (max(0.0, a), b) if b > 0.0 else (math.inf, 0.0)


class Look(IntEnum):
    """How much of a part of a sector a camera looks into."""

    NOTHING = 0
    SOME = 1
    WHOLE = 2


def looked_into(info: CameraInfo, avoid: AvoidParams, hidden: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
    """(72, PARTS) Look: how much of each part of each sector a camera looks into while the vehicle is level, by the rays of
    its image that run through the band of height at near_m or farther; by all its rays where none does.

    hidden: (H, W) pixels that are never measured. Where they take more than 1 - clear_share of the heights that the image
    would see, the part is looked into in some of it only: nobody will ever call it clear."""
    k, n = info.intrinsics, 257
    u, v = np.linspace(-0.5, k.width - 0.5, n), np.linspace(-0.5, k.height - 0.5, n)
    optical = np.stack([*np.meshgrid((u - k.cx) / k.fx, (v - k.cy) / k.fy), np.ones((n, n))]).reshape(3, -1)
    x, y, z = rotation_frd_optical(info.mount) @ optical
    z_m = avoid.near_m * z / np.maximum(np.hypot(x, y), 1e-9)
    inside = (z_m > -avoid.band_above_m) & (z_m < avoid.band_below_m)
    if not inside.any():
        inside[:] = True
    seen = inside.copy()
    if hidden is not None:
        rows, columns = (np.clip(np.round(c), 0, size - 1).astype(int) for c, size in ((v, k.height), (u, k.width)))
        seen &= ~hidden[np.ix_(rows, columns)].ravel()
    part = np.floor((np.arctan2(y, x) + 0.5 * STEP_RAD) / (STEP_RAD / PARTS)).astype(int) % (SECTORS * PARTS)
    share = (z_m + avoid.band_above_m) / (avoid.band_above_m + avoid.band_below_m)
    height = np.clip(share * avoid.slices, 0, avoid.slices - 1).astype(int)
    could, can = (np.zeros((SECTORS * PARTS, avoid.slices), bool) for _ in range(2))
    could[part[inside], height[inside]] = True
    can[part[seen], height[seen]] = True
    out = np.where(can.any(axis=1), np.uint8(Look.SOME), np.uint8(Look.NOTHING))
    enough = can.sum(axis=1) >= avoid.clear_share * could.sum(axis=1)
    out[can.any(axis=1) & enough] = Look.WHOLE
    return out.reshape(SECTORS, PARTS)


def covered(cameras: Sequence[NDArray[np.uint8]]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(72,) sectors of which these cameras (of looked_into) together see any part, and (72,) those they see all of."""
    parts = np.maximum.reduce([np.zeros((SECTORS, PARTS), np.uint8), *cameras])
    return (parts > Look.NOTHING).any(axis=1), (parts == Look.WHOLE).all(axis=1)

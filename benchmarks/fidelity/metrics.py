"""Scores a set of vertical rectangles against the true view (missed and phantom in docs/reference/limits.md).

A model is `planes` (N, 6) in level_cam: a_x, a_y, b_x, b_y, top, bottom. Rays are the camera's pixels; a ray is stopped
where it first meets a plane, from either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.types import TEXTURED_MM, Intrinsics
from drivers.simulation.ray_caster import RECTANGLE, ROW, cast_rays
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

NAN = float("nan")
PLANE_BYTES = 24
"""Six float32."""
MISSED_M, PHANTOM_M = 0.5, 1.0
"""The least distance behind, before the true surface at which a ray counts as missed, as phantom (Ws / 2)."""
OPEN_M = 0.05
"""A ray that ends in the ground is stopped when it is stopped more than this before it: planes are float32,
and their feet stand in the ground."""
RANGE_BINS = 24
"""Ranges are counted in steps of a metre; the last step holds all beyond."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """The figures of one frame; shares are of 1. Without rays of the kind a share is nan.

    mean_m, p95_m: distance of a visible true obstacle point to the model. missed: obstacle rays let pass more
    than max(0.5 m, 2 sigma) beyond the true surface; missed_margin: the same when each plane's margin is
    subtracted; missed_measured: of the obstacle rays whose own pixel was measured. phantom: obstacle rays
    stopped more than max(1 m, 3 sigma) before the truth, farther than that from every visible true surface;
    phantom_open: the same of open rays. open_stopped: open rays stopped at all before the ground or the sky,
    near an obstacle or not; open_stopped_early: those of them stopped more than max(0.5 m, 2 sigma) before
    the ground, or before the sky."""

    mean_m: float
    p95_m: float
    missed: float
    missed_margin: float
    missed_measured: float
    phantom: float
    phantom_open: float
    open_stopped: float
    open_stopped_early: float
    planes: int
    obstacle_rays: int
    open_rays: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeCounts:
    """Rays per metre of range (RANGE_BINS): obstacle rays and those missed and phantom, by their true
    range; open rays that are phantom, by the range at which they were stopped."""

    obstacle: list[int]
    missed: list[int]
    phantom: list[int]
    open_phantom: list[int]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rays:
    """The true view, ray by ray, all (H, W). range_m: Euclidean, inf: no surface; sigma_m: noise along the ray, nan:
    the surface is beyond the camera's range; per_depth: range over depth; obstacle: more than the least height above
    the ground and safely within the camera's range; open: ground or no surface; solid: any surface except ground;
    measured: the delivered pixel holds a depth."""

    ke_per_m: float
    range_m: Floats
    sigma_m: Floats
    per_depth: Floats
    obstacle: Mask
    open: Mask
    solid: Mask
    measured: Mask


def rays_of(frame: Rendered, ke_per_m: float, min_height_m: float = 0.6, blind_left_px: int = 0) -> Rays:
    """The true rays of a rendered frame; ke_per_m: its true noise. Columns that the camera never sees do not
    count."""
    truth, info = frame.truth, frame.info
    k = info.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    per_depth = np.sqrt(1.0 + ((u - k.cx) / k.fx) ** 2 + ((v - k.cy) / k.fy) ** 2)
    depth = np.where(truth.depth_m <= info.max_range_m, truth.depth_m, NAN)
    sees = u >= blind_left_px
    # noise is constant in disparity, and so are the 3 sigma that the truth stays away from the clip
    clip_m = info.max_range_m / (1.0 + 3.0 * ke_per_m * info.max_range_m)
    within = (truth.depth_m < clip_m) & (truth.depth_m > info.min_range_m)
    solid = np.isfinite(truth.depth_m) & ~truth.drawn_ground
    return Rays(
        ke_per_m=ke_per_m,
        range_m=truth.depth_m * per_depth,
        sigma_m=ke_per_m * depth**2 * per_depth,
        per_depth=per_depth,
        obstacle=np.asarray(truth.obstacle(min_height_m) & within & sees),
        open=np.asarray(~solid & sees),
        solid=np.asarray(solid),
        # marks of unmeasured pixels are values too
        measured=np.asarray((frame.depth_mm > (TEXTURED_MM if info.marks_smooth else 0)) & (frame.depth_mm < 65534)),
    )


def stops(planes: Floats, intrinsics: Intrinsics, R_level_optical: Floats) -> tuple[Floats, NDArray[np.int32]]:
    """Depth Z (H, W) at which each pixel's ray first meets a plane, inf: none, and which one (-1: none)."""
    p = np.asarray(planes, np.float64).reshape(-1, 6)
    count = len(p)
    rows = np.zeros((count, ROW))
    rows[:, 0:2], rows[:, 2] = p[:, 0:2], p[:, 4]
    rows[:, 3:5] = p[:, 2:4] - p[:, 0:2]
    rows[:, 8] = p[:, 5] - p[:, 4]
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    corners = rows[:, None, 0:3] + bits[None, :, 0:1] * rows[:, None, 3:6] + bits[None, :, 1:2] * rows[:, None, 6:9]
    kinds = np.full(count, RECTANGLE, np.int32)
    return cast_rays(kinds, rows, corners, np.zeros((0, 4)), intrinsics, R_level_optical, np.zeros(3))


@njit(cache=True, nogil=True)
def _distance(x, y, z, plane):
    """Distance of a point to a rectangle (6,)."""
    ax, ay = plane[0], plane[1]
    ex, ey = plane[2] - ax, plane[3] - ay
    length2 = ex * ex + ey * ey
    t = 0.0
    if length2 > 0.0:
        t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / length2))
    dx, dy = x - ax - t * ex, y - ay - t * ey
    dz = max(0.0, plane[4] - z, z - plane[5])
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, nogil=True)
def _distances(points, planes, run, out):
    """Distance of each point to the nearest rectangle. Of each `run` of points, which lie side by side in an
    image, only the planes are looked at that can be nearest to a point of a ball around them all."""
    to_centre, near = np.empty(planes.shape[0]), np.empty(planes.shape[0], np.int64)
    for start in range(0, points.shape[0], run):
        end = min(start + run, points.shape[0])
        cx, cy, cz = 0.0, 0.0, 0.0
        for i in range(start, end):
            cx += points[i, 0] / (end - start)
            cy += points[i, 1] / (end - start)
            cz += points[i, 2] / (end - start)
        ball = 0.0
        for i in range(start, end):
            x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
            ball = max(ball, np.sqrt(x * x + y * y + z * z))
        least = np.inf
        for j in range(planes.shape[0]):
            to_centre[j] = _distance(cx, cy, cz, planes[j])
            least = min(least, to_centre[j])
        count = 0
        for j in range(planes.shape[0]):
            if to_centre[j] <= least + 2.0 * ball + 1e-9:
                near[count] = j
                count += 1
        for i in range(start, end):
            best = np.inf
            for n in range(count):
                best = min(best, _distance(points[i, 0], points[i, 1], points[i, 2], planes[near[n]]))
            out[i] = best


def distances(points_m: Floats, planes: Floats) -> Floats:
    """(P,) distance of each point (P, 3) to the nearest plane taken as a finite rectangle; inf without
    planes."""
    p = np.ascontiguousarray(planes, np.float64).reshape(-1, 6)
    out = np.full(len(points_m), np.inf)
    if len(p) and len(points_m):
        _distances(np.ascontiguousarray(points_m, np.float64), p, 24, out)
    return out


def missed_rays(rays: Rays, stop_m: Floats) -> Mask:
    """(H, W) obstacle rays that pass more than max(0.5 m, 2 sigma) beyond the truth; stop_m: Euclidean, inf:
    never."""
    return np.asarray(rays.obstacle & (stop_m > rays.range_m + np.fmax(MISSED_M, 2.0 * rays.sigma_m)))


def phantom_rays(rays: Rays, stop_m: Floats, points_m: Floats, directions: Floats) -> Mask:
    """(H, W) rays, obstacle or open, stopped where nothing is; points_m: (H, W, 3) true points in level_cam;
    directions: (H, W, 3) unit rays in level_cam."""
    # the sky and what lies beyond the range have no noise: there it is that of the distance of the stop
    at_stop = rays.ke_per_m * np.where(np.isfinite(stop_m), stop_m, 0.0) ** 2 / rays.per_depth
    halo = np.fmax(PHANTOM_M, 3.0 * np.where(np.isfinite(rays.sigma_m), rays.sigma_m, at_stop))
    early = (rays.obstacle | rays.open) & (stop_m < rays.range_m - halo)
    # for most stops a subset of the true points shows that a surface is near; the rest are compared with all points
    for step in (5, 1):
        surface = points_m[::step, ::step][rays.solid[::step, ::step]]
        if early.any() and len(surface):
            hits = directions[early] * stop_m[early][:, None]
            near, _ = cKDTree(surface).query(hits, distance_upper_bound=float(halo[early].max()) + 1e-6)
            early[early] = near > halo[early]
    return np.asarray(early)


def open_stopped_rays(rays: Rays, stop_m: Floats, early: bool = False) -> Mask:
    """(H, W) open rays that the model stops before the ground or the sky; early: before the ground only those
    stopped more than max(0.5 m, 2 sigma) before it."""
    slack = np.fmax(MISSED_M, 2.0 * rays.sigma_m) if early else OPEN_M
    return np.asarray(rays.open & (stop_m < rays.range_m - slack))


def _share(part: Mask, whole: Mask) -> float:
    return float((part & whole).sum() / whole.sum()) if whole.any() else NAN


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Verdict:
    """What a model does to each ray, all (H, W): stop_m Euclidean, inf: lets it pass; the others as in Score,
    phantom of obstacle and open rays together."""

    stop_m: Floats
    missed: Mask
    missed_margin: Mask
    phantom: Mask
    open_stopped: Mask
    open_stopped_early: Mask


def judge(frame: Rendered, rays: Rays, planes: Floats, margins_m: Floats | None = None) -> Verdict:
    """The verdict ray by ray. planes: (N, 6) level_cam; margins_m: (N,), default none."""
    depth, which = stops(planes, frame.info.intrinsics, frame.R_level_optical)
    stop_m = depth * rays.per_depth
    margin = np.zeros(len(planes)) if margins_m is None else np.asarray(margins_m, np.float64)
    with_margin = stop_m - np.append(margin, 0.0)[which]
    k = frame.info.intrinsics
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    optical = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)
    directions = optical @ frame.R_level_optical.T / rays.per_depth[..., None]
    return Verdict(
        stop_m=stop_m,
        missed=missed_rays(rays, stop_m),
        missed_margin=missed_rays(rays, with_margin),
        phantom=phantom_rays(rays, stop_m, frame.truth.points_level_cam_m, directions),
        open_stopped=open_stopped_rays(rays, stop_m),
        open_stopped_early=open_stopped_rays(rays, stop_m, early=True),
    )


def score(
    frame: Rendered, rays: Rays, planes: Floats, margins_m: Floats | None = None, verdict: Verdict | None = None
) -> Score:
    """All figures of a model of one frame. planes: (N, 6) level_cam; margins_m: (N,), default none; verdict:
    that of `judge`, where it is known already."""
    v = verdict or judge(frame, rays, planes, margins_m)
    off = distances(frame.truth.points_level_cam_m[rays.obstacle], planes)
    return Score(
        mean_m=float(off.mean()) if len(off) else NAN,
        p95_m=float(np.percentile(off, 95, method="lower")) if len(off) else NAN,
        missed=_share(v.missed, rays.obstacle),
        missed_margin=_share(v.missed_margin, rays.obstacle),
        missed_measured=_share(v.missed, rays.obstacle & rays.measured),
        phantom=_share(v.phantom, rays.obstacle),
        phantom_open=_share(v.phantom, rays.open),
        open_stopped=_share(v.open_stopped, rays.open),
        open_stopped_early=_share(v.open_stopped_early, rays.open),
        planes=len(planes),
        obstacle_rays=int(rays.obstacle.sum()),
        open_rays=int(rays.open.sum()),
    )


def range_counts(rays: Rays, verdict: Verdict) -> RangeCounts:
    """The rays of a verdict by range."""

    def count(mask: Mask, range_m: Floats) -> list[int]:
        step = np.minimum(range_m[mask], RANGE_BINS - 1).astype(np.int64)
        return [int(n) for n in np.bincount(step, minlength=RANGE_BINS)]

    return RangeCounts(
        obstacle=count(rays.obstacle, rays.range_m),
        missed=count(verdict.missed, rays.range_m),
        phantom=count(verdict.phantom & rays.obstacle, rays.range_m),
        open_phantom=count(verdict.phantom & rays.open, verdict.stop_m),
    )


@dataclass(frozen=True, slots=True)
class Recall:
    """Recall of one named object: the share of its obstacle rays stopped within max(0.5 m, 2 sigma) of the truth;
    distance_m: median of its true depth; width_px: its rays per image row that contains it."""

    name: str
    distance_m: float
    rays: int
    kept: float
    width_px: float


def recall(frame: Rendered, rays: Rays, planes: Floats) -> list[Recall]:
    """The recall of each named object of the scene that has obstacle rays, nearest first."""
    depth, _ = stops(planes, frame.info.intrinsics, frame.R_level_optical)
    error = np.abs(np.where(np.isfinite(depth), depth, 1e9) * rays.per_depth - rays.range_m)
    kept = error <= np.fmax(MISSED_M, 2.0 * rays.sigma_m)
    label = frame.truth.label(frame.scene)
    found = []
    for i, name in enumerate(frame.scene.names):
        mine = rays.obstacle & (label == i)
        if mine.any():
            rows = int(mine.any(axis=1).sum())
            distance = float(np.median(frame.truth.depth_m[mine]))
            found.append(Recall(name, distance, int(mine.sum()), _share(np.asarray(kept), mine), mine.sum() / rows))
    return sorted(found, key=lambda r: r.distance_m)

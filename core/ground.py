"""The horizontal surface under the camera, found once per frame before any density is counted.

Flat ground fills about as many pixels per kernel width at any range while the obstacle threshold falls with range, so
left in it becomes an obstacle far away. Ours: votes of steep-free pixel pairs for a height, a check that little lies
below, a bounded plane fit. None found is said, never assumed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frames import Rotation
from .level import ViewGeometry
from .params import Params
from .types import FAR_MM, CameraInfo, Ground

NO_GROUND = Ground(seen=False)
_FAR = np.uint16(FAR_MM)
(
    V_LEAST, V_STEP, V_CLIMB, V_CLIMB_MIN, V_CLIMB_MAX, V_ROWS_MIN, V_ROWS_MAX, V_FLAT, V_SIGMAS, V_FLAT_CAP, V_LEVEL,
) = range(11)  # fmt: skip
"""Indices of `vote_settings`."""


def vote_settings(rows: int, p: Params) -> NDArray[np.float64]:
    """(11,) float64 for pictures of so many rows."""
    return np.array(
        [
            p.ground_min_height_m, p.ground_height_step, p.ground_pair_climb, p.ground_pair_climb_min_m,
            p.ground_pair_climb_max_m, p.ground_pair_min_px, rows // p.ground_pair_parts, p.ground_pair_flat,
            p.ground_pair_sigmas, p.ground_pair_flat_cap, p.ground_pair_level,
        ]
    )  # fmt: skip


def height_bins(p: Params) -> int:
    """How many steps of height are counted: a few beyond the greatest height considered."""
    return 4 + math.ceil(math.log(max(p.ground_max_height_m / p.ground_min_height_m, 1.0)) / p.ground_height_step)


@njit(cache=True, nogil=True)
def vote(marks, R, k, ke, column_step, row_step, tuning, votes, points):
    """Votes for the height of horizontal surfaces; returns (points written, votes cast, pixels sampled).

    marks: (H, W) uint16 of `classify`. R: (3, 3) R_level_optical. k: (4,) fx, fy, cx, cy. tuning: `vote_settings`. votes: (bins,)
    int32 over log height. points: (N, 5) float32 x, y, z of the sampled pixels in level_cam, their 1/sigma_h per metre
    of height, and 1 where they voted. A pair of pixels in one source column votes when what lies between them climbs
    little of what a wall would show over the same rows."""
    rows, cols = marks.shape
    least, bin_step = tuning[V_LEAST], tuning[V_STEP]
    bins = len(votes)
    votes[:] = 0
    n = 0
    cast = 0
    sampled = 0
    for u in range(column_step // 2, cols, column_step):
        xu = (u - k[2]) / k[0]
        for v in range(row_step // 2, rows, row_step):
            mark = marks[v, u]
            if mark == 0 or mark == _FAR:
                continue
            d = np.float32(1000.0) / np.float32(mark)
            sampled += 1
            yv = (v - k[3]) / k[1]
            z = (R[2, 0] * xu + R[2, 1] * yv + R[2, 2]) / d
            x = (R[0, 0] * xu + R[0, 1] * yv + R[0, 2]) / d
            if n < points.shape[0]:
                points[n, 0] = x
                points[n, 1] = (R[1, 0] * xu + R[1, 1] * yv + R[1, 2]) / d
                points[n, 2] = z
                points[n, 3] = d / ke
                points[n, 4] = 0.0
                n += 1
            if z < least or x <= 0.0:
                continue
            # what a wall would climb over the rows that are looked at
            climb = min(max(tuning[V_CLIMB] * z, tuning[V_CLIMB_MIN]), tuning[V_CLIMB_MAX])
            v2 = v - int(max(tuning[V_ROWS_MIN], min(tuning[V_ROWS_MAX], climb * k[1] * d)))
            if v2 < 0:
                continue
            mark = marks[v2, u]
            if mark == 0 or mark == _FAR:
                continue
            d2 = np.float32(1000.0) / np.float32(mark)
            yv2 = (v2 - k[3]) / k[1]
            z2 = (R[2, 0] * xu + R[2, 1] * yv2 + R[2, 2]) / d2
            noise = tuning[V_SIGMAS] * ke * (z / d + abs(z2) / d2) * 0.5
            allowed = min(tuning[V_FLAT] * climb + noise, tuning[V_FLAT_CAP] * climb)
            if abs(z2 - z) < allowed and z2 > tuning[V_LEVEL] * z:
                cast += 1
                points[n - 1, 4] = 1.0
                bin_ = int(math.log(0.5 * (z + z2) / least) / bin_step)
                if 0 <= bin_ < bins:
                    votes[bin_] += 1
    return n, cast, sampled


def ground_gate(
    ground: Ground, view: ViewGeometry, ke: float, params: Params
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(gate, shift): a cell of code q at row tangent m and column u is ground, or below it, when m - shift[u] > gate[q].

    gate: (65536,) float32, shift: (cols,) float32. From z = X m against h + sx X + sy y - tolerance(X), over X."""
    shift = np.zeros(view.cols, np.float32)
    if not ground.seen:
        return np.full(65536, np.inf, np.float32), shift
    x = view.f_px * view.quantum / np.maximum(np.arange(65536), 1)
    cap = params.ground_tolerance_cap * params.min_obstacle_height_m
    tolerance = np.clip(params.ground_sigmas * ke * x * ground.height_m, min(params.ground_tolerance_m, cap), cap)
    gate = ((ground.height_m - tolerance) / x + ground.slope_x).astype(np.float32)
    column_t = (np.arange(view.cols) - view.cu) * float(view.lateral[0]) / view.f_px
    return gate, (ground.slope_y * column_t).astype(np.float32)


def find_ground(
    marks: NDArray[np.uint16], info: CameraInfo, R_level_optical: Rotation, ke: float, seed_height_m: float,
    params: Params, points: NDArray[np.float32],
) -> Ground:  # fmt: skip
    """The ground of one frame, or NO_GROUND.

    seed_height_m: height of the last frame's ground (nan: none): its bin and neighbours count more.
    points: (ground_max_samples, 5) float32 scratch. The heights are tried from the most voted on; one is taken when enough pixels lie
    on it and few below."""
    k, p = info.intrinsics, params
    votes = np.zeros(height_bins(p), np.int32)
    across, down = p.ground_column_step, p.ground_row_step
    # as coarse as it takes for the whole picture to find room: a part of it would say nothing of what lies below
    step = max(1, math.ceil(math.sqrt((k.width // across + 1) * (k.height // down + 1) / len(points))))
    n, _, sampled = vote(
        marks, np.ascontiguousarray(R_level_optical), np.array([k.fx, k.fy, k.cx, k.cy]), ke, across * step, down * step,
        vote_settings(k.height, p), votes, points,
    )  # fmt: skip
    if sampled < p.ground_min_samples:
        return NO_GROUND
    score = np.convolve(votes, [1.0, 1.0, 1.0], mode="same")
    if math.isfinite(seed_height_m) and seed_height_m > p.ground_min_height_m:
        at = int(math.log(seed_height_m / p.ground_min_height_m) / p.ground_height_step)
        score[max(0, at - p.ground_seed_steps) : at + p.ground_seed_steps + 1] *= p.ground_seed_weight
    seen = points[:n].astype(np.float64)
    for _ in range(p.ground_tries):
        best = int(np.argmax(score))
        if score[best] < p.ground_min_share * sampled:
            return NO_GROUND
        height = p.ground_min_height_m * math.exp((best + 0.5) * p.ground_height_step)
        score[max(0, best - 2) : best + 3] = 0.0  # all sums of three that share a bin with this one
        if height > p.ground_max_height_m:
            continue
        ground = _fit(seen, height, ke, p)
        if ground is not None:
            return ground
    return NO_GROUND


def _fit(points: NDArray[np.float64], height_m: float, ke: float, params: Params) -> Ground | None:
    """z = h + sx x + sy y through the points near height_m, slopes bounded; None when too much lies below it."""
    x, y, z, inv_noise, level = points.T
    slope = np.zeros(2)
    cap = params.ground_tolerance_cap * params.min_obstacle_height_m
    for _ in range(params.ground_fit_rounds):
        noise = params.ground_sigmas * height_m / inv_noise
        tolerance = np.clip(noise, min(params.ground_tolerance_m, cap), cap)
        off = z - (height_m + slope[0] * x + slope[1] * y)
        on = (np.abs(off) < tolerance) & (level > 0.0)  # the foot of a wall is near the ground and not level
        if on.sum() < max(params.ground_fit_min_px, params.ground_min_share * len(points)):
            return None
        # inverse variance of height, sigma_h = ke X h
        w = np.where(on, 1.0 / (params.ground_fit_floor_m + height_m / inv_noise) ** 2, 0.0)
        height_m = height_m + float(np.sum(w * off) / np.sum(w))
        if params.ground_max_slope > 0.0:
            slope = _bounded_slope(x, y, z - height_m, w, params)
    off = z - (height_m + slope[0] * x + slope[1] * y)
    below = np.mean(off > tolerance + params.ground_below_m * height_m / (height_m + params.ground_below_full_m))
    if below > params.ground_max_below_share or height_m < params.ground_min_height_m:
        return None
    blind = params.min_obstacle_height_m / (params.ground_sigmas * ke * height_m)
    return Ground(
        seen=True, height_m=height_m, slope_x=float(slope[0]), slope_y=float(slope[1]), share=float(np.mean(np.abs(off) < tolerance)),
        blind_beyond_m=blind,
    )  # fmt: skip


def _bounded_slope(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], w: NDArray[np.float64], params: Params
) -> NDArray[np.float64]:
    """Weighted least-squares slopes of z over (x, y) with intercept, shrunk to 0 where the data do not carry them."""
    A = np.stack([np.ones_like(x), x, y])
    normal = (A * w) @ A.T
    normal[1, 1] += 1.0 / params.ground_slope_prior**2
    normal[2, 2] += 1.0 / params.ground_slope_prior**2
    fit = np.linalg.solve(normal, (A * w) @ z)
    length = math.hypot(fit[1], fit[2])
    return np.asarray(fit[1:] * min(1.0, params.ground_max_slope / max(length, 1e-12)))

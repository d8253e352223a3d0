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
from .types import CameraInfo, Ground

NO_GROUND = Ground(seen=False)
_BIN = 0.04
"""Heights are voted for in steps of 4 %: the noise of height grows with height (sigma_h = ke X h)."""
_BINS = 160
_LEAST_HEIGHT_M = 0.12


@njit(cache=True, nogil=True)
def vote(inverse, R, k, ke, step, votes, points):
    """Votes for the height of horizontal surfaces; returns (points written, votes cast, pixels sampled).

    inverse: (H, W) float32. R: (3, 3) R_level_optical. k: (4,) fx, fy, cx, cy. votes: (160,) int32 over log height.
    points: (N, 5) float32 x, y, z of the sampled pixels in level_cam, their 1/sigma_h per metre of height, and 1
    where they voted. Every 5 step-th column and 3 step-th row is sampled. A pair of pixels in one source column votes when what lies between them climbs less than a quarter
    of what a wall would show over the same rows."""
    rows, cols = inverse.shape
    votes[:] = 0
    n = 0
    cast = 0
    sampled = 0
    for u in range(2, cols, 5 * step):
        xu = (u - k[2]) / k[0]
        for v in range(1, rows, 3 * step):
            d = inverse[v, u]
            if d <= 0.0:
                continue
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
            if z < _LEAST_HEIGHT_M or x <= 0.0:
                continue
            # what a wall would climb over the rows that are looked at: a fifth of the camera's height
            climb = min(max(0.2 * z, 0.08), 2.0)
            v2 = v - max(4, min(rows // 3, int(climb * k[1] * d)))
            if v2 < 0:
                continue
            d2 = inverse[v2, u]
            if d2 <= 0.0:
                continue
            yv2 = (v2 - k[3]) / k[1]
            z2 = (R[2, 0] * xu + R[2, 1] * yv2 + R[2, 2]) / d2
            noise = 2.0 * ke * (z / d + abs(z2) / d2) * 0.5
            if abs(z2 - z) < min(0.25 * climb + noise, 0.5 * climb) and z2 > 0.5 * z:
                cast += 1
                points[n - 1, 4] = 1.0
                bin_ = int(math.log(0.5 * (z + z2) / _LEAST_HEIGHT_M) / _BIN)
                if 0 <= bin_ < _BINS:
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
    inverse: NDArray[np.float32], info: CameraInfo, R_level_optical: Rotation, ke: float, seed_height_m: float,
    params: Params, points: NDArray[np.float32],
) -> Ground:  # fmt: skip
    """The ground of one frame, or NO_GROUND.

    seed_height_m: height of the last frame's ground (nan: none): its bin and neighbours count half as much again.
    points: (N, 5) float32 scratch. The heights are tried from the most voted on; one is taken when enough pixels lie
    on it and few below."""
    k = info.intrinsics
    votes = np.zeros(_BINS, np.int32)
    # as coarse as it takes for the whole picture to find room: a part of it would say nothing of what lies below
    step = max(1, math.ceil(math.sqrt((k.width // 5 + 1) * (k.height // 3 + 1) / len(points))))
    n, _, sampled = vote(
        inverse, np.ascontiguousarray(R_level_optical), np.array([k.fx, k.fy, k.cx, k.cy]), ke, step, votes, points
    )
    if sampled < 50:
        return NO_GROUND
    score = np.convolve(votes, [1.0, 1.0, 1.0], mode="same")
    if math.isfinite(seed_height_m) and seed_height_m > _LEAST_HEIGHT_M:
        at = int(math.log(seed_height_m / _LEAST_HEIGHT_M) / _BIN)
        score[max(0, at - 2) : at + 3] *= 1.5
    seen = points[:n].astype(np.float64)
    for _ in range(6):
        best = int(np.argmax(score))
        if score[best] < params.ground_min_share * sampled:
            return NO_GROUND
        height = _LEAST_HEIGHT_M * math.exp((best + 0.5) * _BIN)
        score[max(0, best - 2) : best + 3] = 0.0
        if height > params.ground_max_height_m:
            continue
        ground = _fit(seen, height, ke, params)
        if ground is not None:
            return ground
    return NO_GROUND


def _fit(points: NDArray[np.float64], height_m: float, ke: float, params: Params) -> Ground | None:
    """z = h + sx x + sy y through the points near height_m, slopes bounded; None when too much lies below it."""
    x, y, z, inv_noise, level = points.T
    slope = np.zeros(2)
    cap = params.ground_tolerance_cap * params.min_obstacle_height_m
    for _ in range(4):
        noise = params.ground_sigmas * height_m / inv_noise
        tolerance = np.clip(noise, min(params.ground_tolerance_m, cap), cap)
        off = z - (height_m + slope[0] * x + slope[1] * y)
        on = (np.abs(off) < tolerance) & (level > 0.0)  # the foot of a wall is near the ground and not level
        if on.sum() < max(20, params.ground_min_share * len(points)):
            return None
        # inverse variance of height (sigma_h = ke X h), floored so that near pixels do not rule alone
        w = np.where(on, 1.0 / (0.02 + height_m / inv_noise) ** 2, 0.0)
        height_m = height_m + float(np.sum(w * off) / np.sum(w))
        if params.ground_max_slope > 0.0:
            slope = _bounded_slope(x, y, z - height_m, w, params.ground_max_slope)
    off = z - (height_m + slope[0] * x + slope[1] * y)
    below = np.mean(off > tolerance + 0.1 * height_m / (height_m + 5.0))
    if below > params.ground_max_below_share or height_m < _LEAST_HEIGHT_M:
        return None
    blind = params.min_obstacle_height_m / (params.ground_sigmas * ke * height_m)
    return Ground(
        seen=True, height_m=height_m, slope_x=float(slope[0]), slope_y=float(slope[1]), share=float(np.mean(np.abs(off) < tolerance)),
        blind_beyond_m=blind,
    )  # fmt: skip


def _bounded_slope(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64], w: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """Weighted least-squares slopes of z over (x, y) with intercept, shrunk to 0 where the data do not carry them."""
    A = np.stack([np.ones_like(x), x, y])
    normal = (A * w) @ A.T
    # a prior of 1 degree keeps a narrow patch of ground from tilting
    normal[1, 1] += 1.0 / 0.0175**2
    normal[2, 2] += 1.0 / 0.0175**2
    fit = np.linalg.solve(normal, (A * w) @ z)
    length = math.hypot(fit[1], fit[2])
    return np.asarray(fit[1:] * min(1.0, limit / max(length, 1e-12)))

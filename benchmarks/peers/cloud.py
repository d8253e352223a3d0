"""What every peer is given: the points above the ground of one noisy frame, sorted as our own method sorts its pixels.

The same range (cut where the range clip begins to show through the noise), the same rule for flying pixels, the same
least number of pixels that must hang together; and, as a gift, the true ground, the true noise and the true attitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.params import Params
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]

SPECK_JUMP, SPECK_SIGMAS = 0.08, 6.0
"""Neighbouring pixels hang together when they differ by less than this share of their disparity and this much noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """points_m: (P, 3) float64 in level_cam, row by row of the image; ground_z_m: the ground's z under the camera;
    focal_px: of the camera."""

    points_m: Floats
    ground_z_m: float
    focal_px: float


@njit(cache=True, nogil=True)
def _inverse_depth(depth_mm, shortest_mm, longest_mm, relative, absolute, raw, out):
    """1/Z (H, W) float32 of the pixels that hold a measurement within the range and do not fly, else 0.

    A pixel flies when it lies between both neighbours in disparity, left and right or above and below, and is farther
    than absolute + relative * disparity from either."""
    rows, cols = depth_mm.shape
    for v in range(rows):
        for u in range(cols):
            z = np.int32(depth_mm[v, u])
            raw[v, u] = np.float32(1000.0) / np.float32(z) if shortest_mm <= z <= longest_mm else np.float32(0.0)
    for v in range(rows):
        for u in range(cols):
            d = raw[v, u]
            fly = False
            if d > 0.0:
                t = absolute + relative * d
                if 0 < u < cols - 1:
                    a, b = raw[v, u - 1], raw[v, u + 1]
                    fly = a > 0.0 and b > 0.0 and ((a - d > t and d - b > t) or (b - d > t and d - a > t))
                if not fly and 0 < v < rows - 1:
                    a, b = raw[v - 1, u], raw[v + 1, u]
                    fly = a > 0.0 and b > 0.0 and ((a - d > t and d - b > t) or (b - d > t and d - a > t))
            out[v, u] = np.float32(0.0) if fly else d


@njit(cache=True, nogil=True)
def _without_specks(inverse, relative, absolute, least_px, least_per_disparity, seen, stack):
    """Sets to 0 every connected piece (8 neighbours) of fewer than max(least_px, least_per_disparity * its 1/Z) pixels.

    seen: (H * W,) uint8 zeros; stack: (H * W,) int32 scratch."""
    rows, cols = inverse.shape
    flat = inverse.reshape(-1)
    for start in range(rows * cols):
        if seen[start] or flat[start] <= 0.0:
            continue
        stack[0] = start
        seen[start] = 1
        done, found, nearest = 0, 1, flat[start]
        while done < found:
            at = stack[done]
            done += 1
            d = flat[at]
            nearest = max(nearest, d)
            v, u = at // cols, at % cols
            for dv in range(max(0, v - 1), min(rows, v + 2)):
                for du in range(max(0, u - 1), min(cols, u + 2)):
                    to = dv * cols + du
                    e = flat[to]
                    if seen[to] == 0 and e > 0.0 and abs(e - d) < absolute + relative * d:
                        seen[to] = 1
                        stack[found] = to
                        found += 1
        if found < least_px or found < least_per_disparity * nearest:
            for i in range(found):
                flat[stack[i]] = 0.0


@njit(cache=True, nogil=True)
def _points(inverse, camera, R, ground, tolerance, sigmas_ke, cap, out):
    """Writes the points above the ground into out (H * W, 3), level_cam; returns how many.

    camera: fx, fy, cx, cy; ground: z, slope_x, slope_y of the ground in level_cam. What counts as ground reaches
    max(tolerance, sigmas_ke * X * height of the camera) above it, at most cap."""
    rows, cols = inverse.shape
    n = 0
    for v in range(rows):
        b = (v - camera[3]) / camera[1]
        rx, ry, rz = R[0, 1] * b + R[0, 2], R[1, 1] * b + R[1, 2], R[2, 1] * b + R[2, 2]
        for u in range(cols):
            d = inverse[v, u]
            if d > 0.0:
                a, depth = (u - camera[2]) / camera[0], 1.0 / d
                x, y, z = depth * (R[0, 0] * a + rx), depth * (R[1, 0] * a + ry), depth * (R[2, 0] * a + rz)
                above = ground[0] + ground[1] * x + ground[2] * y - z
                if above > min(cap, max(tolerance, sigmas_ke * x * ground[0])):
                    out[n, 0], out[n, 1], out[n, 2] = x, y, z
                    n += 1
    return n


def ground_in_level_cam(frame: Rendered) -> Floats:
    """(3,) z, slope_x, slope_y of the true ground in level_cam: z = g[0] + g[1] x + g[2] y."""
    g, at = frame.scene.ground, frame.position_ned_m
    to_ned = frame.R_ned_optical @ frame.R_level_optical.T
    z = g.z_m + g.slope_x * at[0] + g.slope_y * at[1] - at[2]
    slope = np.array([g.slope_x, g.slope_y]) @ to_ned[:2, :2]
    return np.array([z, slope[0], slope[1]])


def sorted_inverse_depth(
    frame: Rendered, ke_per_m: float, params: Params | None = None, *, all_pixels: bool = False
) -> NDArray[np.float32]:
    """1/Z (H, W), 1/m, of the pixels that our own method would use, ground included, else 0; arguments as for
    `cloud_of`."""
    p, info, k = params or Params(), frame.info, frame.info.intrinsics
    longest_m = info.max_range_m / (1.0 + (0.0 if all_pixels else 3.0) * ke_per_m * info.max_range_m)
    raw, inverse = np.empty(frame.depth_mm.shape, np.float32), np.empty(frame.depth_mm.shape, np.float32)
    absolute = 1e9 if all_pixels else p.flying_sigmas * ke_per_m
    _inverse_depth(frame.depth_mm, 1e3 * info.min_range_m, 1e3 * longest_m, p.flying_relative, absolute, raw, inverse)
    if not all_pixels:
        scratch = np.zeros(inverse.size, np.uint8), np.empty(inverse.size, np.int32)
        near_px = p.min_support_m * k.fx
        _without_specks(inverse, SPECK_JUMP, SPECK_SIGMAS * ke_per_m, p.min_support_px, near_px, *scratch)
    return inverse


def cloud_of(frame: Rendered, ke_per_m: float, params: Params | None = None, *, all_pixels: bool = False) -> Cloud:
    """The cloud of one frame; ke_per_m: its true noise. The limits are those of `params`, our own method's.

    all_pixels: without any sorting but the ground's, all that was measured within the camera's range."""
    p, k = params or Params(), frame.info.intrinsics
    inverse = sorted_inverse_depth(frame, ke_per_m, p, all_pixels=all_pixels)
    out = np.empty((inverse.size, 3))
    ground = ground_in_level_cam(frame)
    camera = np.array([k.fx, k.fy, k.cx, k.cy])
    cap = p.ground_tolerance_cap * p.min_obstacle_height_m
    R = np.ascontiguousarray(frame.R_level_optical, np.float64)
    n = _points(inverse, camera, R, ground, p.ground_tolerance_m, p.ground_sigmas * ke_per_m, cap, out)
    return Cloud(out[:n].copy(), float(ground[0]), k.fx)

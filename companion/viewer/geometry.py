"""Geometry of the pictures: corners of planes, their projection into the source image, edges of the field of view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.frames import Rotation
from core.segment_distance import segment_distance_m
from core.types import FreeProfile, Ground, Intrinsics

Floats = NDArray[np.float64]

NEAR_M = 0.05
"""Depth below which polygons are clipped before the perspective division."""
EDGE_RAYS = 33
"""Rays along each edge of the image."""


def plane_corners_m(planes: NDArray[np.float32]) -> Floats:
    """(N, 4, 3) corners a-top, b-top, b-bottom, a-bottom of planes (N, 6) a_x, a_y, b_x, b_y, top, bottom."""
    ax, ay, bx, by, top, bottom = planes.astype(np.float64).T
    return np.stack(
        [np.stack(c, axis=-1) for c in ((ax, ay, top), (bx, by, top), (bx, by, bottom), (ax, ay, bottom))], axis=1
    )


def clip_near(polygon: Floats) -> Floats:
    """(M, 3) part of a polygon (K, 3), optical frame, with Z >= NEAR_M; M = 0 when nothing is left.

    Sutherland-Hodgman against the one plane that a perspective division needs."""
    kept: list[Floats] = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if p[2] >= NEAR_M:
            kept.append(p)
        if (p[2] >= NEAR_M) != (q[2] >= NEAR_M):
            kept.append(p + (q - p) * ((NEAR_M - p[2]) / (q[2] - p[2])))
    return np.array(kept) if kept else np.zeros((0, 3))


def project_px(points_optical: Floats, k: Intrinsics) -> Floats:
    """(M, 2) pixel coordinates u, v of points (M, 3) in front of the camera, optical frame, metres."""
    return np.stack(
        [
            k.fx * points_optical[:, 0] / points_optical[:, 2] + k.cx,
            k.fy * points_optical[:, 1] / points_optical[:, 2] + k.cy,
        ],
        axis=1,
    )


def outline_px(corners_m: Floats, R_level_optical: Rotation, k: Intrinsics) -> Floats:
    """(M, 2) outline in source pixels of a polygon (K, 3) in the target frame of R_level_optical (level_cam).

    It may extend beyond the image; M = 0 when it lies behind the camera."""
    clipped = clip_near(corners_m @ R_level_optical)
    return project_px(clipped, k) if len(clipped) else np.zeros((0, 2))


def nearest_m(planes: NDArray[np.float32]) -> Floats:
    """(N,) horizontal distance from the origin to the nearest point of each plane."""
    a, b = planes[:, 0:2].astype(np.float64), planes[:, 2:4].astype(np.float64)
    return segment_distance_m(np.zeros(2), a, b)


def free_normals(planes: NDArray[np.float32]) -> Floats:
    """(N, 2) unit vectors x, y to the free side: right of a -> b in the top view, (-dy, dx) with x forward, y right."""
    d = (planes[:, 2:4] - planes[:, 0:2]).astype(np.float64)
    normal = np.stack([-d[:, 1], d[:, 0]], axis=1)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9))


def level_range_m(ground: Ground, azimuth_rad: Floats) -> Floats:
    """(M,) horizontal range up to which the camera's height is above the ground in directions (M,); inf: everywhere.

    Includes the slope, the tolerance and the noise of the ground."""
    if not ground.seen:
        return np.full(len(azimuth_rad), np.inf)
    if not ground.height_m >= ground.tolerance_m:
        return np.zeros(len(azimuth_rad))
    rise = -ground.slope_x * np.cos(azimuth_rad) - ground.slope_y * np.sin(azimuth_rad)
    with np.errstate(divide="ignore"):
        tolerance = np.where(rise > 0.0, (ground.height_m - ground.tolerance_m) / rise, np.inf)
        noise = np.where(rise + ground.noise_per_m > 0.0, ground.height_m / (rise + ground.noise_per_m), np.inf)
    return np.asarray(np.minimum(tolerance, noise))


def lowest_free_m(ground: Ground, x_m: Floats) -> Floats:
    """(M,) largest z (down) of free space straight ahead at distances x_m (M,); inf: no limit."""
    if not ground.seen:
        return np.full(len(x_m), np.inf)
    margin_m = np.maximum(ground.tolerance_m, ground.noise_per_m * x_m)
    return np.asarray(ground.height_m + ground.slope_x * x_m - margin_m)


def layer_at(free: FreeProfile, z_m: float) -> int | None:
    """Index of the height layer that contains z_m (down); None: none."""
    layer = int(np.searchsorted(free.layer_edges_m, z_m, side="right")) - 1
    return layer if 0 <= layer < len(free.layer_edges_m) - 1 else None


def border_rays(k: Intrinsics, R_level_optical: Rotation) -> Floats:
    """(4 * EDGE_RAYS, 3) rays of the image border in level_cam, not normalised: top, right, bottom, left edge."""
    u = np.linspace(-0.5, k.width - 0.5, EDGE_RAYS)
    v = np.linspace(-0.5, k.height - 0.5, EDGE_RAYS)
    first, last_u, last_v = np.full(EDGE_RAYS, -0.5), np.full(EDGE_RAYS, u[-1]), np.full(EDGE_RAYS, v[-1])
    px = np.concatenate([np.stack(s, axis=1) for s in ((u, first), (last_u, v), (u[::-1], last_v), (first, v[::-1]))])
    rays = np.stack([(px[:, 0] - k.cx) / k.fx, (px[:, 1] - k.cy) / k.fy, np.ones(len(px))], axis=1)
    return rays @ R_level_optical.T


def field_of_view_rad(k: Intrinsics, R_level_optical: Rotation) -> tuple[float, float]:
    """(left, right) azimuths of the image border, rad clockwise from forward; the whole circle for a camera that looks
    steeply up or down."""
    rays = border_rays(k, R_level_optical)
    azimuth = np.unwrap(np.arctan2(rays[:, 1], rays[:, 0]))
    if abs(azimuth[-1] - azimuth[0]) > math.pi:
        return -math.pi, math.pi
    return float(azimuth.min()), float(azimuth.max())


def elevation_ahead_rad(k: Intrinsics, R_level_optical: Rotation) -> tuple[float, float]:
    """(lowest, highest) elevation of the image's middle column, rad, up positive."""
    v = np.array([k.height - 0.5, -0.5])
    u = (k.width - 1) / 2
    rays = np.stack([np.full(2, (u - k.cx) / k.fx), (v - k.cy) / k.fy, np.ones(2)], axis=1) @ R_level_optical.T
    angles = np.arctan2(-rays[:, 2], np.hypot(rays[:, 0], rays[:, 1]))
    return float(angles.min()), float(angles.max())

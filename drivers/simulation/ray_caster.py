"""Exact depth of solids by ray casting: each solid is intersected only with the rays inside its projected
bounds.

Rays start at the camera's centre and are ((u - cx)/fx, (v - cy)/fy, 1) in `optical`, so that the ray
parameter of a hit is its depth Z. Solids are rows of plain arrays in the world frame (drivers.simulation.scenes builds
them) and are moved into `optical` once per image."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.types import Intrinsics

_F = TypeVar("_F", bound=Callable[..., object])
Floats = NDArray[np.float64]

PLANE, CONVEX, ELLIPSOID, CYLINDER, DISC, RECTANGLE = 0, 1, 2, 3, 4, 5
"""Kinds of solids and their 12 numbers. PLANE: n (3), k with n.p = k. CONVEX: first and count of its
half-spaces. ELLIPSOID: centre (3), then the (3, 3) matrix M with |M (p - centre)| = 1 on the surface. CYLINDER: both
end points of the axis (6), radius. DISC: centre (3), unit normal (3), radius. RECTANGLE: one corner (3) and the two
perpendicular edges from it (6)."""
ROW = 12
NEAR_M = 1e-3


def _kernel(function: _F) -> _F:
    """The compiled form of a function, under its own type."""
    return cast(_F, njit(cache=True, nogil=True)(function))


@_kernel
def _pixel_bounds(
    corners: Floats,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    width: int,
    height: int,
    out: NDArray[np.int64],
) -> bool:
    """First and last column and row (inclusive) that a box can touch -> out (4,) int64; False when none.

    corners: (8, 3) in optical; bit i of the index is the side along axis i, so that edges differ in one bit.
    Edges are cut at a near plane, which keeps the bounds right for boxes that reach behind the camera."""
    near = 0.02
    u0, u1, v0, v1 = math.inf, -math.inf, math.inf, -math.inf
    for i in range(8):
        for bit in range(3):
            j = i | (1 << bit)
            if j == i:
                continue
            za, zb = corners[i, 2], corners[j, 2]
            if za < near and zb < near:
                continue
            ta, tb = 0.0, 1.0
            if za < near:
                ta = (near - za) / (zb - za)
            elif zb < near:
                tb = (near - za) / (zb - za)
            for t in (ta, tb):
                z = max(near, za + t * (zb - za))
                u = fx * (corners[i, 0] + t * (corners[j, 0] - corners[i, 0])) / z + cx
                v = fy * (corners[i, 1] + t * (corners[j, 1] - corners[i, 1])) / z + cy
                u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
    if not (u1 >= 0.0 and v1 >= 0.0 and u0 <= width - 1 and v0 <= height - 1):
        return False
    out[0] = max(0, math.ceil(u0 - 1e-6))
    out[1] = min(width - 1, math.floor(u1 + 1e-6))
    out[2] = max(0, math.ceil(v0 - 1e-6))
    out[3] = min(height - 1, math.floor(v1 + 1e-6))
    return True


@_kernel
def _hit_convex(x: float, y: float, halfspaces: Floats, first: int, count: int, limit: float) -> float:
    """Depth where the ray (x, y, 1) enters the intersection of half-spaces n.p <= k; inf when it misses."""
    enter, leave = NEAR_M, limit
    for i in range(first, first + count):
        along = halfspaces[i, 0] * x + halfspaces[i, 1] * y + halfspaces[i, 2]
        k = halfspaces[i, 3]
        if along < -1e-12:
            enter = max(enter, k / along)
        elif along > 1e-12:
            leave = min(leave, k / along)
        elif k < 0.0:
            return math.inf
        if enter > leave:
            return math.inf
    return enter if enter > NEAR_M else math.inf


@_kernel
def _hit_ellipsoid(x: float, y: float, q: Floats) -> float:
    """Depth of the nearer hit; q: centre (3) and matrix (9) in optical."""
    dx, dy, dz = q[3] * x + q[4] * y + q[5], q[6] * x + q[7] * y + q[8], q[9] * x + q[10] * y + q[11]
    ox = q[3] * q[0] + q[4] * q[1] + q[5] * q[2]
    oy = q[6] * q[0] + q[7] * q[1] + q[8] * q[2]
    oz = q[9] * q[0] + q[10] * q[1] + q[11] * q[2]
    a, b, c = dx * dx + dy * dy + dz * dz, dx * ox + dy * oy + dz * oz, ox * ox + oy * oy + oz * oz - 1.0
    root = b * b - a * c
    if root < 0.0 or c < 0.0:
        return math.inf
    t = (b - math.sqrt(root)) / a
    return t if t > NEAR_M else math.inf


@_kernel
def _hit_cylinder(x: float, y: float, q: Floats) -> float:
    """Depth of the nearest hit of a capped cylinder; q: ends of the axis (6) and radius in optical."""
    wx, wy, wz = q[3] - q[0], q[4] - q[1], q[5] - q[2]
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = wx / length, wy / length, wz / length
    dw, aw = x * wx + y * wy + wz, q[0] * wx + q[1] * wy + q[2] * wz
    px, py, pz = x - dw * wx, y - dw * wy, 1.0 - dw * wz
    mx, my, mz = q[0] - aw * wx, q[1] - aw * wy, q[2] - aw * wz
    r2 = q[6] * q[6]
    best = math.inf
    a, b, c = px * px + py * py + pz * pz, px * mx + py * my + pz * mz, mx * mx + my * my + mz * mz - r2
    root = b * b - a * c
    if root < 0.0:
        return math.inf
    if a > 1e-15:
        t = (b - math.sqrt(root)) / a
        if t > NEAR_M and 0.0 <= t * dw - aw <= length:
            best = t
    if abs(dw) > 1e-12:
        for cap in (0.0, length):
            t = (aw + cap) / dw
            ex, ey, ez = t * px - mx, t * py - my, t * pz - mz
            if NEAR_M < t < best and ex * ex + ey * ey + ez * ez <= r2:
                best = t
    return best


@_kernel
def _hit_disc(x: float, y: float, q: Floats) -> float:
    """Depth of the hit of a disc; q: centre (3), normal (3), radius in optical."""
    along = q[3] * x + q[4] * y + q[5]
    if abs(along) < 1e-12:
        return math.inf
    t = (q[3] * q[0] + q[4] * q[1] + q[5] * q[2]) / along
    ex, ey, ez = t * x - q[0], t * y - q[1], t - q[2]
    return t if t > NEAR_M and ex * ex + ey * ey + ez * ez <= q[6] * q[6] else math.inf


@_kernel
def _hit_rectangle(x: float, y: float, q: Floats) -> float:
    """Depth of the hit of a rectangle; q: corner (3) and both edges (6) in optical."""
    nx, ny, nz = q[4] * q[8] - q[5] * q[7], q[5] * q[6] - q[3] * q[8], q[3] * q[7] - q[4] * q[6]
    along = nx * x + ny * y + nz
    if along == 0.0:
        return math.inf
    t = (nx * q[0] + ny * q[1] + nz * q[2]) / along
    ex, ey, ez = t * x - q[0], t * y - q[1], t - q[2]
    for i in (3, 6):
        share = ex * q[i] + ey * q[i + 1] + ez * q[i + 2]
        if share < 0.0 or share > q[i] * q[i] + q[i + 1] * q[i + 1] + q[i + 2] * q[i + 2]:
            return math.inf
    return t if t > NEAR_M else math.inf


@_kernel
def _to_optical(kind: int, q: Floats, R: Floats, origin: Floats, out: Floats) -> None:
    """One solid's row in optical -> out (12,); R = R_world_optical, origin: the camera's centre in the
    world."""
    if kind == PLANE:
        for j in range(3):
            out[j] = R[0, j] * q[0] + R[1, j] * q[1] + R[2, j] * q[2]
        out[3] = q[3] - (q[0] * origin[0] + q[1] * origin[1] + q[2] * origin[2])
        return
    for j in range(3):
        out[j] = R[0, j] * (q[0] - origin[0]) + R[1, j] * (q[1] - origin[1]) + R[2, j] * (q[2] - origin[2])
    if kind == ELLIPSOID:
        for i in range(3):
            for j in range(3):
                out[3 + 3 * i + j] = q[3 + 3 * i] * R[0, j] + q[4 + 3 * i] * R[1, j] + q[5 + 3 * i] * R[2, j]
    elif kind == CYLINDER:
        for j in range(3):
            out[3 + j] = R[0, j] * (q[3] - origin[0]) + R[1, j] * (q[4] - origin[1]) + R[2, j] * (q[5] - origin[2])
        out[6] = q[6]
    else:
        for j in range(3):
            out[3 + j] = R[0, j] * q[3] + R[1, j] * q[4] + R[2, j] * q[5]
            out[6 + j] = R[0, j] * q[6] + R[1, j] * q[7] + R[2, j] * q[8]
        if kind == DISC:
            out[6] = q[6]


class _Solids(NamedTuple):
    """Tables of `cast_rays`, with the half-spaces in optical."""

    kinds: NDArray[np.int32]
    rows: Floats
    corners: Floats
    halfspaces: Floats


class _Pinhole(NamedTuple):
    fx: float
    fy: float
    cx: float
    cy: float


@_kernel
def _cast(solids: _Solids, camera: _Pinhole, R: Floats, origin: Floats, z: Floats, which: NDArray[np.int32]) -> None:
    """Nearest depth and index of the solid for each pixel, into z (H, W) float64 and which (H, W) int32."""
    kinds, rows, corners, halfspaces = solids.kinds, solids.rows, solids.corners, solids.halfspaces
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    height, width = z.shape
    bounds, q, box = np.empty(4, np.int64), np.empty(ROW), np.empty((8, 3))
    for s in range(kinds.shape[0]):
        kind = kinds[s]
        first, count = 0, 0
        if kind == CONVEX:
            first, count = int(rows[s, 0]), int(rows[s, 1])
        else:
            _to_optical(kind, rows[s], R, origin, q)
        bounds[0], bounds[1], bounds[2], bounds[3] = 0, width - 1, 0, height - 1
        if kind != PLANE:
            for i in range(8):
                for j in range(3):
                    box[i, j] = 0.0
                    for k in range(3):
                        box[i, j] += R[k, j] * (corners[s, i, k] - origin[k])
            if not _pixel_bounds(box, fx, fy, cx, cy, width, height, bounds):
                continue
        for v in range(bounds[2], bounds[3] + 1):
            y = (v - cy) / fy
            for u in range(bounds[0], bounds[1] + 1):
                x = (u - cx) / fx
                if kind == CONVEX:
                    t = _hit_convex(x, y, halfspaces, first, count, z[v, u])
                elif kind == ELLIPSOID:
                    t = _hit_ellipsoid(x, y, q)
                elif kind == CYLINDER:
                    t = _hit_cylinder(x, y, q)
                elif kind == DISC:
                    t = _hit_disc(x, y, q)
                elif kind == RECTANGLE:
                    t = _hit_rectangle(x, y, q)
                else:
                    along = q[0] * x + q[1] * y + q[2]
                    t = q[3] / along if along != 0.0 and q[3] / along > NEAR_M else math.inf
                if t < z[v, u]:
                    z[v, u] = t
                    which[v, u] = s


def cast_rays(
    kinds: NDArray[np.int32],
    rows: Floats,
    corners: Floats,
    halfspaces: Floats,
    intrinsics: Intrinsics,
    R_world_optical: Floats,
    origin_m: Floats,
) -> tuple[Floats, NDArray[np.int32]]:
    """Depth Z (H, W) float64, metres, inf where the ray leaves the scene, and the solid's index (H, W) int32
    or -1.

    kinds: (S,); rows: (S, 12); corners: (S, 8, 3) of a box around each solid; halfspaces: (M, 4) n, k of the
    convex solids, all in the world frame, metres."""
    k = intrinsics
    z = np.full((k.height, k.width), np.inf)
    which = np.full((k.height, k.width), -1, np.int32)
    R = np.array(R_world_optical, dtype=np.float64, order="C")
    origin = np.array(origin_m, dtype=np.float64)
    local = np.empty((len(halfspaces), 4))
    local[:, :3] = halfspaces[:, :3] @ R
    local[:, 3] = halfspaces[:, 3] - halfspaces[:, :3] @ origin
    solids = _Solids(np.array(kinds), np.array(rows), np.array(corners), local)
    _cast(solids, _Pinhole(k.fx, k.fy, k.cx, k.cy), R, origin, z, which)
    return z, which

"""Rays and distances of models other than upright rectangles: boxes (voxels) and rectangles of any orientation.

The figures are those of benchmarks.fidelity.metrics. For upright rectangles both agree
(tests/benchmarks/test_solids.py)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.types import Intrinsics
from drivers.simulation.ray_caster import CONVEX, RECTANGLE, ROW, cast_rays

Floats = NDArray[np.float64]
_BITS = (np.arange(8)[:, None] >> np.arange(3)) & 1


def box_stops(boxes: Floats, intrinsics: Intrinsics, R_axes_optical: Floats) -> Floats:
    """Depth Z (H, W) at which each pixel's ray enters a box, inf: none, 0 where the camera is inside one.

    boxes: (N, 6) least x, y, z, greatest x, y, z, metres, seen from the camera at the origin of their axes."""
    b = np.asarray(boxes, np.float64).reshape(-1, 6)
    if np.any(np.all((b[:, :3] <= 0.0) & (b[:, 3:] >= 0.0), axis=1)):
        return np.zeros((intrinsics.height, intrinsics.width))
    count = len(b)
    halfspaces = np.zeros((count, 6, 4))
    for axis in range(3):
        halfspaces[:, axis, axis], halfspaces[:, axis, 3] = -1.0, -b[:, axis]
        halfspaces[:, 3 + axis, axis], halfspaces[:, 3 + axis, 3] = 1.0, b[:, 3 + axis]
    rows = np.zeros((count, ROW))
    rows[:, 0], rows[:, 1] = 6.0 * np.arange(count), 6.0
    corners = np.where(_BITS[None] == 1, b[:, None, 3:], b[:, None, :3])
    kinds = np.full(count, CONVEX, np.int32)
    planes = halfspaces.reshape(-1, 4)
    return cast_rays(kinds, rows, corners, planes, intrinsics, R_axes_optical, np.zeros(3))[0]


def patch_stops(patches: Floats, intrinsics: Intrinsics, R_axes_optical: Floats) -> Floats:
    """Depth Z (H, W) at which each pixel's ray first meets a rectangle from either side, inf: none.

    patches: (N, 9) a corner and the two perpendicular edges from it, metres."""
    p = np.asarray(patches, np.float64).reshape(-1, 9)
    rows = np.zeros((len(p), ROW))
    rows[:, :9] = p
    corners = p[:, None, 0:3] + _BITS[None, :, 0:1] * p[:, None, 3:6] + _BITS[None, :, 1:2] * p[:, None, 6:9]
    kinds = np.full(len(p), RECTANGLE, np.int32)
    return cast_rays(kinds, rows, corners, np.zeros((0, 4)), intrinsics, R_axes_optical, np.zeros(3))[0]


@njit(cache=True, nogil=True)
def _patch_distances(points, patches, out):
    """Distance of each point (P, 3) to the nearest rectangle (N, 9)."""
    normal = np.empty(3)
    for i in range(points.shape[0]):
        best = np.inf
        for j in range(patches.shape[0]):
            height = 0.0
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                normal[a] = patches[j, 3 + b] * patches[j, 6 + c] - patches[j, 3 + c] * patches[j, 6 + b]
                height += normal[a] * (points[i, a] - patches[j, a])
            size2 = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2
            d2 = height * height / size2 if size2 > 0.0 else 0.0
            for first in (3, 6):
                along, length2 = 0.0, 0.0
                for a in range(3):
                    along += patches[j, first + a] * (points[i, a] - patches[j, a])
                    length2 += patches[j, first + a] ** 2
                if length2 > 0.0:
                    beyond = max(0.0, -along, along - length2)
                    d2 += beyond * beyond / length2
            best = min(best, d2)
        out[i] = np.sqrt(best)


def patch_distances(points_m: Floats, patches: Floats) -> Floats:
    """(P,) distance of each point (P, 3) to the nearest rectangle with an area, of (N, 9) patches; inf without any."""
    p = np.ascontiguousarray(patches, np.float64).reshape(-1, 9)
    out = np.full(len(points_m), np.inf)
    if len(p) and len(points_m):
        _patch_distances(np.ascontiguousarray(points_m, np.float64), p, out)
    return out


@njit(cache=True, nogil=True)
def _box_distances(points, boxes, low, side, shape, first, members, reach, out):
    """Distance of each point to the nearest box; boxes are listed by the grid cell of their centre.

    low, side, shape: of the grid; first: (cells + 1,), members: (N,) boxes by cell; reach: the greatest distance from a
    box's centre to its corner. Cells are searched in growing cubes until none can hold anything nearer."""
    cell = np.empty(3, np.int64)
    for i in range(points.shape[0]):
        outside = 0
        for a in range(3):
            cell[a] = np.int64(np.floor((points[i, a] - low[a]) / side))
            outside = max(outside, -cell[a], cell[a] - shape[a] + 1)
        best = np.inf
        widest = max(shape[0], shape[1], shape[2]) + outside
        for ring in range(outside, widest + 1):
            # what lies in this ring or beyond has its centre at least (ring - 1) sides away
            if (ring - 1) * side - reach > best:
                break
            for x in range(max(0, cell[0] - ring), min(shape[0], cell[0] + ring + 1)):
                for y in range(max(0, cell[1] - ring), min(shape[1], cell[1] + ring + 1)):
                    rim = abs(x - cell[0]) == ring or abs(y - cell[1]) == ring
                    step = 1 if rim else max(1, 2 * ring)
                    from_z = cell[2] - ring
                    for k in range(0, 2 * ring + 1, step):
                        z = from_z + k
                        if z < 0 or z >= shape[2]:
                            continue
                        at = (x * shape[1] + y) * shape[2] + z
                        for m in range(first[at], first[at + 1]):
                            d2 = 0.0
                            for a in range(3):
                                off = max(
                                    0.0, boxes[members[m], a] - points[i, a], points[i, a] - boxes[members[m], 3 + a]
                                )
                                d2 += off * off
                            best = min(best, np.sqrt(d2))
        out[i] = best


def box_distances(points_m: Floats, boxes: Floats) -> Floats:
    """(P,) distance of each point (P, 3) to the nearest box of (N, 6), 0 inside; inf without boxes.

    A box without thickness is a rectangle. Fast where boxes are of about one size."""
    b = np.ascontiguousarray(boxes, np.float64).reshape(-1, 6)
    out = np.full(len(points_m), np.inf)
    if not len(b) or not len(points_m):
        return out
    centre, size = 0.5 * (b[:, :3] + b[:, 3:]), b[:, 3:] - b[:, :3]
    low, high = centre.min(axis=0), centre.max(axis=0)
    # at most a few million cells, whatever the boxes are
    side = max(float(np.median(size.max(axis=1))), float(np.prod(np.maximum(high - low, 1e-6)) / 4e6) ** (1 / 3), 1e-3)
    shape = np.floor((high - low) / side).astype(np.int64) + 1
    at = np.floor((centre - low) / side).astype(np.int64)
    index = np.ravel_multi_index(tuple(at.T), tuple(shape))
    members = np.argsort(index, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(index, minlength=int(np.prod(shape))))])
    reach = float(0.5 * np.linalg.norm(size, axis=1).max())
    points = np.ascontiguousarray(points_m, np.float64)
    _box_distances(points, b, low, side, shape, first, members, reach, out)
    return out


def cube_faces(indices: NDArray[np.int64], side_m: float, origin_m: Floats) -> Floats:
    """(F, 6) boxes without thickness: the faces of cubes (N, 3 indices) that no other cube covers."""
    cells = np.asarray(indices, np.int64).reshape(-1, 3)
    if not len(cells):
        return np.zeros((0, 6))
    low = cells.min(axis=0) - 1
    full = np.zeros(cells.max(axis=0) - low + 2, np.bool_)
    full[tuple((cells - low).T)] = True
    faces = []
    for axis in range(3):
        for side in (0, 1):
            beyond = cells - low
            beyond[:, axis] += 2 * side - 1
            bare = cells[~full[tuple(beyond.T)]]
            start, end = bare.astype(np.float64), bare + 1.0
            start[:, axis] = end[:, axis] = bare[:, axis] + side
            faces.append(np.hstack([start, end]))
    return np.vstack(faces) * side_m + np.tile(origin_m, 2)

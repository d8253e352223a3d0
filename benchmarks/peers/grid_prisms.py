"""The grid baseline in the manner of 3DP: occupied cells of a 2-D grid per 2 m of height, outlined by polygons.

What it is given is generous (benchmarks.peers.cloud), and its polygons are simplified: staircases become lines, free
spots within an obstacle that are too small to pass are no polygons of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.peers.cloud import Cloud, cloud_of
from benchmarks.peers.grid_outlines import outlines, signed_area
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
CELLS_M = (0.1, 0.2, 0.4, 0.8)
LAYER_M = 2.0
MIN_POINTS = 3
"""Points that make a cell occupied: fewer are taken for noise."""
MIN_SHARE, HEIGHT_M = 0.05, 0.6
"""And this share of the points that something of the least height right across the cell would show at its distance.

Chosen on tuning seeds for the baseline's sake: of 0, 2, 5, 10, 20 and 40 % it is the greatest that hardly costs it an
obstacle; against none it takes up to a quarter off its planes at 0.8 m and off its error at 0.1 m in noise."""
FOCAL_PX = 450.0
EPSILON_CELLS = 0.75
"""Tolerance of the simplification in cells: just above the 0.71 that turns a diagonal staircase into a line."""
HOLE_M = 2.0
"""Free spots inside an outline that are narrower than this either way are filled: the vehicle's width, Ws."""


@dataclass(frozen=True, slots=True, eq=False)
class GridPrisms:
    """planes: (N, 6) level_cam, the polygons' sides with free space on their right; layer: (N,) int64 of each; polygons:
    how many; bytes: 8 a vertex and 8 a polygon; ground_z_m: bottom of layer 0."""

    planes: Floats
    layer: NDArray[np.int64]
    polygons: int
    bytes: int
    ground_z_m: float


def obstacle_points(frame: Rendered, ke_per_m: float) -> Floats:
    """(P, 3) measured points above the ground in level_cam, from the noisy depth; ke_per_m: its true noise."""
    return cloud_of(frame, ke_per_m).points_m


def grid_of(cloud: Cloud, cell_m: float, *, epsilon_cells: float = EPSILON_CELLS) -> GridPrisms:
    """The baseline as it is compared with: prisms around a frame's cloud, cells judged by the camera's focal length."""
    return grid_prisms(cloud.points_m, cloud.ground_z_m, cell_m, focal_px=cloud.focal_px, epsilon_cells=epsilon_cells)


@njit(cache=True, nogil=True)
def _bounds(points, out):
    """Least and greatest x, y and z of points (P, 3) -> out (2, 3)."""
    out[0], out[1] = points[0], points[0]
    for i in range(points.shape[0]):
        for axis in range(3):
            out[0, axis], out[1, axis] = min(out[0, axis], points[i, axis]), max(out[1, axis], points[i, axis])


@njit(cache=True, nogil=True)
def _count(points, ground_z, per_layer, per_cell, first, counts):
    """Adds the points to counts (layers, X, Y) int32; first: layer, x and y of its first cell. Nothing is below it."""
    for i in range(points.shape[0]):
        layer = np.int32((ground_z - points[i, 2]) * per_layer - first[0])
        x = np.int32(points[i, 0] * per_cell - first[1])
        y = np.int32(points[i, 1] * per_cell - first[2])
        counts[layer, x, y] += 1


def counted(points_m: Floats, ground_z_m: float, cell_m: float) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Points in each cell, (layers, X, Y) with a free rim around x and y, and layer, x and y of the first cell."""
    box = np.empty((2, 3))
    _bounds(points_m, box)
    heights = np.floor((ground_z_m - box[::-1, 2]) / LAYER_M).astype(np.int64)
    low, high = np.floor(box[:, :2] / cell_m).astype(np.int64) + np.array([[-1], [1]])
    first = np.array([heights[0], *low])
    counts = np.zeros((heights[1] - heights[0] + 1, *(high - low + 1)), np.int32)
    _count(points_m, ground_z_m, 1.0 / LAYER_M, 1.0 / cell_m, first.astype(np.float64), counts)
    return counts, first


def least_points(shape: tuple[int, int], first: NDArray[np.int64], cell_m: float, focal_px: float) -> Floats:
    """(X, Y) points that make each cell of a grid occupied; first: x and y of its first cell, in cells."""
    x, y = ((np.arange(n) + start + 0.5) * cell_m for n, start in zip(shape, first, strict=True))
    range2 = np.maximum(x[:, None] ** 2 + y**2, cell_m**2)
    return np.asarray(np.maximum(MIN_POINTS, MIN_SHARE * focal_px**2 * cell_m * HEIGHT_M / range2))


def grid_prisms(
    points_m: Floats,
    ground_z_m: float,
    cell_m: float,
    *,
    focal_px: float = FOCAL_PX,
    epsilon_cells: float = EPSILON_CELLS,
) -> GridPrisms:
    """Prisms around points (P, 3) in level_cam above a ground at z = ground_z_m, in layers of 2 m.

    focal_px: of the camera, for the least share of points (default: that of the simulator's images of 640 pixels); 0:
    MIN_POINTS only. epsilon_cells = 0: collinear sides are merged, without further simplification."""
    points = np.ascontiguousarray(points_m, np.float64)
    if not len(points):
        return GridPrisms(np.zeros((0, 6)), np.zeros(0, np.int64), 0, 0, ground_z_m)
    counts, first = counted(points, ground_z_m, cell_m)
    occupied = counts >= least_points(counts.shape[1:], first[1:], cell_m, focal_px)
    planes: list[Floats] = []
    layers: list[NDArray[np.int64]] = []
    for k in range(len(counts)):
        bottom = ground_z_m - (first[0] + k) * LAYER_M
        for loop in outlines(occupied[k]):
            corners = (simplified(loop, cell_m, epsilon_cells) + first[1:]) * cell_m
            if len(corners):
                planes.append(_sides(corners, bottom))
                layers.append(np.full(len(corners), first[0] + k, np.int64))
    joined = np.vstack(planes) if planes else np.zeros((0, 6))
    layer = np.concatenate(layers) if layers else np.zeros(0, np.int64)
    return GridPrisms(joined, layer, len(planes), 8 * len(joined) + 8 * len(planes), ground_z_m)


def simplified(loop: NDArray[np.int64], cell_m: float, epsilon_cells: float) -> Floats:
    """Corners (M, 2) of an outline, in cells, simplified within epsilon_cells; none for a spot that is too small."""
    if signed_area(loop) > 0.0 and np.min(loop.max(axis=0) - loop.min(axis=0)) * cell_m < HOLE_M:
        return np.zeros((0, 2))
    if epsilon_cells <= 0.0 or len(loop) <= 4:
        return loop.astype(np.float64)
    simple = cv2.approxPolyDP(loop.astype(np.float32).reshape(-1, 1, 2), epsilon_cells, True).reshape(-1, 2)
    return simple.astype(np.float64)


def _sides(corners: Floats, bottom_m: float) -> Floats:
    """(M, 6) planes along a closed outline (M, 2)."""
    out = np.empty((len(corners), 6))
    out[:, 0:2], out[:-1, 2:4], out[-1, 2:4] = corners, corners[1:], corners[0]
    out[:, 4], out[:, 5] = bottom_m - LAYER_M, bottom_m
    return out


def facing_camera(planes: Floats) -> NDArray[np.bool_]:
    """(N,) whether the camera at the origin is on the free side of a plane: the others no single view can see."""
    ax, ay, bx, by = planes[:, :4].T
    return np.asarray(ax * by - ay * bx > 0.0)

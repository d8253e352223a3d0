"""The grid baseline's prisms as bodies: what is inside is occupied, and tops and bottoms stop rays too."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import distances, stops
from benchmarks.peers.grid_prisms import LAYER_M, GridPrisms
from core.types import Intrinsics

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def _inside(x, y, planes, first, last):
    """Whether (x, y) is inside the outlines planes[first:last], by the parity of the sides to one side of it."""
    odd = False
    for i in range(first, last):
        ay, by = planes[i, 1], planes[i, 3]
        if (ay > y) != (by > y) and planes[i, 0] + (y - ay) / (by - ay) * (planes[i, 2] - planes[i, 0]) > x:
            odd = not odd
    return odd


@njit(cache=True, nogil=True)
def _through_lids(depth, camera, R, planes, first, least, ground_z, layer_m, boxes):
    """Shortens depth (H, W) where a ray enters a prism through its top or bottom, or starts inside one.

    first: (layers + 1,) planes by layer from `least` on; boxes: (layers, 4) least x, y and greatest x, y of each."""
    layers = first.shape[0] - 1
    own = np.int64(np.floor(ground_z / layer_m)) - least
    if 0 <= own < layers and _inside(0.0, 0.0, planes, first[own], first[own + 1]):
        depth[:] = 0.0
        return
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            a, b = (u - camera[2]) / camera[0], (v - camera[3]) / camera[1]
            dx, dy, dz = (
                R[0, 0] * a + R[0, 1] * b + R[0, 2],
                R[1, 0] * a + R[1, 1] * b + R[1, 2],
                R[2, 0] * a + R[2, 1] * b + R[2, 2],
            )
            for k in range(layers):
                # going down a ray enters layer k through its top, going up through its bottom
                lid = ground_z - (least + k + (1 if dz > 0.0 else 0)) * layer_m
                t = lid / dz if dz != 0.0 else -1.0
                if not 0.0 < t < depth[v, u]:
                    continue
                x, y = t * dx, t * dy
                near = boxes[k, 0] <= x <= boxes[k, 2] and boxes[k, 1] <= y <= boxes[k, 3]
                if near and _inside(x, y, planes, first[k], first[k + 1]):
                    depth[v, u] = t


@njit(cache=True, nogil=True)
def _body(points, planes, first, least, ground_z, layer_m, out):
    """Lessens out (P,), the distance to the sides, to that to the bodies: 0 inside, or to a top or bottom."""
    layers = first.shape[0] - 1
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(layers):
            bottom = ground_z - (least + k) * layer_m
            off = max(0.0, z - bottom, bottom - layer_m - z)
            if off < out[i] and _inside(x, y, planes, first[k], first[k + 1]):
                out[i] = off


def _by_layer(model: GridPrisms) -> tuple[NDArray[np.int64], int]:
    """First plane of each layer, and the lowest layer. The planes are in the order of their layers."""
    least, most = int(model.layer[0]), int(model.layer[-1])
    return np.searchsorted(model.layer, np.arange(least, most + 2)), least


def prism_stops(model: GridPrisms, intrinsics: Intrinsics, R_level_optical: Floats) -> Floats:
    """Depth Z (H, W) at which each pixel's ray first meets a prism, inf: none, 0 where the camera is inside one."""
    depth = stops(model.planes, intrinsics, R_level_optical)[0]
    if model.polygons:
        first, least = _by_layer(model)
        boxes = np.array([[np.inf, np.inf, -np.inf, -np.inf]] * (len(first) - 1))
        for i in range(len(boxes)):
            p = model.planes[first[i] : first[i + 1]]
            if len(p):
                boxes[i] = [*p[:, :2].min(axis=0), *p[:, :2].max(axis=0)]
        k = intrinsics
        camera, R = np.array([k.fx, k.fy, k.cx, k.cy]), np.ascontiguousarray(R_level_optical, np.float64)
        _through_lids(depth, camera, R, model.planes, first, least, model.ground_z_m, LAYER_M, boxes)
    return depth


def body_distances(model: GridPrisms, points_m: Floats) -> Floats:
    """(P,) distance of each point (P, 3) to the nearest prism, 0 inside one; inf without prisms."""
    out = distances(points_m, model.planes)
    if model.polygons and len(points_m):
        first, least = _by_layer(model)
        _body(np.ascontiguousarray(points_m), model.planes, first, least, model.ground_z_m, LAYER_M, out)
    return out

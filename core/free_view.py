"""The free ranges of a frame as the merged world and the tracker use them, and their bytes for the tracker's state."""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np

from .jit import inner
from .types import FrameModel

_HEAD = struct.Struct("<q8dii")
"""Stamp; x_m, y_m, ke_per_m, ground_z_m, slope_x, slope_y, tolerance_m, noise_per_m; directions and layers."""
NO_DIRECTION = -1


class FreeView(NamedTuple):
    """What one frame observed to be free, with north-aligned axes (z down)."""

    x_m: Any  # x_m, y_m: place of the camera
    y_m: Any
    ke_per_m: Any  # noise coefficient, 1/m
    edges_rad: Any  # (D + 1,) float64 azimuths of its FreeProfile
    layers_m: Any  # (L + 1,) float64 heights of the edges of its layers, m
    near_m: Any  # near_m, far_m: (D, L) float32 horizontal free ranges
    far_m: Any
    end: Any  # (D, L) uint8 FreeEnd
    ground_z_m: Any  # z of the ground below the camera; inf: no ground was found
    slope_x: Any  # slope_x, slope_y, tolerance_m, noise_per_m: of its Ground
    slope_y: Any
    tolerance_m: Any
    noise_per_m: Any


@inner
def azimuth_from(first, azimuth):
    """Returns the azimuth of the same direction that is less than a turn beyond `first`."""
    turn = azimuth - first
    return turn - math.floor(turn / math.tau) * math.tau + first


@inner
def direction_at(edges, azimuth):
    """Returns the direction that holds an azimuth between the first and last edge."""
    return max(np.searchsorted(edges, azimuth, side="right") - 1, 0)  # rounding may put it before the first edge


@inner
def direction_of(edges, azimuth):
    """Returns the direction that holds an azimuth; NO_DIRECTION: it is outside of the view."""
    azimuth = azimuth_from(edges[0], azimuth)
    return direction_at(edges, azimuth) if azimuth < edges[-1] else NO_DIRECTION


@inner
def lowest_free(x, y, r, radius, view):
    """Returns the z down to which a circle of a radius at (x, y) from the camera, at range r, can be free: above the
    ground and its noise."""
    z = view.ground_z_m + view.slope_x * x + view.slope_y * y
    highest = z - math.sqrt(view.slope_x**2 + view.slope_y**2) * radius
    return highest - max(view.tolerance_m, view.noise_per_m * (r + radius))


def free_view(model: FrameModel, camera_m: tuple[float, float, float]) -> FreeView:
    """Returns the free ranges of a model from a camera at that place. Where they or the ground are not finite, or the
    model is invalid, there are none: D and L are 0."""
    profile, ground = model.free, model.ground
    edges, layers = profile.azimuth_edges_rad.astype(np.float64), profile.layer_edges_m.astype(np.float64)
    near, far, end = profile.free_from_m, profile.free_to_m, profile.end
    good = model.valid and all(np.isfinite(a).all() for a in (edges, layers, near, far))
    plane = (math.inf, 0.0, 0.0, 0.0, 0.0)
    if ground.seen:
        z_m = camera_m[2] + ground.height_m
        plane = (z_m, ground.slope_x, ground.slope_y, ground.tolerance_m, ground.noise_per_m)
        good = good and bool(np.isfinite(plane).all())
    if not good or len(edges) < 2 or len(layers) < 2:
        edges, layers = np.zeros(0), np.zeros(0)
        near = far = np.zeros((0, 0), np.float32)
        end = np.zeros((0, 0), np.uint8)
    x_m, y_m, ke_per_m = float(camera_m[0]), float(camera_m[1]), float(model.ke_per_m)
    near, far = np.array(near, np.float32, order="C"), np.array(far, np.float32, order="C")
    return FreeView(
        x_m, y_m, ke_per_m, edges, layers, near, far, np.array(end, np.uint8, order="C"), *map(float, plane)
    )


def view_bytes(view: FreeView, t_ns: int) -> bytes:
    """Returns the bytes of a view."""
    ground = view.ground_z_m, view.slope_x, view.slope_y, view.tolerance_m, view.noise_per_m
    head = _HEAD.pack(t_ns, view.x_m, view.y_m, view.ke_per_m, *ground, *view.near_m.shape)
    arrays = (view.edges_rad, view.layers_m, view.near_m, view.far_m, view.end)
    return head + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)


def view_from_bytes(data: bytes) -> tuple[int, FreeView]:
    """Returns (stamp, view) of `view_bytes`. Raises ValueError for bytes of another length."""
    if len(data) < _HEAD.size:
        raise ValueError("tracker state: a view of free ranges is cut short")
    t_ns, x, y, ke, z, slope_x, slope_y, tolerance, noise, d, layers = _HEAD.unpack_from(data)
    shapes = (((d + 1) if d else 0,), ((layers + 1) if d else 0,), (d, layers), (d, layers), (d, layers))
    kinds = (np.float64, np.float64, np.float32, np.float32, np.uint8)
    if (
        d < 0
        or layers < 0
        or len(data)
        != _HEAD.size + sum(math.prod(s) * np.dtype(k).itemsize for s, k in zip(shapes, kinds, strict=True))
    ):
        raise ValueError("tracker state: a view of free ranges does not have its stated size")
    arrays, at = [], _HEAD.size
    for shape, kind in zip(shapes, kinds, strict=True):
        count = math.prod(shape)
        arrays.append(np.frombuffer(data, kind, count, at).reshape(shape).copy())
        at += count * np.dtype(kind).itemsize
    edges, rows, near, far, end = arrays
    return t_ns, FreeView(x, y, ke, edges, rows, near, far, end, z, slope_x, slope_y, tolerance, noise)

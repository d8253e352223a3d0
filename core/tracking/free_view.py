"""The free ranges of a frame as kernels use them, and their bytes for the tracker's state."""

from __future__ import annotations

import math
import struct

import numpy as np

from ..types import FrameModel
from .observed import FreeView

_HEAD = struct.Struct("<q8dii")
"""Stamp; x_m, y_m, ke_per_m, ground_z_m, slope_x, slope_y, tolerance_m, noise_per_m; directions and layers."""


def free_view(model: FrameModel, camera_m: tuple[float, float, float]) -> FreeView:
    """The free ranges of a model from a camera at that place. A profile that is not finite shows nothing."""
    profile, ground = model.free, model.ground
    edges, layers = profile.azimuth_edges_rad.astype(np.float64), profile.layer_edges_m.astype(np.float64)
    near, far, end = profile.free_from_m, profile.free_to_m, profile.end
    good = model.valid and all(np.isfinite(a).all() for a in (edges, layers, near, far))
    if not good or len(edges) < 2 or len(layers) < 2:
        edges, layers = np.zeros(0), np.zeros(0)
        near = far = np.zeros((0, 0), np.float32)
        end = np.zeros((0, 0), np.uint8)
    plane = (math.inf, 0.0, 0.0, 0.0, 0.0)
    if ground.seen:
        z_m = camera_m[2] + ground.height_m
        plane = (z_m, ground.slope_x, ground.slope_y, ground.tolerance_m, ground.noise_per_m)
    near, far = np.array(near, np.float32, order="C"), np.array(far, np.float32, order="C")
    floats = [float(v) for v in plane]
    return FreeView(
        float(camera_m[0]),
        float(camera_m[1]),
        float(model.ke_per_m),
        edges,
        layers,
        near,
        far,
        np.array(end, np.uint8, order="C"),
        *floats,
    )


def view_bytes(view: FreeView, t_ns: int) -> bytes:
    """The bytes of a view."""
    numbers = (
        view.x_m,
        view.y_m,
        view.ke_per_m,
        view.ground_z_m,
        view.slope_x,
        view.slope_y,
        view.tolerance_m,
        view.noise_per_m,
    )
    head = _HEAD.pack(t_ns, *numbers, *view.near_m.shape)
    arrays = (view.edges_rad, view.layers_m, view.near_m, view.far_m, view.end)
    return head + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)


def view_from_bytes(data: bytes) -> tuple[int, FreeView]:
    """(stamp, view) of `view_bytes`. Raises ValueError for bytes of another length."""
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

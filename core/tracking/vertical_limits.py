"""The heights that a frame measured, for each direction of its free ranges: what lies above or below them is out of view.

The image is not part of a model. A layer is free only from where the whole of it is in the image, so that the ray to each of its
edges there lies in the image. Between the highest and the lowest of these rays the frame measured something.
"""

from __future__ import annotations

import math

import numpy as np

from ..free_view import NO_DIRECTION, direction_of, lowest_free
from ..jit import inner, kernel

_LEAST_RANGE_M = 1e-3


@kernel
def vertical_limits(view, eye_z):
    """Slopes dz/dr of the highest and the lowest measured ray of each direction -> (D, 2) float64; (inf, -inf): nothing was
    measured in it. view: FreeView; eye_z: height of the camera."""
    count = view.near_m.shape[0]
    limits = np.empty((count, 2))
    for d in range(count):
        azimuth = 0.5 * (view.edges_rad[d] + view.edges_rad[d + 1])
        c, s = math.cos(azimuth), math.sin(azimuth)
        highest, lowest = math.inf, -math.inf
        for k in range(view.near_m.shape[1]):
            r = max(view.near_m[d, k], _LEAST_RANGE_M)
            if view.far_m[d, k] <= r:
                continue
            bottom = min(view.layers_m[k + 1], lowest_free(r * c, r * s, r, 0.0, view))
            highest, lowest = min(highest, (view.layers_m[k] - eye_z) / r), max(lowest, (bottom - eye_z) / r)
        limits[d, 0], limits[d, 1] = highest, lowest
    return limits


@inner
def share_in_view(place, top, bottom, eye_z, view, limits):
    """Share of the height of a place above the ground that lies between the limits of its direction; 1 where no direction holds
    it. place: of `seen_from`, with heights top..bottom; limits: of `vertical_limits`."""
    dx, dy, r, azimuth = place
    if view.edges_rad.shape[0] < 2:
        return 1.0
    d = direction_of(view.edges_rad, azimuth)
    bottom = min(bottom, lowest_free(dx, dy, r, 0.0, view))
    if d == NO_DIRECTION or bottom <= top:
        return 1.0
    inside = min(bottom, eye_z + limits[d, 1] * r) - max(top, eye_z + limits[d, 0] * r)
    return max(0.0, inside) / (bottom - top)

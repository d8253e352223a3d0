"""Ranges at which the ground was measured in each direction of the free-range profile.

Input: the ground and its sampled points (ground.py). Output: `seen_from_m` and `seen_to_m` of Ground. Not in the paper.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..types import Ground
from .ground_fit import GroundPlane


@kernel
def ground_ranges(points, ground, tolerance_m, noise_per_m, blind_beyond_m, edges_t):
    """Returns the nearest and farthest horizontal range at which the ground was measured in each direction, (2, D)
    float32, m; 0: none.

    A direction without a sample between two that have some gets the part of the range that both share. Points that
    voted count, up to the forward distance blind_beyond_m, within tolerance_m of the ground or noise_per_m of it per
    metre of forward distance. ground: GroundPlane; edges_t: (D + 1,) float64, tangents of the edges of the directions."""
    directions = len(edges_t) - 1
    ranges = np.zeros((2, directions), np.float32)
    seen_from, seen_to = ranges[0], ranges[1]
    for i in range(len(points)):
        x, y, z = np.float64(points[i].x), np.float64(points[i].y), np.float64(points[i].z)
        if points[i].level == 0.0 or x > blind_beyond_m:
            continue
        off = abs(z - ground.height_m - ground.slope_x * x - ground.slope_y * y)
        if off > max(tolerance_m, noise_per_m * x):
            continue
        d = int(np.searchsorted(edges_t, y / x, side="right")) - 1
        if d < 0 or d >= directions:
            continue
        r = np.float32(math.hypot(x, y))
        seen_from[d] = r if seen_to[d] == 0.0 else min(seen_from[d], r)
        seen_to[d] = max(seen_to[d], r)
    for d in range(1, directions - 1):
        if seen_to[d] == 0.0:
            near, far = max(seen_from[d - 1], seen_from[d + 1]), min(seen_to[d - 1], seen_to[d + 1])
            if far > near:
                seen_from[d], seen_to[d] = near, far
    return ranges


def with_ranges(ground: Ground, points: NDArray[Any], edges_t: NDArray[np.float64]) -> Ground:
    """Returns the ground with the ranges at which it was measured. points: as `find_ground` left them."""
    if not ground.seen:
        return ground
    plane = GroundPlane(ground.height_m, ground.slope_x, ground.slope_y)
    limits = float(ground.tolerance_m), ground.noise_per_m, ground.blind_beyond_m
    seen_from, seen_to = ground_ranges(points, plane, *limits, edges_t).tolist()
    return replace(ground, seen_from_m=tuple(seen_from), seen_to_m=tuple(seen_to))

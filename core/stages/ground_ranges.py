"""Ranges at which the ground was measured in each direction of the free-range profile.

Input: the ground and its sampled points (ground.py). Output: `seen_from_m` and `seen_to_m` of Ground. Not in the paper.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..types import Ground
from .ground_fit import GroundPlane


class SeenGround(NamedTuple):
    """The ground of a frame, and which points belong to it."""

    plane: GroundPlane  # GroundPlane
    tolerance_m: float  # least distance from the plane at which a point does not belong to it
    noise_per_m: float  # the same per metre of forward distance, where that is greater
    blind_beyond_m: float  # greatest forward distance of a point


@kernel
def ground_ranges(points, ground, edges_t, seen_from, seen_to):
    """Computes the nearest and farthest horizontal range at which the ground was measured in each direction.

    A direction without a sample between two that have some gets the part of the range that both share.

    Args:
        points: (N,) POINT of `vote`. Those that voted count.
        ground: SeenGround.
        edges_t: (D + 1,) float64, tangents of the edges of the directions.
        seen_from: (D,) float32 out, m; 0: none.
        seen_to: (D,) float32 out, m; 0: none."""
    directions, plane = len(edges_t) - 1, ground.plane
    seen_from[:] = 0.0
    seen_to[:] = 0.0
    for i in range(len(points)):
        x, y, z = np.float64(points[i].x), np.float64(points[i].y), np.float64(points[i].z)
        if points[i].level == 0.0 or x > ground.blind_beyond_m:
            continue
        off = abs(z - plane.height_m - plane.slope_x * x - plane.slope_y * y)
        if off > max(ground.tolerance_m, ground.noise_per_m * x):
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


def with_ranges(ground: Ground, points: NDArray[Any], edges_t: NDArray[np.float64]) -> Ground:
    """Returns the ground with the ranges at which it was measured.

    Args:
        ground: of `find_ground`.
        points: (N,) POINT as `find_ground` left them.
        edges_t: (D + 1,) float64, tangents of the edges of the directions of the free-range profile."""
    if not ground.seen:
        return ground
    seen_from, seen_to = np.empty((2, len(edges_t) - 1), np.float32)
    plane = GroundPlane(ground.height_m, ground.slope_x, ground.slope_y)
    seen = SeenGround(plane, float(ground.tolerance_m), ground.noise_per_m, ground.blind_beyond_m)
    ground_ranges(points, seen, edges_t, seen_from, seen_to)
    return replace(ground, seen_from_m=tuple(seen_from.tolist()), seen_to_m=tuple(seen_to.tolist()))

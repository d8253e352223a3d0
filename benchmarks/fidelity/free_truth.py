"""Checks free space: compares true obstacle points with the free-range profile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import MISSED_M, NAN, Rays
from core.types import FreeProfile

Floats = NDArray[np.float64]


def in_free(free: FreeProfile, points_m: Floats, slack_m: Floats) -> NDArray[np.bool_]:
    """(P,) whether points (P, 3) in level_cam lie in what is called free, more than slack_m (P,) before its
    end, horizontally."""
    x, y, z = points_m.T
    direction = np.searchsorted(free.azimuth_edges_rad, np.arctan2(y, x), side="right") - 1
    layer = np.searchsorted(free.layer_edges_m, z, side="right") - 1
    inside = (direction >= 0) & (direction < free.free_to_m.shape[0]) & (layer >= 0) & (layer < free.free_to_m.shape[1])
    d, i = np.where(inside, direction, 0), np.where(inside, layer, 0)
    if not free.free_to_m.size:
        return np.zeros(len(points_m), np.bool_)
    range_m = np.hypot(x, y)
    return np.asarray(inside & (range_m >= free.free_from_m[d, i]) & (range_m < free.free_to_m[d, i] - slack_m))


def false_free(free: FreeProfile, rays: Rays, points_m: Floats) -> float:
    """Share of the obstacle rays whose true point (H, W, 3 in level_cam) lies in what is called free, more
    than max(0.5 m, 2 sigma) before its end; nan without obstacle rays."""
    if not rays.obstacle.any():
        return NAN
    slack = np.fmax(MISSED_M, 2.0 * rays.sigma_m)[rays.obstacle]
    return float(in_free(free, points_m[rays.obstacle], slack).mean())

"""Horizontal distances from points to segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_LEAST_M2 = 1e-12
"""A shorter segment, squared length, is a point."""


def segment_distance_m(points_m: Floats, a_m: Floats, b_m: Floats) -> Floats:
    """Returns the horizontal distances, m, from points to segments a -> b.

    points_m, a_m, b_m: (..., 2) x and y in one frame; their other dimensions are broadcast and are those of the result."""
    along = b_m - a_m
    length2 = np.maximum((along**2).sum(axis=-1), _LEAST_M2)
    share = np.clip(((points_m - a_m) * along).sum(axis=-1) / length2, 0.0, 1.0)
    off = a_m + share[..., None] * along - points_m
    return np.asarray(np.hypot(off[..., 0], off[..., 1]))

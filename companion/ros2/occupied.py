"""Points on the occupied surfaces of a camera's model."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

MAX_POINTS: Final = 100_000
"""Largest number of points of one cloud; a model with more is sampled with a wider spacing."""


def surface_points(planes: NDArray[np.float32], spacing_m: float) -> NDArray[np.float64]:
    """(M, 3) points on vertical rectangles, m, in the frame of the planes.

    planes: (N, 6) a_x, a_y, b_x, b_y, top, bottom. Neighbouring points of a rectangle are at most spacing_m apart along
    each side, and its corners are among them. Where this gives more than MAX_POINTS, the spacing is doubled until it does
    not. Raises ValueError for numbers that are not finite."""
    rows = planes.astype(np.float64)
    if not np.isfinite(rows).all():
        raise ValueError("planes: numbers that are not finite; is the message damaged?")
    if not len(rows):
        return np.zeros((0, 3))
    length_m = np.hypot(rows[:, 2] - rows[:, 0], rows[:, 3] - rows[:, 1])
    height_m = rows[:, 5] - rows[:, 4]
    while True:
        across = _count(length_m, spacing_m)
        down = _count(height_m, spacing_m)
        if (across * down).sum() <= max(MAX_POINTS, 4 * len(rows)):
            break
        spacing_m *= 2.0
    return np.concatenate([_grid(row, int(n), int(k)) for row, n, k in zip(rows, across, down, strict=True)])


def _count(length_m: NDArray[np.float64], spacing_m: float) -> NDArray[np.float64]:
    """Points along sides of these lengths; 2 where a side is shorter than the spacing."""
    return np.ceil(np.maximum(length_m / spacing_m, 1.0)) + 1.0


def _grid(row: NDArray[np.float64], across: int, down: int) -> NDArray[np.float64]:
    """(across * down, 3) points on one rectangle."""
    share = np.linspace(0.0, 1.0, across)
    x, y = (row[k] + share * (row[k + 2] - row[k]) for k in (0, 1))
    z = np.linspace(row[4], row[5], down)
    return np.stack([np.repeat(x, down), np.repeat(y, down), np.tile(z, across)], axis=1)

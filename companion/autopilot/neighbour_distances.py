"""Adds the obstacles that other vehicles have reported to the distances for the autopilot: a distance can only get smaller."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..config.avoidance import AvoidParams
from .obstacle_distance import UNKNOWN, limits_cm, near_cm

NeighbourDistances = Callable[[tuple[float, float, float], float, int], NDArray[np.float64] | None]
"""(place in ned, heading, now) -> (72,) distances from the vehicle's middle, m, inf: none; None: nothing is known."""


def with_neighbours(
    values: NDArray[np.uint16], distances_m: NDArray[np.float64] | None, avoid: AvoidParams
) -> NDArray[np.uint16]:
    """(72,) values in centimetres with the nearer obstacles of neighbours.

    A sector that the own cameras do not see stays unknown: an obstacle far away would make the way to it look free."""
    if distances_m is None:
        return values
    from_hull_m = np.maximum(distances_m - avoid.radius_m, 0.0)
    counts = (values != UNKNOWN) & (100.0 * from_hull_m < limits_cm(avoid)[1])
    out = values.copy()
    out[counts] = np.minimum(values[counts], near_cm(from_hull_m[counts], avoid))
    return out

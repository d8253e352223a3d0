"""What the guard takes for free along the vehicle's path, and the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulation.flight_path import VehicleState

CORE, CORE_M = 0.8, 0.05
"""Half of the width of the judged corridor: this share of the hull, and so much more. That of the guard is wider; of its border a
fifth may be missed."""


@dataclass(frozen=True, slots=True)
class PathClaim:
    """angle_rad: of the path, clockwise from the vehicle's axis; room_m: from its middle."""

    angle_rad: float
    room_m: float


def true_room_m(outline_m: NDArray[np.float64], state: VehicleState, angle_rad: float, radius_m: float) -> float:
    """Returns the distance from the vehicle's middle along a path to the first point of the outlines; inf: none. radius_m: of the
    hull."""
    heading = state.euler_rad[2] + angle_rad
    c, s = math.cos(heading), math.sin(heading)
    north, east = (outline_m - np.array(state.position_ned_m[:2])).T
    along, across = c * north + s * east, -s * north + c * east
    return float(np.min(along[(along > 0.0) & (np.abs(across) <= CORE * radius_m + CORE_M)], initial=math.inf))

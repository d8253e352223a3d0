"""Bodies of the vehicles of a team. Obstacles that neighbours report at these places are the vehicles themselves.

Only reports of neighbours are compared with them, never obstacles of the own sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BODY_SIZE_M = 1.5
"""Greatest radius of a vehicle, whatever it reports."""
SLACK_M = 0.5
MOST_SLACK_M = 3.0
"""Greatest distance at which a report counts as a body, whatever the uncertainty."""


@dataclass(frozen=True, slots=True)
class Body:
    """A vehicle by its own report, in the own frame. margin_m: uncertainty of its place; velocity_m_s: horizontal."""

    vehicle: int
    centre_m: tuple[float, float, float]
    radius_m: float
    margin_m: float
    velocity_m_s: tuple[float, float] = (0.0, 0.0)

    def contains(
        self, centre_m: tuple[float, float, float], half_size_m: tuple[float, float, float], margin_m: float
    ) -> bool:
        """True if a reported mover is this vehicle."""
        # the reported radius is limited, so that it cannot remove other obstacles
        radius_m = min(self.radius_m, BODY_SIZE_M)
        if max(half_size_m) > self.most_half_size_m:
            return False
        slack_m = min(SLACK_M + self.margin_m + margin_m, MOST_SLACK_M)
        aside = math.hypot(centre_m[0] - self.centre_m[0], centre_m[1] - self.centre_m[1])
        return aside <= radius_m + slack_m and abs(centre_m[2] - self.centre_m[2]) <= radius_m + MOST_SLACK_M

    @property
    def most_half_size_m(self) -> float:
        """Half the greatest size of a report of this vehicle: of others it may be up to twice as large as it is."""
        return min(2.0 * self.radius_m, BODY_SIZE_M) + SLACK_M


def is_body(body: Body, box: NDArray[np.float32] | NDArray[np.float64], sigma_m: float = 0.0) -> bool:
    """True if a reported plane (6,) is a side of this vehicle. sigma_m: uncertainty of the place of the plane."""
    length = math.hypot(float(box[2] - box[0]), float(box[3] - box[1]))
    height = float(box[5] - box[4])
    x, y, z = (0.5 * float(box[0] + box[2]), 0.5 * float(box[1] + box[3]), 0.5 * float(box[4] + box[5]))
    return body.contains((x, y, z), (0.5 * length, 0.0, 0.5 * height), 2.0 * sigma_m)

"""Bodies of the vehicles of a team. Obstacles that neighbours report at these places are the vehicles themselves.

Only reports of neighbours are compared with them, never obstacles of the own sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
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

    @property
    def most_half_size_m(self) -> float:
        """Half the greatest size of a report of this vehicle: of others it may be up to twice as large as it is."""
        return min(2.0 * self.radius_m, BODY_SIZE_M) + SLACK_M

    def contains(
        self, centre_m: tuple[float, float, float], half_size_m: tuple[float, float, float], margin_m: float
    ) -> bool:
        """True if a reported mover is this vehicle."""
        return bool(self.contains_each(np.array([centre_m]), np.array([max(half_size_m)]), margin_m)[0])

    def contains_each(self, centre_m: Floats, half_size_m: Floats, margin_m: float) -> NDArray[np.bool_]:
        """Returns (N,): which reports are this vehicle. centre_m: (N, 3); half_size_m: (N,), the greatest of each."""
        # the reported radius is limited, so that it cannot remove other obstacles
        radius_m = min(self.radius_m, BODY_SIZE_M)
        slack_m = min(SLACK_M + self.margin_m + margin_m, MOST_SLACK_M)
        off = centre_m - np.array(self.centre_m)
        near = np.hypot(off[:, 0], off[:, 1]) <= radius_m + slack_m
        near &= np.abs(off[:, 2]) <= radius_m + MOST_SLACK_M
        return np.asarray(near & (half_size_m <= self.most_half_size_m))


def are_bodies(body: Body, box: Floats, sigma_m: float = 0.0) -> NDArray[np.bool_]:
    """Returns (N,): which reported planes (N, 6) are a side of this vehicle. sigma_m: uncertainty of the place of the
    planes."""
    length_m, height_m = np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1]), box[:, 5] - box[:, 4]
    centre_m = 0.5 * np.column_stack([box[:, 0] + box[:, 2], box[:, 1] + box[:, 3], box[:, 4] + box[:, 5]])
    return body.contains_each(centre_m, 0.5 * np.maximum(length_m, height_m), 2.0 * sigma_m)

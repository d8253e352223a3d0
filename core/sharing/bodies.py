"""Bodies of the vehicles of a team. Obstacles that neighbours report at these places are the vehicles themselves.

Only reports of neighbours are compared with them, never obstacles of the own sensors. A person may stand or walk below
or beside a vehicle, within the uncertainty of its place. Where a report may be something else, it is kept: a vehicle
of the team that is reported twice is harmless, a person who is not reported is not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .records import CUT

Floats = NDArray[np.float64]
BODY_SIZE_M = 1.5
"""Greatest radius of a vehicle, whatever it reports."""
MOST_SLACK_M = 3.0
"""Greatest distance from its hull to the end of a report of a vehicle, whatever the uncertainty."""
HIGHER_M, MOST_HALF_HEIGHT_M = 0.15, 0.7
"""A report of a vehicle is not higher than its radius and HIGHER_M, half of the height: heights are rounded up by 0.1 m.
A higher report than MOST_HALF_HEIGHT_M may be a person, and is never a vehicle."""
VELOCITY_SLACK_M_S, ACCELERATION_M_S2 = 0.5, 5.0
"""Difference of the velocities of a vehicle and a report of it, beyond 2 sigma, and by how much it grows with the age of the
report: a vehicle brakes."""
MOST_VELOCITY_SLACK_M_S = 3.0
"""Greatest difference, whatever age and sigma: those of an old report would fit to any velocity."""


@dataclass(frozen=True, slots=True)
class MovingReport:
    """A moving obstacle in the own frame, now."""

    centre_m: tuple[float, float, float]  # centre_m, half_size_m: its box, without the uncertainty of its place
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]  # horizontal
    sigma_m_s: float = 0.0  # of the velocity, on each axis
    margin_m: float = 0.0  # margin_m, margin_z_m: uncertainty of its place, horizontal and vertical
    margin_z_m: float = 0.0
    error_m: float = 0.0  # the part of margin_m that its reporter states, without that of the frames
    age_s: float = 0.0  # of its velocity
    partial: bool = False  # it may be a part of something larger


@dataclass(frozen=True, slots=True)
class Body:
    """A vehicle by its own report, in the own frame. margin_m, margin_z_m: uncertainty of its place, horizontal and
    vertical; velocity_m_s: horizontal; is_own: the own vehicle, which is no obstacle to itself; is_aligned: its frame is
    aligned by obstacles that both vehicles have observed, horizontally and vertically."""

    vehicle: int
    centre_m: tuple[float, float, float]
    radius_m: float
    margin_m: float
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    margin_z_m: float = 0.0
    is_own: bool = False
    is_aligned: bool = False

    def find(self, reports: Sequence[MovingReport]) -> int | None:
        """Returns the index of the report that is this vehicle, the nearest one; None: none is.

        One vehicle is reported once. Further reports at its place are something else."""
        found = [(self._apart_m(r), k) for k, r in enumerate(reports) if self.may_be(r)]
        return min(found)[1] if found else None

    def may_be(self, r: MovingReport) -> bool:
        """True if a moving report has the place, size and velocity of this vehicle."""
        (vx, vy), (ux, uy) = self.velocity_m_s, r.velocity_m_s
        slack_m_s = VELOCITY_SLACK_M_S + 2.0 * r.sigma_m_s + ACCELERATION_M_S2 * r.age_s
        if r.partial or not math.hypot(vx - ux, vy - uy) <= min(slack_m_s, MOST_VELOCITY_SLACK_M_S):
            return False
        size = np.array([[math.hypot(*r.half_size_m[:2]), r.half_size_m[2]]])
        margin_m, error_m = np.array([r.margin_m]), np.array([r.error_m])
        return bool(self.contains_each(np.array([r.centre_m]), size, error_m, margin_m, r.margin_z_m)[0])

    def contains_each(
        self, centre_m: Floats, half_size_m: Floats, error_m: Floats, margin_m: Floats, margin_z_m: float
    ) -> NDArray[np.bool_]:
        """Returns (N,): which reports have the size of this vehicle and lie within its radius and the uncertainty of the
        place. centre_m: (N, 3); half_size_m: (N, 2) half of the horizontal diagonal and of the height of each; error_m: (N,)
        of each report; margin_m: (N,) and margin_z_m, uncertainty of their place.

        For a neighbour it is the uncertainty of the obstacle that stands for it: no place at which something was reported
        becomes free. Nothing stands for the own vehicle, whose place is known: it is that of the report."""
        # the reported radius is limited, so that it cannot remove other obstacles
        radius_m = min(self.radius_m, BODY_SIZE_M)
        off = np.abs(centre_m - np.array(self.centre_m))
        slack_m, slack_z_m = (margin_m, margin_z_m) if self.is_own else (self.margin_m, self.margin_z_m)
        end_m, end_z_m = np.hypot(off[:, 0], off[:, 1]) + half_size_m[:, 0], off[:, 2] + half_size_m[:, 1]
        near = end_m <= radius_m + np.minimum(slack_m, MOST_SLACK_M)
        near &= end_z_m <= radius_m + min(slack_z_m, MOST_SLACK_M)
        return np.asarray(near & (half_size_m <= self.most_half_size_m(error_m)).all(axis=1))

    def most_half_size_m(self, error_m: Floats) -> Floats:
        """Returns (N, 2) the greatest half of the horizontal diagonal and of the height of a report of this vehicle. error_m:
        (N,) of each report."""
        radius_m = min(self.radius_m, BODY_SIZE_M)
        diagonal_m = math.sqrt(2.0) * radius_m + error_m  # of the box of a round vehicle
        return np.column_stack([diagonal_m, np.full(len(error_m), min(radius_m + HIGHER_M, MOST_HALF_HEIGHT_M))])

    def _apart_m(self, r: MovingReport) -> float:
        return math.hypot(r.centre_m[0] - self.centre_m[0], r.centre_m[1] - self.centre_m[1])


def are_bodies(
    body: Body,
    box: Floats,
    flags: NDArray[np.uint8],
    error_m: Floats,
    margin_m: Floats | None = None,
    margin_z_m: float = 0.0,
) -> NDArray[np.bool_]:
    """Returns (N,): which reported planes (N, 6) are a side of this vehicle: none that may continue beyond what was
    observed, by its flags (N,). error_m: (N,) as reported; margin_m: (N,) and margin_z_m, uncertainty of the place of the
    planes, None: error_m."""
    length_m, height_m = np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1]), box[:, 5] - box[:, 4]
    centre_m = 0.5 * np.column_stack([box[:, 0] + box[:, 2], box[:, 1] + box[:, 3], box[:, 4] + box[:, 5]])
    half_size_m = 0.5 * np.column_stack([length_m, height_m])
    whole = (flags & int(CUT)) == 0
    place_m = error_m if margin_m is None else margin_m
    return np.asarray(whole & body.contains_each(centre_m, half_size_m, error_m, place_m, margin_z_m))

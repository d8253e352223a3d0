"""Wind with gusts, and how it moves a multicopter until its controller has compensated it.

A gust rises and falls as (1 - cos(2 pi t / T)) / 2, the discrete gust of CS-25.341, and follows the one before without a pause. The
air accelerates the vehicle in proportion to its speed relative to it. The position controller compensates it with a time
constant: a steady wind no longer moves the vehicle, a gust does while it grows and while it ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
COMPENSATES_S = 1.0
"""Time constant of the velocity controller's integrator against a change of the wind."""


@dataclass(frozen=True, slots=True, eq=False)
class Wind:
    """A wind with gusts."""

    # steady_m_s, gust_m_s: (2,) north and east, to where it blows; a gust adds up to gust_m_s
    steady_m_s: Vector
    gust_m_s: Vector
    period_s: float = 3.0  # length of one gust

    def at(self, t_s: float) -> Vector:
        """(2,) m/s."""
        share = 0.5 * (1.0 - math.cos(math.tau * t_s / self.period_s))
        out: Vector = self.steady_m_s + share * self.gust_m_s
        return out


@dataclass(slots=True, eq=False)
class WindPush:
    """`step` with the time."""

    wind: Wind
    drag_per_s: float  # acceleration by the speed relative to the air
    compensated_m_s: Vector = field(init=False)
    """(2,) wind against which the vehicle leans."""
    _t_s: float = 0.0

    def __post_init__(self) -> None:
        self.compensated_m_s = self.wind.at(0.0)

    def step(self, dt_s: float) -> Vector:
        """(2,) m/s2 that the air adds to the vehicle's acceleration."""
        self._t_s += dt_s
        lacks = self.wind.at(self._t_s) - self.compensated_m_s
        self.compensated_m_s = self.compensated_m_s + lacks * dt_s / (COMPENSATES_S + dt_s)
        out: Vector = self.drag_per_s * lacks
        return out

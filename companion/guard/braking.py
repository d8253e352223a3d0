"""Braking distance for a speed, and speed for a braking distance.

    needed(v) = v * reaction_s + v^2 / (2 * deceleration) + margin

The vehicle continues for reaction_s, then decelerates. The margin is the distance from the vehicle's middle that must
remain: the radius of the hull and margin_m."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams

LIMIT_AHEAD_S = 1.0
"""The speed is limited when the braking distance fits for less than this time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Braking:
    """Parameters of the braking distance."""

    reaction_s: float  # time before the vehicle decelerates
    deceleration_m_s2: float
    margin_m: float  # distance that must remain, from the vehicle's middle

    def needed_m(self, speed_m_s: float, ahead_s: float = 0.0) -> float:
        """Returns the distance from the vehicle's middle that must be free.

        ahead_s: time for which the vehicle continues before the reaction time begins."""
        way_m = speed_m_s * (self.reaction_s + ahead_s)
        return way_m + speed_m_s**2 / (2.0 * self.deceleration_m_s2) + self.margin_m

    def speed_m_s(self, distance_m: float, ahead_s: float = 0.0) -> float:
        """Returns the greatest speed for which `needed_m` is at most the distance; 0 if there is none."""
        room_m = distance_m - self.margin_m
        if not room_m > 0.0:
            return 0.0
        a, t = self.deceleration_m_s2, self.reaction_s + ahead_s
        return a * (math.sqrt(t * t + 2.0 * room_m / a) - t)


def braking_of(guard: GuardParams, avoid: AvoidParams) -> Braking:
    """Returns the braking distances of a configuration."""
    return Braking(
        reaction_s=guard.reaction_s,
        deceleration_m_s2=guard.deceleration_m_s2,
        margin_m=guard.margin_m + avoid.radius_m,
    )

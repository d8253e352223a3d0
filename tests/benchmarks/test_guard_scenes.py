"""The random missions of the guard hold what they state."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.autopilot.guard_scenes import random_mission, way_to_obstacle_m

HULL_M = 0.3


@pytest.mark.parametrize("first", [0, 50])
def test_blocked_missions_have_an_obstacle_in_the_way_that_is_flown(first: int) -> None:
    """Of 127 of the numbers 0 to 199 that counted as blocked, 3 fly velocity setpoints along the first leg only, and their obstacle
    stands at the second."""
    for number in range(first, first + 50):
        mission = random_mission(number)
        corners = [np.zeros(2), *mission.waypoints_m[: 1 if mission.guided else 2]]
        meets = False
        for a, e in pairwise(corners):
            length_m = float(np.linalg.norm(e - a))
            place = np.array([*a, -mission.height_m])
            meets |= way_to_obstacle_m(mission.scene, place, (e - a) / length_m, HULL_M, length_m) <= length_m
        assert mission.blocked <= meets, number

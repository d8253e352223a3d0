"""The random missions of the guard hold what they state."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.autopilot import guard_missions
from benchmarks.autopilot.guard_scenes import random_mission, way_to_obstacle_m
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.braking import Braking, braking_of
from drivers.simulation.scenes import SceneBuilder

HULL_M = 0.3


@pytest.mark.parametrize("first", [0, pytest.param(50, marks=pytest.mark.slow)])
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


def test_a_stop_is_judged_by_the_stated_braking_distance_and_not_by_that_of_the_guard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    guard, avoid, speed_m_s = GuardParams(enabled=True), AvoidParams(), 4.0
    needed_m = guard_missions.braking_distance_m(speed_m_s, guard, avoid)
    assert needed_m == pytest.approx(braking_of(guard, avoid).needed_m(speed_m_s))
    whole = Braking.needed_m
    monkeypatch.setattr(Braking, "needed_m", lambda self, *speed: 2.0 * whole(self, *speed))
    for wall_m, justified in ((0.9 * needed_m, True), (1.8 * needed_m, False)):
        s = SceneBuilder("wall")
        s.wall("wall", (wall_m, -5.0), (wall_m, 5.0), 6.0)
        loop: Any = SimpleNamespace(
            guard=SimpleNamespace(verdict=None),
            flight=SimpleNamespace(speed_m_s=speed_m_s),
            params=guard,
            avoid=avoid,
            braking=braking_of(guard, avoid),
            scene=s.build(),
            place_m=np.array([0.0, 0.0, -2.0]),
            direction=np.array([1.0, 0.0]),
        )
        assert guard_missions._justified(loop) is justified

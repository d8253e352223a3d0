"""Paths through the merged world: never through what any frame saw, home through what was seen free, no gap too narrow."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace
from tests.core.worlds import NS, house, seen, wall
from tests.golden import recording_path

ROOT = Path(__file__).resolve().parents[3]
BOUNDS = [[-14.0, -14.0, -0.9], [14.0, 14.0, 0.9]]


@pytest.fixture(scope="module")
def around_a_house() -> WorldSpace:
    """All sides of it were seen from a circle of 10 m, never more than two at once."""
    world = World()
    for k in range(120):
        a = math.tau * k / 120
        at = (10 * math.cos(a), 10 * math.sin(a))
        world.add(seen(house(0.0, 0.0), at, a + math.pi, k * NS // 10))
        world.add(seen(house(0.0, 0.0), at, a + math.pi / 2, k * NS // 10 + 1))  # ahead, too
    return WorldSpace(world.picture(12 * NS))


def room(pp: ModuleType, space: WorldSpace, unknown: str, start: list[float], been_m: float = 2.0):
    return pp.Room(space=space, radius_m=0.5, start=np.array(start), been_m=been_m, unknown=pp.Unknown(unknown))


def along(path: np.ndarray) -> np.ndarray:
    return np.concatenate([np.linspace(a, b, 30) for a, b in pairwise(path)])


@pytest.mark.parametrize(
    ("planner", "unknown", "tries", "goal"),
    [
        pytest.param("rrt", "avoid", 16, [-9.0, 0.0, 0.0], marks=pytest.mark.slow),
        pytest.param("rrt-connect", "avoid", 16, [-9.0, 0.0, 0.0], marks=pytest.mark.slow),
        ("rrt-connect", "avoid", 4, [0.0, 9.0, 0.0]),
        pytest.param("prm", "allow", 4, [-9.0, 0.0, 0.0], marks=pytest.mark.slow),
    ],
)
def test_around_a_house_of_which_no_frame_saw_all(
    pp: ModuleType, around_a_house: WorldSpace, planner: str, unknown: str, tries: int, goal: list[float]
) -> None:
    """A single try of rrt finds the way in 13 of 30 cases, so that sixteen fail by chance in 1 of 8000: the seed is fixed."""
    start = [9.5, 0.0, 0.0]
    path = pp.plan(
        room(pp, around_a_house, unknown, start, 3.0), goal, BOUNDS, planner=planner, tries=tries, questions=12000
    )
    assert path[-1] == pytest.approx(goal)
    points = along(path)
    # the house is solid, grown by the vehicle
    assert np.maximum(np.abs(points[:, 0]), np.abs(points[:, 1])).min() > 3.4
    answers = around_a_house.points(points, 0.49)
    assert Occupancy.OCCUPIED not in answers
    if unknown == "avoid":
        far = np.linalg.norm(points - start, axis=1) > 3.0
        assert (answers[far] == Occupancy.FREE).all()


def test_inside_of_what_was_flown_around_is_no_goal(pp: ModuleType, around_a_house: WorldSpace) -> None:
    with pytest.raises(pp.NoPath, match=r"goal \[0.0, 0.0, 0.0\] is occupied"):
        pp.plan(room(pp, around_a_house, "allow", [9.5, 0.0, 0.0]), [0.0, 0.0, 0.0], BOUNDS)


@pytest.mark.parametrize(("width", "passes"), [(2.4, True), (1.1, False)])
def test_a_gap_is_passed_where_the_vehicle_fits(pp: ModuleType, width: float, passes: bool) -> None:
    walls = np.array([wall(6.0, -13.9, 6.0, -width / 2), wall(6.0, width / 2, 6.0, 13.9)])
    world = World()
    for k in range(20):
        for heading in (-0.6, 0.0, 0.6):
            world.add(seen(walls, (-6.0, 0.2 * k - 2.0), heading, k * NS // 10 + round(heading * 100), view_deg=100.0))
    mine = room(pp, WorldSpace(world.picture(2 * NS)), "allow", [0.0, 0.0, 0.0])
    bounds = [[-2.0, -8.0, -0.9], [14.0, 8.0, 0.9]]
    if passes:
        path = pp.plan(mine, [10.0, 0.0, 0.0], bounds, tries=16)
        points = along(path)
        through = points[np.abs(points[:, 0] - 6.0) < 0.5]
        assert len(through)
        assert np.abs(through[:, 1]).max() < width / 2 - 0.5
    else:
        with pytest.raises(pp.NoPath, match="no path"):
            pp.plan(mine, [10.0, 0.0, 0.0], bounds, tries=2, questions=500)


@pytest.mark.usefixtures("renders")
@pytest.mark.slow  # the script's planner is tested above
def test_the_script_plans_through_the_flight_of_a_log(pp: ModuleType, tmp_path: Path) -> None:
    picture = tmp_path / "path.png"
    command = [sys.executable, ROOT / "examples" / "plan_world.py", recording_path("alley"), "-o", picture]
    run = subprocess.run(
        [*command, "--unknown", "allow", "--goal", "9", "0", "-1.8"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert picture.stat().st_size > 10_000
    run = subprocess.run(
        [*command, "--goal", "5", "-6", "-2"], capture_output=True, text=True, timeout=300, check=False
    )
    assert (run.returncode, "is unknown" in run.stderr) == (1, True), run.stderr  # behind the left wall

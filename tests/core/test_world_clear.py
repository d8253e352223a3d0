"""What a frame must observe of a plane of the merged world before that counts as evidence that the plane is gone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.types import FreeEnd
from core.world.evidence import CLEAR_LIMIT
from core.world.world import World

from .worlds import NS, seen, wall

pytestmark = pytest.mark.nojit
STEP = NS // 10
RANGE_M = 6.0
"""Of the plane. Free space must reach 0.5 m, its margin (0.05 m), the error of the position (0.1 m) and three standard
deviations of its distance (0.11 m) behind it."""
OBSTACLE, UNKNOWN = int(FreeEnd.OBSTACLE), int(FreeEnd.UNKNOWN)


@pytest.mark.parametrize(
    ("free_from_m", "free_to_m", "end", "ke_per_m", "gone"),
    [
        ((0.5, 0.5, 0.5), (9.0, 9.0, 9.0), UNKNOWN, 0.001, True),
        # it begins behind the plane, or nearer in front of it than the position and the distance are known
        ((7.0, 7.0, 7.0), (9.0, 9.0, 9.0), UNKNOWN, 0.001, False),
        ((5.9, 5.9, 5.9), (9.0, 9.0, 9.0), UNKNOWN, 0.001, False),
        ((5.5, 5.5, 5.5), (9.0, 9.0, 9.0), UNKNOWN, 0.001, True),
        ((5.5, 5.5, 5.5), (9.0, 9.0, 9.0), UNKNOWN, 0.01, False),
        # it ends too near behind the plane
        ((0.5, 0.5, 0.5), (6.6, 6.6, 6.6), UNKNOWN, 0.001, False),
        ((0.5, 0.5, 0.5), (7.1, 7.1, 7.1), UNKNOWN, 0.001, True),
        ((0.5, 0.5, 0.5), (7.1, 7.1, 7.1), UNKNOWN, 0.01, False),
        # not over half of the height
        ((0.5, 0.5, 0.5), (9.0, 1.0, 1.0), UNKNOWN, 0.001, False),
        ((0.5, 0.5, 0.5), (9.0, 9.0, 1.0), UNKNOWN, 0.001, True),
        # an obstacle at one height: at the range of the plane, or well in front of it
        ((0.5, 0.5, 0.5), (9.0, 9.0, 6.5), OBSTACLE, 0.001, False),
        ((0.5, 0.5, 0.5), (9.0, 9.0, 5.5), OBSTACLE, 0.001, False),
        ((0.5, 0.5, 0.5), (9.0, 9.0, 3.0), OBSTACLE, 0.001, True),
        ((0.5, 0.5, 0.5), (9.0, 9.0, 6.5), UNKNOWN, 0.001, True),
    ],
)
def test_what_is_evidence_that_a_plane_is_gone(
    free_from_m: tuple[float, ...], free_to_m: tuple[float, ...], end: int, ke_per_m: float, gone: bool
) -> None:
    """Ranges of the three layers of free space, which are the heights of the plane. end: of all of them."""
    world, walls = World(), np.array([wall(RANGE_M, -0.5, RANGE_M, 0.5, -3.0, 3.0)])
    world.add(seen(walls, (0.0, 0.0), 0.0, 0))
    before = world.picture(0).planes
    for k in range(1, 1 + CLEAR_LIMIT):
        without = seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, k * STEP, ke=ke_per_m)
        profile = without.model.free
        free = replace(
            profile,
            free_from_m=np.tile(np.array(free_from_m, np.float32), (len(profile.end), 1)),
            free_to_m=np.tile(np.array(free_to_m, np.float32), (len(profile.end), 1)),
            end=np.full_like(profile.end, end),
        )
        world.add(replace(without, model=replace(without.model, free=free)))
    after = world.picture((1 + CLEAR_LIMIT) * STEP).planes
    assert len(before) == 1
    assert len(after) == 0 if gone else np.array_equal(after, before)


@pytest.mark.parametrize(
    ("heading_rad", "top_m", "gone"),
    [
        (0.0, -3.0, False),
        # the obstacle is above the plane
        (0.0, -1.0, True),
        # the plane is out of view
        (2.0, -1.0, False),
        (-2.0, -1.0, False),
    ],
)
def test_what_a_frame_observes_elsewhere_is_no_evidence(heading_rad: float, top_m: float, gone: bool) -> None:
    """Free space at -1 to 3 m in all directions of the view, and above it an obstacle at the range of the plane."""
    world, walls = World(), np.array([wall(RANGE_M, -0.5, RANGE_M, 0.5, top_m, 3.0)])
    world.add(seen(walls, (0.0, 0.0), 0.0, 0))
    before = world.picture(0).planes
    for k in range(1, 1 + CLEAR_LIMIT):
        without = seen(np.zeros((0, 6)), (0.0, 0.0), heading_rad, k * STEP)
        profile = without.model.free
        free = replace(
            profile,
            free_to_m=np.tile(np.array([6.5, 9.0, 9.0], np.float32), (len(profile.end), 1)),
            end=np.full_like(profile.end, OBSTACLE),
        )
        world.add(replace(without, model=replace(without.model, free=free)))
    after = world.picture((1 + CLEAR_LIMIT) * STEP).planes
    assert len(before) == 1
    assert len(after) == 0 if gone else np.array_equal(after, before)


@pytest.mark.parametrize(("bottom_m", "gone"), [(-1.2, True), (0.0, False)])
def test_a_frame_exposed_later_keeps_a_plane_by_what_it_observed_at_its_heights(bottom_m: float, gone: bool) -> None:
    """The clear frames are read late. The frames exposed after them observed an obstacle there, down to bottom_m."""
    world, walls = World(), np.array([wall(RANGE_M, -0.5, RANGE_M, 0.5, -1.0, 3.0)])
    world.add(seen(walls, (0.0, 0.0), 0.0, 0))
    for k in range(1, 1 + CLEAR_LIMIT):
        obstacle = seen(np.array([wall(RANGE_M, -0.5, RANGE_M, 0.5, -3.0, bottom_m)]), (0.0, 0.0), 0.0, 2 * k * STEP)
        nothing_free = replace(obstacle.model.free, free_to_m=np.zeros_like(obstacle.model.free.free_to_m))
        world.add(replace(obstacle, model=replace(obstacle.model, free=nothing_free)))
        world.add(seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, (2 * k - 1) * STEP))
    planes = world.picture(2 * CLEAR_LIMIT * STEP).planes
    assert (planes[:, 5].max() < 0.0) == gone


@pytest.mark.parametrize(("turn_deg", "planes"), [(15.0, 1), (30.0, 2)])
def test_two_planes_that_cross_are_one_if_they_are_almost_parallel(turn_deg: float, planes: int) -> None:
    """1.2 m long: their ends lie within 0.16 m of the line between them."""
    world = World()
    for k, sign in enumerate((1.0, -1.0)):
        half = np.deg2rad(0.5 * sign * turn_deg)
        x, y = 0.6 * np.sin(half), 0.6 * np.cos(half)
        world.add(seen(np.array([wall(RANGE_M - x, -y, RANGE_M + x, y)]), (0.0, 0.0), 0.0, k * STEP))
    assert len(world.picture(STEP).planes) == planes

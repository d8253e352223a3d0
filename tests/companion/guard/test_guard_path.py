"""The path of the guard: free space and obstacles of one decision, not those beside the path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.obstacle_memory import Remembered, nothing_remembered
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.view_free import View
from companion.guard.braking import LIMIT_AHEAD_S, braking_of
from companion.guard.corridor import Path, samples_of
from companion.guard.path_sight import path_sight
from companion.guard.turn import turns
from companion.pipeline.transform import LevelTransform
from core.types import Intrinsics

from ..guard_sight import AVOID, GUARD, HERE, T_NS, at, plane, seen
from ..sector_models import model


def test_sees_as_far_as_the_profile() -> None:
    sight = seen(model(free_to_m=15.0))
    assert sight.free_m == pytest.approx(15.0, abs=0.5)
    assert math.isinf(sight.obstacle_m)
    assert sight.speed_m_s == 5.0
    assert seen(model(free_to_m=30.0)).free_m == pytest.approx(GUARD.horizon_m, abs=0.3)


def test_without_a_view_nothing_is_free_and_the_cause_is_named() -> None:
    sight = seen(None)
    assert sight.free_m == 0.0
    assert sight.cause == "front: no frame yet"


def test_out_of_the_view_nothing_is_free() -> None:
    found = model(free_to_m=15.0, view_deg=70.0)
    assert seen(found, velocity=(5.0, 0.0, 0.0)).free_m > 14.0
    assert seen(found, velocity=(0.0, 5.0, 0.0)).free_m == 0.0
    assert seen(found, velocity=(-5.0, 0.0, 0.0)).free_m == 0.0
    # flying east while looking east
    assert seen(found, velocity=(0.0, 5.0, 0.0), heading=math.pi / 2).free_m > 14.0


@pytest.mark.parametrize(("y", "hit"), [(0.0, True), (0.65, True), (-0.65, True), (0.75, False), (-0.75, False)])
def test_only_what_stands_in_the_width_of_the_hull_counts(y: float, hit: bool) -> None:
    far_m = seen(model(plane(8.0, y - 0.01, y + 0.01), free_to_m=20.0)).obstacle_m
    assert far_m == (pytest.approx(8.0) if hit else math.inf)


@pytest.mark.parametrize(
    ("vertical_m_s", "top", "bottom", "hit"),
    [
        (0.0, 1.0, 2.0, False),
        (0.0, 0.7, 2.0, True),
        (2.5, 3.0, 5.0, True),
        (-2.5, 3.0, 5.0, False),
        (0.0, -2.0, -0.9, False),
        (-2.5, -6.0, -4.0, True),
    ],
)
def test_the_height_of_the_path(vertical_m_s: float, top: float, bottom: float, hit: bool) -> None:
    found = model(plane(8.0, -2.0, 2.0, top, bottom), free_to_m=20.0)
    assert math.isfinite(seen(found, velocity=(5.0, 0.0, vertical_m_s)).obstacle_m) is hit


@pytest.mark.parametrize("vertical_m_s", [-2.5, -0.5, 0.5, 2.5])
def test_an_obstacle_at_the_height_of_the_vehicle_counts_in_a_climb_and_descent(vertical_m_s: float) -> None:
    """Noise of the vertical velocity must not lead the corridor past it."""
    found = model(plane(8.0, -2.0, 2.0, -0.3, 0.3), free_to_m=20.0)
    assert seen(found, velocity=(5.0, 0.0, vertical_m_s)).obstacle_m == pytest.approx(8.0)
    assert seen(found, velocity=(0.6, 0.0, vertical_m_s)).obstacle_m == pytest.approx(8.0)


def test_the_slope_of_a_slow_vehicle_is_noise() -> None:
    found = model(plane(8.0, -2.0, 2.0, 3.0, 5.0), free_to_m=20.0)
    assert math.isinf(seen(found, velocity=(0.9, 0.0, 0.45)).obstacle_m)
    assert math.isfinite(seen(found, velocity=(1.1, 0.0, 0.55)).obstacle_m)


def test_a_wall_along_the_way_counts_from_where_it_enters() -> None:
    slanted = (2.0, 4.0, 12.0, -1.0, -2.0, 2.0)
    assert seen(model(slanted, free_to_m=20.0)).obstacle_m == pytest.approx(8.6, abs=0.05)
    beside = (-2.0, 0.5, 5.0, 0.5, -2.0, 2.0)
    assert seen(model(beside, free_to_m=20.0)).obstacle_m == 0.0
    behind = (-9.0, -2.0, -9.0, 2.0, -2.0, 2.0)
    assert math.isinf(seen(model(behind, free_to_m=20.0)).obstacle_m)


@given(
    st.floats(-60.0, 60.0), st.floats(2.0, 18.0), st.floats(-0.69, 0.69), st.floats(0.0, 180.0), st.floats(0.02, 3.0)
)
def test_a_segment_in_the_corridor_is_never_missed(
    course_deg: float, range_m: float, aside_m: float, turn_deg: float, length_m: float
) -> None:
    c, s = math.cos(math.radians(course_deg)), math.sin(math.radians(course_deg))
    x, y = range_m * c - aside_m * s, range_m * s + aside_m * c
    tx, ty = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    line = (x - length_m * tx, y - length_m * ty, x + length_m * tx, y + length_m * ty, -1.0, 1.0)
    sight = seen(model(line, free_to_m=20.0), velocity=(5.0 * c, 5.0 * s, 0.0))
    walked = [
        max(0.0, (x + k * length_m * tx) * c + (y + k * length_m * ty) * s)
        for k in np.linspace(-1.0, 1.0, 401)
        if abs(-(x + k * length_m * tx) * s + (y + k * length_m * ty) * c) <= 0.7
        and (x + k * length_m * tx) * c + (y + k * length_m * ty) * s >= 0.0
    ]
    assert sight.obstacle_m == pytest.approx(min(walked), abs=0.02)


@pytest.mark.parametrize(
    ("range_m", "bearing_deg", "turn_deg_s", "hit"),
    [
        # at 3 m/s and 30 degrees per second the arc has a radius of 5.7 m: 6 m ahead it lies 30 degrees beside the tangent
        (6.0, 20.0, 30.0, True),
        (6.0, 30.0, 30.0, True),
        (6.0, -20.0, -30.0, True),
        (6.0, 20.0, 0.0, False),
        (6.0, 20.0, -30.0, False),
        (6.0, 20.0, 1.0, False),
        (9.0, 5.5, 1.8, True),  # it leaves the corridor within the distance at which the speed is limited
        (3.0, 45.0, 30.0, False),
        (5.0, 60.0, 30.0, False),  # on the inner side of the arc
        (9.0, 45.0, 30.0, True),
        (6.0, 0.0, 30.0, True),
    ],
)
def test_in_a_turn_the_obstacles_between_the_tangent_and_the_arc_count(
    range_m: float, bearing_deg: float, turn_deg_s: float, hit: bool
) -> None:
    sight = seen(at(range_m, bearing_deg), velocity=(3.0, 0.0, 0.0), turn_deg_s=turn_deg_s)
    assert math.isfinite(sight.obstacle_m) == hit
    if hit:
        assert sight.obstacle_m == pytest.approx(range_m, abs=0.2)


@given(st.floats(1.0, 8.0), st.floats(-60.0, 60.0), st.floats(0.5, 12.0), st.floats(0.0, 1.0))
def test_in_a_turn_no_place_between_the_tangent_and_the_arc_is_missed(
    speed_m_s: float, turn_deg_s: float, range_m: float, share: float
) -> None:
    """Up to 60 degrees beside the tangent, from the rate on that leaves the corridor."""
    rate, braking_m = math.radians(turn_deg_s), braking_of(GUARD, AVOID).needed_m(speed_m_s, LIMIT_AHEAD_S)
    bearing_deg = 0.5 * turn_deg_s / speed_m_s * range_m if turns(rate, speed_m_s, braking_m, GUARD.side_m) else 0.0
    bearing_deg = max(-60.0, min(60.0, bearing_deg)) * share
    sight = seen(at(range_m, bearing_deg), velocity=(speed_m_s, 0.0, 0.0), turn_deg_s=turn_deg_s)
    assert sight.obstacle_m <= range_m + 0.1


def test_a_wall_in_a_turn_counts_from_where_the_arc_meets_it() -> None:
    wall = (-4.0, 3.0, 12.0, 3.0, -2.0, 2.0)  # 3 m to the right of the path, along it
    assert math.isinf(seen(model(wall, free_to_m=20.0), velocity=(3.0, 0.0, 0.0)).obstacle_m)
    turned = seen(model(wall, free_to_m=20.0), velocity=(3.0, 0.0, 0.0), turn_deg_s=30.0)
    assert 4.5 < turned.obstacle_m < 6.5, "the arc of 5.7 m radius is 3 m aside after 5.6 m"


@pytest.mark.parametrize(("turn_deg_s", "free"), [(0.0, True), (40.0, False), (-40.0, True)])
def test_in_a_turn_the_course_that_follows_must_be_seen(turn_deg_s: float, free: bool) -> None:
    """A camera 70 degrees wide, the course 22 degrees to the right of its axis: 0.4 s later it is 38 degrees or 6."""
    course = math.radians(22.0)
    velocity = (2.0 * math.cos(course), 2.0 * math.sin(course), 0.0)
    sight = seen(model(free_to_m=15.0, view_deg=70.0), velocity=velocity, turn_deg_s=turn_deg_s)
    assert sight.free_m > 14.0
    assert (sight.ahead_free_m > 14.0) == free
    if not free:
        assert sight.ahead_free_m < 5.0


def test_beside_the_course_of_a_vehicle_that_begins_a_leg_obstacles_count() -> None:
    slow = {"velocity": (0.7, 0.0, 0.0)}
    assert seen(at(5.0, 12.0), **slow, turn_deg_s=10.0).obstacle_m == pytest.approx(5.0, abs=0.1)
    assert math.isinf(seen(at(5.0, 12.0), **slow).obstacle_m)
    assert math.isinf(seen(at(5.0, -12.0), **slow, turn_deg_s=10.0).obstacle_m)
    assert math.isinf(seen(at(5.0, 30.0), **slow, turn_deg_s=10.0).obstacle_m)


def test_an_obstacle_is_nearer_by_the_margin_of_its_plane() -> None:
    found = model(plane(8.0, -1.0, 1.0), free_to_m=20.0, margin=0.5)
    assert seen(found).obstacle_m == pytest.approx(7.5)


def test_free_space_of_before_completes_only_what_is_mostly_seen_now() -> None:
    """Beyond 3 m no ray is seen now."""
    assert seen(model(free_to_m=3.0), recall=lambda x, y, z: np.ones(len(x), bool)).free_m < 3.5


def test_what_cannot_be_computed_is_not_seen() -> None:
    """Remembered obstacles of a wrong shape, which are used after the free space was computed."""
    sight = seen(model(free_to_m=20.0), recalled=Remembered(np.zeros(3), np.zeros(3)))
    assert "cannot be computed" in sight.cause
    assert (sight.free_m, sight.rays_free_m, sight.kept_rays) == (0.0, None, ())


def test_a_remembered_obstacle_counts() -> None:
    distance_m = np.full(72, np.inf)
    distance_m[2] = 4.0
    recalled = Remembered(distance_m, np.full(72, np.inf))
    ten = math.radians(10.0)
    ahead = seen(model(free_to_m=0.0), velocity=(5.0 * math.cos(ten), 5.0 * math.sin(ten), 0.0), recalled=recalled)
    assert ahead.remembered_m == pytest.approx(4.4)
    assert math.isinf(ahead.obstacle_m)
    assert math.isinf(seen(model(free_to_m=0.0), velocity=(0.0, -5.0, 0.0), recalled=recalled).remembered_m)
    # beyond what a camera shows free now, it still counts
    assert seen(model(free_to_m=3.0), velocity=(5.0, 0.9, 0.0), recalled=recalled).remembered_m == pytest.approx(
        4.4, abs=0.1
    )
    # where a camera looks, what it shows now counts
    assert math.isinf(seen(model(free_to_m=20.0), velocity=(5.0, 0.9, 0.0), recalled=recalled).remembered_m)


@pytest.mark.parametrize(("beside_hull_m", "hit"), [(0.28, True), (0.46, True), (0.66, False)])
def test_a_remembered_obstacle_counts_where_its_sector_meets_the_corridor(beside_hull_m: float, hit: bool) -> None:
    """It may stand anywhere in its sector, which is 0.35 m wide at 4 m: beside the hull and `side_m` it still counts."""
    across_m = AVOID.radius_m + beside_hull_m
    range_m, azimuth_rad = math.hypot(4.0, across_m), math.atan2(across_m, 4.0)
    course_rad = math.radians(5.0) - azimuth_rad  # the obstacle stands in the middle of sector 1
    distance_m = np.full(72, np.inf)
    distance_m[1] = range_m - AVOID.radius_m
    recalled = Remembered(distance_m, np.full(72, np.inf))
    velocity = (3.0 * math.cos(course_rad), 3.0 * math.sin(course_rad), 0.0)
    assert math.isfinite(seen(model(free_to_m=0.0), velocity=velocity, recalled=recalled).remembered_m) is hit


@pytest.mark.parametrize(("turn_deg_s", "hit"), [(30.0, True), (0.0, False), (-30.0, False)])
def test_in_a_turn_a_remembered_obstacle_beside_the_tangent_counts(turn_deg_s: float, hit: bool) -> None:
    distance_m = np.full(72, np.inf)
    distance_m[5] = 6.0
    recalled = Remembered(distance_m, np.full(72, np.inf))
    sight = seen(model(free_to_m=20.0), velocity=(3.0, 0.0, 0.0), recalled=recalled, turn_deg_s=turn_deg_s)
    assert math.isfinite(sight.remembered_m) is hit


def test_a_remembered_obstacle_counts_where_a_part_of_the_corridor_is_not_seen() -> None:
    """A camera that leans back does not show the lowest tenth of the corridor, in which the obstacle may stand."""
    distance_m = np.full(72, np.inf)
    distance_m[0] = 4.0
    recalled = Remembered(distance_m, np.full(72, np.inf))
    lowest_m = AVOID.band_below_m - 0.1 * (AVOID.band_above_m + AVOID.band_below_m)
    whole = model(free_to_m=20.0)
    free_to_m = np.array(whole.free.free_to_m[:, :2])
    free_to_m[:, 1] = 0.0
    profile = replace(
        whole.free,
        layer_edges_m=np.array([-3.0, lowest_m, 3.0], np.float32),
        free_from_m=whole.free.free_from_m[:, :2],
        free_to_m=free_to_m,
        end=whole.free.end[:, :2],
    )
    sight = seen(replace(whole, free=profile), recalled=recalled)
    assert sight.free_m > 15.0, "nine tenths of the rays are free"
    assert sight.remembered_m == pytest.approx(4.4)


def test_heights_that_are_not_measured_end_the_path() -> None:
    """A bar without texture at the height of the vehicle: a fifth of the rays, all of two heights."""
    whole = model(free_to_m=12.0)
    free_to_m = np.repeat(whole.free.free_to_m[:, :1], 3, axis=1)
    free_to_m[:, 1] = 6.0
    step_m = (AVOID.band_above_m + AVOID.band_below_m) / AVOID.slices
    middle_m = 0.5 * (AVOID.band_below_m - AVOID.band_above_m)
    profile = replace(
        whole.free,
        layer_edges_m=np.array([-3.0, middle_m - step_m, middle_m + step_m, 3.0], np.float32),
        free_from_m=np.repeat(whole.free.free_from_m[:, :1], 3, axis=1),
        free_to_m=free_to_m,
        end=np.repeat(whole.free.end[:, :1], 3, axis=1),
    )
    sight = seen(replace(whole, free=profile))
    assert sight.free_m == pytest.approx(6.0, abs=0.5)


def test_a_sloping_path_must_be_seen_free_at_its_heights() -> None:
    """What lies more than 1 m below the vehicle is free for 3 m only."""
    whole = model(free_to_m=20.0)
    free_to_m = np.array(whole.free.free_to_m[:, :2])
    free_to_m[:, 1] = 3.0
    profile = replace(
        whole.free,
        layer_edges_m=np.array([-30.0, 1.0, 30.0], np.float32),
        free_from_m=whole.free.free_from_m[:, :2],
        free_to_m=free_to_m,
        end=whole.free.end[:, :2],
    )
    found = replace(whole, free=profile)
    assert seen(found, velocity=(5.0, 0.0, -2.5)).free_m > 15.0
    assert seen(found, velocity=(5.0, 0.0, 2.5)).free_m < 3.5


def test_a_ray_ends_at_its_first_gap() -> None:
    samples = samples_of(Path(1.0, 0.0, 0.0), AVOID, GUARD)
    found = np.ones((len(samples.z), *samples.x.shape), bool)
    found[:, :, 9] = False
    assert samples.rays_m(found) == pytest.approx(samples.along_m[8])
    found[:, :, 0] = False
    assert samples.rays_m(found) == pytest.approx(0.0)


def test_a_remembered_obstacle_counts_behind_another_one_that_is_seen_through() -> None:
    distance_m = np.full(72, np.inf)
    distance_m[0], distance_m[1] = 3.0, 8.0
    recalled = Remembered(distance_m, np.full(72, np.inf))
    assert seen(model(free_to_m=6.0), recalled=recalled).remembered_m == pytest.approx(8.4, abs=0.1)


@pytest.mark.parametrize(
    ("at_m", "support_px", "weak"), [(8.0, 8, True), (8.0, 9, False), (0.6, 100, True), (0.6, 160, False)]
)
def test_what_covers_little_on_the_object_is_weak(at_m: float, support_px: int, weak: bool) -> None:
    found = replace(model(plane(at_m, -0.1, 0.1), free_to_m=20.0), support_px=np.array([support_px], np.int32))
    view = View(
        found, LevelTransform(0.0, (0.0, 0.0, 0.0)), Intrinsics(320, 240, 225.0, 225.0, 159.5, 119.5), np.eye(3)
    )
    s = Surroundings(
        t_ns=T_NS,
        views=(view,),
        weak_px=(8.0,),
        exposed_ns=T_NS,
        recall=None,
        recalled=nothing_remembered(),
        blind={},
        here=HERE,
        velocity_ned_m_s=(5.0, 0.0, 0.0),
    )
    sight = path_sight(s, AVOID, GUARD)
    assert math.isfinite(sight.weak_obstacle_m) is weak
    assert math.isfinite(sight.obstacle_m) is not weak

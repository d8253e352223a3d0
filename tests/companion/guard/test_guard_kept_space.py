"""Space seen free for a moment: each ray of the corridor by itself, shortened by the way flown."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.guard.assessment import LATE_NS, Action
from companion.guard.corridor import ACROSS, common_free_m, corridor_free_m
from companion.guard.kept_space import NEWEST_SHARE, Kept, Tolerance, eroded, grid_of, kept_free_m, reach_m
from companion.guard.kept_views import KeptRays
from companion.guard.path_sight import PathSight

from ..guard_sight import AVOID, BRAKING, GUARD, MS, SIGHT, action, later, model, plane, seen

RAYS = 50
FAR_M, HOLE_M = 20.0, 6.0


def rays(hole: slice | NDArray[np.bool_] = slice(0, 0), far_m: float = FAR_M, at_m: float = HOLE_M) -> dict[str, Any]:
    """Free as far as far_m, but for the rays of a hole of the depth image."""
    out = np.full(RAYS, far_m)
    out[hole] = at_m
    return {"rays_free_m": out, "free_m": corridor_free_m(out, AVOID)}


def test_the_free_distance_is_that_of_most_rays() -> None:
    assert common_free_m(np.array([5.0, 5.0, 5.0, 5.0, 0.0]), 0.8) == 5.0
    assert common_free_m(np.array([5.0, 5.0, 5.0, 4.0, 0.0]), 0.8) == 4.0
    assert common_free_m(np.array([5.0, 0.0, 5.0, 4.0, 0.0]), 0.8) == 0.0


def test_the_rays_of_a_sight_are_those_of_the_corridor() -> None:
    sight = seen(model(plane(12.0, -2.0, 2.0), free_to_m=12.0))
    assert sight.rays_free_m is not None
    assert common_free_m(sight.rays_free_m, 0.8) == sight.free_m > 10.0


HOLES = slice(0, 15), slice(30, 45), slice(12, 28)


def test_holes_at_different_places_of_the_frames_do_not_stop() -> None:
    """Each frame loses more than a fifth of the rays, and no ray is lost in all."""
    sights = [later(80 * k, **rays(hole)) for k, hole in enumerate(HOLES * 3)]
    assert BRAKING.needed_m(5.0) > HOLE_M
    assert action(replace(SIGHT, **rays()), *sights) is Action.PASS


def test_a_hole_that_stays_stops() -> None:
    sights = [later(80 * k, **rays(HOLES[0])) for k in range(1, 6)]
    assert action(replace(SIGHT, **rays()), *sights) is Action.STOP


def test_heights_that_no_frame_has_seen_stop() -> None:
    """A fifth of the rays, all of two heights in the middle: a bar without texture across the path."""
    middle = (np.arange(RAYS) // ACROSS >= 4) & (np.arange(RAYS) // ACROSS < 6)
    sights = [later(80 * k, **rays(middle)) for k in range(6)]
    assert action(*sights) is Action.STOP
    assert action(later(0, **rays()), *sights[1:3]) is Action.PASS  # a frame before has seen them
    edges = (np.arange(RAYS) // ACROSS == 0) | (np.arange(RAYS) // ACROSS == 9)
    assert action(*[later(80 * k, **rays(edges)) for k in range(6)]) is Action.PASS


def test_what_rays_saw_free_shrinks_by_the_way_flown() -> None:
    far_m = BRAKING.needed_m(5.0) + 0.5
    first, second = rays(HOLES[0], far_m), rays(HOLES[1], far_m)
    assert action(later(0, **first), later(60, **second)) is not Action.STOP
    assert action(later(0, **first), later(160, **second)) is Action.STOP


@pytest.mark.parametrize("change", [{"course_rad": 0.2}, {"course_rad": None}])
def test_rays_of_another_course_do_not_count(change: dict[str, object]) -> None:
    assert action(later(0, **rays(HOLES[0])), later(80, **rays(HOLES[1]), **change)) is Action.STOP


@pytest.mark.parametrize(("drift_deg", "stops"), [(0.1, False), (0.9, True), (2.9, True)])
def test_a_course_that_drifts_does_not_keep_a_corridor_free_that_was_never_seen(drift_deg: float, stops: bool) -> None:
    """Each sight lies within 3 degrees of the one before. Only the first saw the left half of its corridor, and all the others the right."""
    left = np.arange(RAYS) % ACROSS < ACROSS // 2
    halves = left, ~left
    sights = [
        later(
            60 * k, **rays(halves[k > 0]), course_rad=math.radians(k * drift_deg), position_ned_m=SIGHT.position_ned_m
        )
        for k in range(4)
    ]
    assert (action(*sights) is Action.STOP) is stops


def test_what_was_seen_beside_the_path_does_not_count() -> None:
    """The vehicle was moved to the side by more than side_m."""
    beside = later(80, **rays(HOLES[0]), position_ned_m=(0.4, 0.35, -3.0))
    assert action(later(0, **rays()), beside) is Action.STOP
    assert action(later(0, **rays()), replace(beside, position_ned_m=(0.4, 0.1, -3.0))) is not Action.STOP


def test_what_was_seen_on_another_slope_does_not_count() -> None:
    """The vehicle begins to climb: the level corridor was seen free, the rising one was not."""
    rising = later(80, **rays(HOLES[0]), slope=-0.3)
    assert action(later(0, **rays()), rising) is Action.STOP
    assert action(later(0, **rays(), slope=-0.29), rising) is not Action.STOP
    higher = later(80, **rays(HOLES[0]), position_ned_m=(0.4, 0.0, -3.4))
    assert action(later(0, **rays()), higher) is Action.STOP


@pytest.mark.parametrize(
    ("east_m", "down_m", "counts"),
    [(0.1, 0.0, True), (0.25, 0.0, False), (0.0, -0.05, True), (0.0, -0.15, False)],
)
def test_rays_count_within_half_of_the_distance_between_two(east_m: float, down_m: float, counts: bool) -> None:
    """Otherwise two sights, displaced to opposite sides, make space free that neither has measured."""
    now = later(80, **rays(HOLES[1]), position_ned_m=(0.4, east_m, -3.0 + down_m))
    assert (action(later(0, **rays(HOLES[0])), now) is not Action.STOP) is counts


def test_rays_count_along_a_sloping_path_of_a_vehicle_that_follows_it() -> None:
    before = later(0, **rays(HOLES[0]), slope=-0.3)
    after = later(80, **rays(HOLES[1]), slope=-0.3, position_ned_m=(0.4, 0.0, -3.12))
    assert action(before, after) is not Action.STOP
    assert action(before, replace(after, position_ned_m=(0.4, 0.0, -2.88))) is Action.STOP


@pytest.mark.parametrize(
    ("change", "reaches"),
    [
        ({"estimate": (None, 0)}, True),
        ({"estimate": (1, 0)}, True),
        ({"estimate": (2, 0)}, False),
        ({"estimate": (1, 1)}, False),
        ({"course_rad": math.pi}, False),
    ],
)
def test_a_corridor_reaches_nowhere_after_a_jump_or_in_the_opposite_direction(
    change: dict[str, Any], reaches: bool
) -> None:
    newest = replace(SIGHT, course_rad=0.0, estimate=(1, 0))
    reach = reach_m(replace(newest, **change), newest, Tolerance(0.3, 0.3))
    assert (reach > FAR_M) == reaches
    assert reach == 0.0 or reaches


def test_the_slope_of_a_sight_is_that_of_the_path() -> None:
    assert seen(model(plane(12.0, -2.0, 2.0), free_to_m=12.0), velocity=(4.0, 0.0, -1.0)).slope == -0.25


def test_an_estimate_of_the_position_that_jumps_back_does_not_lengthen_free_space() -> None:
    far_m = BRAKING.needed_m(5.0) + 0.5
    jumped = later(160, free_m=0.0, position_ned_m=(0.0, 0.0, -3.0))
    assert action(replace(SIGHT, free_m=far_m), jumped) is Action.STOP


def test_a_blank_pillar_is_not_seen_through_by_sights_displaced_to_both_sides() -> None:
    """Two columns of rays never measured anything. Each sight is a little beside the others, so that others of its rays end there."""
    columns = [(1, 2), (3, 4), (2, 3)]
    sights = []
    for k in range(12):
        free = np.full((RAYS // 5, 5), FAR_M)
        free[:, list(columns[k % 3])] = HOLE_M
        beside = (0.1, -0.1, 0.0)[k % 3]
        sights.append(later(80 * k, rays_free_m=free.ravel(), free_m=HOLE_M, position_ned_m=(0.4 * k, beside, -3.0)))
    assert action(*sights) is Action.STOP


def test_a_hole_counts_with_its_neighbours_in_earlier_sights() -> None:
    free = np.full((4, 5), FAR_M)
    free[2, 2] = HOLE_M
    lost = eroded(free.ravel(), 4).reshape(4, 5) == HOLE_M
    assert lost[1:4, 1:4].all()
    assert lost.sum() == 9


def test_the_newest_sight_must_see_half_by_itself() -> None:
    """Of a net each frame may show other gaps."""
    most = slice(0, 35)
    assert action(later(0, **rays(slice(35, 50))), later(80, **rays(most))) is Action.STOP
    assert action(later(0, **rays(slice(35, 50))), later(80, **rays(slice(0, 25)))) is not Action.STOP


def together_m(seen_now: int, exposed_ns: int = 100, way_m: float = 0.0, kept_m: float = FAR_M) -> float:
    """Of a sight that shows only the first rays, after a frame that showed all for kept_m. The oldest exposure that counts is 100 ns."""
    now_m = np.zeros(RAYS)
    now_m[:seen_now] = FAR_M
    kept = KeptRays(exposed_ns, np.full(RAYS, kept_m))
    sight = replace(SIGHT, rays_free_m=now_m, kept_rays=(kept,))
    return kept_free_m(Kept(sight, way_m), (), grid_of(AVOID, GUARD), AVOID.clear_share, 100)


def test_of_the_rays_the_newest_sight_must_see_half_of_those_needed() -> None:
    half = math.ceil(NEWEST_SHARE * AVOID.clear_share * RAYS)
    assert together_m(half) == FAR_M
    assert together_m(half - 1) == 0.0


def test_rays_of_earlier_frames_end_with_their_exposure_and_shrink_by_the_way_flown() -> None:
    assert together_m(25, exposed_ns=99) == 0.0
    assert together_m(25, way_m=3.0, kept_m=15.0) == pytest.approx(12.0)


# ---- the course that follows ----------------------------------------------------------------------------------------


def test_a_frame_before_the_turn_does_not_stand_for_the_course_that_follows() -> None:
    """The rate flickers about the least one: every second sight is of no turn."""
    lost = {"ahead_free_m": 0.0, "ahead_rad": 0.1}
    assert action(later(0), later(80, **lost)) is Action.STOP
    assert action(later(0), later(80, **lost), later(160), later(240, **lost)) is Action.STOP


def test_the_course_that_follows_counts_by_the_frame_before_along_the_same_course_alone() -> None:
    lost = {"ahead_free_m": 2.0, "ahead_rad": 0.3}
    assert action(later(0, ahead_free_m=20.0, ahead_rad=0.3), later(80, **lost)) is Action.PASS
    assert action(later(0, ahead_free_m=20.0, ahead_rad=0.2), later(80, **lost)) is Action.STOP
    needed_m = BRAKING.needed_m(5.0)
    assert action(later(0, ahead_free_m=needed_m + 0.2, ahead_rad=0.3), later(80, **lost)) is Action.STOP, (
        "the way flown"
    )


# ---- a vehicle that gets slower -------------------------------------------------------------------------------------


def slowing(from_m_s: float, to_m_s: float, after_ms: int = 0, **changes: object) -> Action:
    """Its camera has left the course, as in a turn before the next leg."""
    before = later(0, speed_m_s=from_m_s)
    lost = [
        later(ms, speed_m_s=from_m_s + (to_m_s - from_m_s) * ms / 400, free_m=0.0, **changes) for ms in (200, 300, 400)
    ]
    return action(before, *lost, after_ms=after_ms)


def test_a_vehicle_that_brakes_is_not_stopped_for_unseen_space_when_it_is_slow_at_once() -> None:
    assert slowing(1.6, 0.9) is not Action.STOP
    assert slowing(0.9, 0.9) is Action.STOP
    assert slowing(3.0, 2.3) is Action.STOP, "it does not become slow in time"


def test_a_vehicle_whose_velocity_is_late_does_not_count_as_braking() -> None:
    assert slowing(1.6, 0.9, after_ms=LATE_NS // MS) is not Action.STOP
    assert slowing(1.6, 0.9, after_ms=LATE_NS // MS + 50) is Action.STOP


def test_a_vehicle_that_brakes_is_stopped_before_an_obstacle() -> None:
    assert slowing(1.6, 0.9, obstacle_m=2.3) is Action.STOP


def test_no_vehicle_brakes_harder_than_the_guard_reckons() -> None:
    """A step of the estimated velocity is no deceleration."""
    assert slowing(5.0, 1.6) is Action.STOP
    assert slowing(3.5, 1.4) is not Action.STOP


# ---- what is remembered ---------------------------------------------------------------------------------------------


def test_a_remembered_obstacle_counts_also_where_frames_showed_it_with_few_pixels() -> None:
    def near(ms: int, **changes: object) -> PathSight:
        return later(ms, speed_m_s=0.4, position_ned_m=SIGHT.position_ned_m, **changes)

    after = near(160, remembered_m=0.9)
    assert action(near(0), after) is Action.STOP
    assert action(near(0), near(80, weak_obstacle_m=0.9), after) is Action.STOP

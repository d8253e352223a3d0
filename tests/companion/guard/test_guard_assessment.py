"""What several sights of the path say: limits, stops, and what is kept from a frame to the next."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.guard.assessment import STALE_NS, Action, PathAssessor
from companion.guard.braking import LIMIT_AHEAD_S, Braking
from companion.guard.kept_views import KEEP_FREE_NS
from companion.guard.path_sight import PathSight
from companion.guard.turn import AHEAD_S

from ..guard_sight import AVOID, BRAKING, GUARD, MS, SIGHT, T_NS, action, later, seen
from ..sector_models import model


def test_distances_of_views_that_were_not_moved_begin_at_their_exposure() -> None:
    """At 5 m/s the vehicle has flown 0.25 m since."""
    free = model(free_to_m=15.0)
    assert seen(free).shown_ns is None
    assert seen(free, moved=False).shown_ns == T_NS - 50 * MS
    for changes in ({"free_m": 9.0}, {"obstacle_m": 9.0}):
        room_m = []
        for shown_ns in (None, T_NS - 50 * MS):
            assessor = PathAssessor(GUARD, BRAKING, AVOID)
            assessor.take(replace(SIGHT, shown_ns=shown_ns, **changes))
            verdict = assessor.verdict(T_NS)
            assert verdict is not None
            room_m.append(verdict.room_m)
        assert room_m == pytest.approx([9.0, 8.75])
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    for sight in (replace(SIGHT, shown_ns=T_NS - 50 * MS, free_m=12.0), later(100, free_m=0.0)):
        assessor.take(sight)
    verdict = assessor.verdict(T_NS + 100 * MS)
    assert verdict is not None
    assert verdict.room_m == pytest.approx(12.0 - 0.75), "by an earlier sight"


@pytest.mark.parametrize(
    ("blind", "age_ms", "fails"), [({}, 300, False), ({"rear": "no frame"}, 0, True), ({}, 500, True)]
)
def test_a_failed_camera_and_late_frames_differ_from_a_path_that_is_not_shown(
    blind: dict[str, str], age_ms: int, fails: bool
) -> None:
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assessor.take(seen(model(free_to_m=0.0), blind=blind))
    verdict = assessor.verdict(T_NS + age_ms * MS)
    assert verdict is not None
    assert not verdict.sees
    assert verdict.camera_fails is fails


@pytest.mark.parametrize(("after_ms", "stops"), [(0, False), (100, True)])
def test_the_way_since_the_newest_sight_counts_for_a_firm_stop(after_ms: int, stops: bool) -> None:
    at_m = BRAKING.needed_m(5.0) + 0.3
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    for sight in (later(0, obstacle_m=at_m + 0.5), later(100, obstacle_m=at_m)):
        assessor.take(sight)
    verdict = assessor.verdict(T_NS + (100 + after_ms) * MS)
    assert verdict is not None
    assert verdict.firm_stop == verdict.obstacle_stop == stops


@given(st.floats(0.0, 15.0), st.floats(0.0, 2.0))
def test_speed_and_distance_are_inverse(speed_m_s: float, ahead_s: float) -> None:
    braking = Braking(reaction_s=0.8, deceleration_m_s2=2.0, margin_m=1.9)
    assert braking.speed_m_s(braking.needed_m(speed_m_s, ahead_s), ahead_s) == pytest.approx(speed_m_s, abs=1e-6)
    assert braking.speed_m_s(1.9) == 0.0


def test_the_braking_distance_leaves_the_margin_before_the_hull() -> None:
    assert BRAKING.needed_m(0.0) == pytest.approx(GUARD.margin_m + AVOID.radius_m)
    assert BRAKING.needed_m(4.0) == pytest.approx(
        4.0 * GUARD.reaction_s + 8.0 / GUARD.deceleration_m_s2 + GUARD.margin_m + AVOID.radius_m
    )


def test_stops_where_the_braking_distance_does_not_fit() -> None:
    needed_m = BRAKING.needed_m(5.0)
    assert action(replace(SIGHT, obstacle_m=needed_m - 0.1)) is Action.STOP
    assert action(replace(SIGHT, free_m=needed_m - 0.1)) is Action.STOP
    assert action(replace(SIGHT, obstacle_m=needed_m + 0.1)) is Action.SLOW
    assert action(replace(SIGHT, free_m=20.0)) is Action.PASS


def test_an_obstacle_is_nearer_by_the_way_flown_since_the_decision() -> None:
    sight = replace(SIGHT, obstacle_m=BRAKING.needed_m(5.0) + 0.5)
    assert action(sight) is Action.SLOW
    assert action(sight, after_ms=150) is Action.STOP


def test_a_vehicle_that_accelerates_is_limited_before() -> None:
    slower = replace(
        SIGHT, t_ns=T_NS - 300 * MS, exposed_ns=T_NS - 350 * MS, speed_m_s=4.0, position_ned_m=(-1.3, 0.0, -3.0)
    )
    room_m = BRAKING.needed_m(5.0, LIMIT_AHEAD_S) + 2.0
    assert action(replace(slower, speed_m_s=5.0), replace(SIGHT, free_m=room_m)) is Action.PASS
    assert action(replace(slower, free_m=0.0), replace(SIGHT, free_m=room_m)) is Action.SLOW
    assert action(replace(slower, speed_m_s=7.0, free_m=0.0), replace(SIGHT, free_m=room_m)) is Action.PASS


def test_a_vehicle_that_accelerates_is_stopped_earlier() -> None:
    before = replace(
        SIGHT,
        t_ns=T_NS - 300 * MS,
        exposed_ns=T_NS - 350 * MS,
        speed_m_s=4.1,
        position_ned_m=(-1.3, 0.0, -3.0),
        free_m=0.0,
    )
    room_m = BRAKING.needed_m(5.0) + 1.0
    assert action(replace(before, speed_m_s=5.0), replace(SIGHT, obstacle_m=room_m)) is Action.SLOW
    assert action(before, replace(SIGHT, obstacle_m=room_m)) is Action.STOP


def test_one_frame_that_sees_less_does_not_stop_and_three_do() -> None:
    assert action(SIGHT, later(80, free_m=3.0)) is Action.PASS
    assert action(SIGHT, later(80, free_m=3.0), later(160, free_m=3.0), later(310, free_m=3.0)) is Action.STOP


def test_what_was_seen_free_is_kept_from_its_exposure() -> None:
    """With several cameras, or a slow one, a frame may be old at the decision that uses it."""
    kept_ms = KEEP_FREE_NS // 1_000_000
    for old_ms in (50, 120, 200):
        before = replace(SIGHT, exposed_ns=T_NS - old_ms * MS)
        last_ms = kept_ms - old_ms
        assert action(before, later(last_ms, free_m=3.0)) is Action.PASS
        assert action(before, later(last_ms + 1, free_m=3.0)) is Action.STOP


def test_what_was_seen_free_ends_between_two_decisions() -> None:
    now = later(100, free_m=3.0)
    left_ms = KEEP_FREE_NS // 1_000_000 - 150
    assert action(SIGHT, now, after_ms=left_ms) is Action.PASS
    assert action(SIGHT, now, after_ms=left_ms + 1) is Action.STOP


def test_a_sight_whose_exposure_is_not_known_is_not_kept() -> None:
    assert action(replace(SIGHT, exposed_ns=None), later(50, free_m=3.0)) is Action.STOP


def test_the_course_that_follows_must_be_seen_by_the_newest_frame_or_the_one_before() -> None:
    seen_ahead, lost = ({"ahead_free_m": free_m, "ahead_rad": 0.3} for free_m in (20.0, 2.0))
    assert action(later(0, **seen_ahead), later(80, **seen_ahead)) == Action.PASS
    assert action(later(0, **seen_ahead), later(80, **lost)) == Action.PASS, "a mismatch ends it in one frame"
    assert action(later(0, **seen_ahead), later(80, **lost), later(160, **lost)) == Action.STOP
    same = later(80, **lost).exposed_ns
    assert action(later(0, **seen_ahead), later(80, **lost), later(140, exposed_ns=same, **lost)) == Action.PASS
    assert action(later(0, **seen_ahead), later(240, **lost)) == Action.STOP, "the frame before is too old"
    assert action(later(0, **lost)) == Action.STOP


def test_the_noise_of_a_velocity_is_no_turn() -> None:
    """0.09 m/s across a course of 3 m/s, within 0.3 s: 5.7 degrees per second, and a frame that leans shows less."""
    noise, turn = math.radians(5.7) * AHEAD_S, math.radians(20.0) * AHEAD_S
    assert action(later(0, speed_m_s=3.0, ahead_free_m=2.0, ahead_rad=noise)) is not Action.STOP
    assert action(later(0, speed_m_s=3.0, ahead_free_m=2.0, ahead_rad=-noise)) is not Action.STOP
    assert action(later(0, speed_m_s=3.0, ahead_free_m=2.0, ahead_rad=turn)) is Action.STOP
    assert action(later(0, speed_m_s=3.0, free_m=2.0, ahead_free_m=2.0, ahead_rad=noise)) is Action.STOP
    assert action(later(0, speed_m_s=6.0, ahead_free_m=2.0, ahead_rad=noise)) is Action.STOP, "it leaves the path"


def test_the_place_where_a_turn_leaves_the_path_comes_nearer_by_the_way_flown() -> None:
    noise = math.radians(5.7) * AHEAD_S
    beside_m = GUARD.side_m / math.tan(noise)
    assert BRAKING.needed_m(3.3) == pytest.approx(beside_m - 0.3, abs=0.1)
    turning = later(0, speed_m_s=3.3, ahead_free_m=2.0, ahead_rad=noise)
    assert action(turning) is not Action.STOP
    assert action(turning, after_ms=200) is Action.STOP


def test_free_space_of_before_shrinks_by_the_way_flown() -> None:
    needed_m = BRAKING.needed_m(5.0)
    before = replace(SIGHT, free_m=needed_m + 0.5)
    assert action(before, later(80, free_m=0.0)) is not Action.STOP
    assert action(before, later(160, free_m=0.0)) is Action.STOP


def test_without_a_position_the_way_flown_is_that_of_the_greater_speed() -> None:
    before = replace(SIGHT, position_ned_m=None, free_m=BRAKING.needed_m(2.0) + 1.0)
    now = later(250, speed_m_s=2.0, free_m=0.0, position_ned_m=None)
    assert action(before, now) is Action.STOP
    assert action(replace(before, speed_m_s=2.0), now) is not Action.STOP


def test_free_space_on_another_course_does_not_count() -> None:
    assert action(SIGHT, later(80, free_m=3.0, course_rad=0.2)) is Action.STOP


def test_a_slow_vehicle_does_not_use_free_space_of_another_course() -> None:
    slow = replace(SIGHT, speed_m_s=1.0, course_rad=math.radians(2.0))
    now = later(80, speed_m_s=1.0, free_m=0.0, position_ned_m=(0.08, 0.0, -3.0))
    assert action(slow, now) is not Action.STOP
    assert action(replace(slow, course_rad=math.radians(4.0)), now) is Action.STOP


def test_an_obstacle_counts_at_once_unless_few_pixels_show_it() -> None:
    assert action(SIGHT, later(80, obstacle_m=5.0)) is Action.STOP
    assert action(SIGHT, later(80, weak_obstacle_m=5.0)) is Action.PASS
    assert action(SIGHT, later(80, weak_obstacle_m=5.0), later(160, weak_obstacle_m=4.6)) is Action.STOP
    assert action(SIGHT, later(80, weak_obstacle_m=9.0), later(160, weak_obstacle_m=4.6)) is Action.PASS


def test_near_and_weakly_supported_needs_a_third_frame() -> None:
    near = later(80, weak_obstacle_m=2.2), later(160, weak_obstacle_m=1.8), later(240, weak_obstacle_m=1.4)
    assert action(SIGHT, *near[:2]) is Action.PASS
    assert action(SIGHT, *near) is Action.STOP
    assert action(SIGHT, near[0], later(160, weak_obstacle_m=1.0), near[2]) is Action.PASS


def test_the_same_frame_twice_confirms_nothing() -> None:
    first = later(80, weak_obstacle_m=5.0)
    again = replace(first, t_ns=first.t_ns + 60 * MS)
    assert action(SIGHT, first, again) is Action.PASS


def test_a_new_frame_of_another_camera_confirms_nothing() -> None:
    """The exposures of all cameras differ, the obstacle comes from one frame."""
    frame = ("front", T_NS)
    first = later(80, weak_obstacle_m=5.0, weak_frame=frame)
    again = later(140, weak_obstacle_m=4.7, weak_frame=frame)
    assert action(SIGHT, first, again) is Action.PASS
    assert action(SIGHT, first, replace(again, weak_frame=("front", T_NS + 60 * MS))) is Action.STOP
    assert action(SIGHT, first, replace(again, weak_frame=("left", T_NS))) is Action.STOP


def test_a_firm_stop_needs_two_frames_and_no_memory() -> None:
    def firm(*sights: PathSight) -> tuple[bool, bool]:
        assessor = PathAssessor(GUARD, BRAKING, AVOID)
        for sight in sights:
            assessor.take(sight)
        verdict = assessor.verdict(sights[-1].t_ns)
        assert verdict is not None
        return verdict.obstacle_stop, verdict.firm_stop

    assert firm(SIGHT, later(80, obstacle_m=5.0)) == (True, False)
    assert firm(SIGHT, later(80, obstacle_m=5.0), later(160, obstacle_m=4.6)) == (True, True)
    assert firm(SIGHT, later(80, weak_obstacle_m=5.0), later(160, weak_obstacle_m=4.6)) == (True, False)
    assert firm(SIGHT, later(80, weak_obstacle_m=5.0), later(160, obstacle_m=4.6)) == (True, False)
    assert firm(SIGHT, later(80, remembered_m=5.0), later(160, remembered_m=4.6)) == (True, False)
    assert firm(later(80, free_m=0.0)) == (False, False)


def test_a_remembered_obstacle_is_no_sight() -> None:
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assessor.take(replace(SIGHT, free_m=0.0, remembered_m=5.0))
    verdict = assessor.verdict(T_NS)
    assert verdict is not None
    assert not verdict.sees
    assert verdict.action is Action.STOP


def test_a_sender_that_hangs_is_blindness() -> None:
    assert action(SIGHT, after_ms=100) is Action.PASS
    assert action(SIGHT, after_ms=STALE_NS // MS + 1) is Action.STOP


def test_slowly_into_the_unseen_but_not_into_an_obstacle() -> None:
    slow = replace(SIGHT, speed_m_s=0.6, free_m=0.0)
    assert action(slow) is not Action.STOP
    assert action(replace(slow, obstacle_m=2.0)) is Action.STOP
    assert action(replace(slow, speed_m_s=0.8)) is Action.STOP


@pytest.mark.parametrize(
    ("changes", "sees"),
    [
        ({}, True),
        ({"free_m": 0.0}, False),
        ({"free_m": 0.0, "obstacle_m": 4.0}, True),
        ({"cause": "front: no frame"}, False),
        ({"exposed_ns": T_NS - STALE_NS - 1}, False),
        ({"exposed_ns": None}, False),
    ],
)
def test_whether_the_path_is_seen(changes: dict[str, Any], sees: bool) -> None:
    """Also a direction to which no camera looks is not seen."""
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assessor.take(replace(SIGHT, **changes))
    verdict = assessor.verdict(T_NS)
    assert verdict is not None
    assert verdict.sees is sees


def test_without_a_speed_there_is_no_verdict() -> None:
    assessor = PathAssessor(GUARD, BRAKING, AVOID)
    assert assessor.verdict(T_NS) is None
    assessor.take(replace(SIGHT, speed_m_s=None))
    assert assessor.verdict(T_NS) is None

"""Which obstacles of the size of a vehicle were observed whole: those of which nothing nearer may hide a part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.sharing.bodies import Body
from core.sharing.records import CUT, SharedMover, SharedPlanes
from core.sharing.whole_views import FRESH_S, WholeViews, partly_hidden

from .neighbours import mover

EYE = (0.0, 0.0, -3.0)
HEAD = (10.0, -0.3, 10.0, 0.3, -1.8, -1.2)
HEDGE, LOW_HEDGE, WALL_BEHIND = (
    (8.0, -4.0, 8.0, 4.0, -1.7, 0.0),
    (8.0, -4.0, 8.0, 4.0, -0.4, 0.0),
    (12.0, -4.0, 12.0, 4.0, -6.0, 0.0),
)
SEEN = replace(mover(10.0), id=9, centre_m=(10.0, 0.0, -1.5), half_size_m=(0.3, 0.3, 0.3), age_s=0.1)


def planes(*rows: tuple[float, ...], age_s: float = 0.1, flags: int = 0) -> SharedPlanes:
    n = len(rows)
    return SharedPlanes(
        ids=np.arange(n, dtype=np.uint16),
        box=np.array(rows, np.float64).reshape(n, 6),
        margin_m=np.full(n, 0.1),
        flags=np.full(n, flags, np.uint8),
        age_s=np.full(n, age_s),
    )


@pytest.mark.parametrize("turn", range(8))
@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (HEDGE, True),
        (LOW_HEDGE, False),
        (WALL_BEHIND, False),
        ((8.0, 0.4, 8.0, 4.0, -5.0, 0.0), True),  # a wall beside it
        ((8.0, 1.5, 8.0, 4.0, -5.0, 0.0), False),
        ((5.0, 0.2, 20.0, 4.0, -5.0, 0.0), True),  # a wall along the view
        ((1.0, 0.3, 9.0, 12.0, -5.0, 0.0), False),
        ((8.0, -4.0, 8.0, 4.0, -4.0, -2.2), True),  # a roof above it
        ((8.0, -4.0, 8.0, 4.0, -5.0, -2.9), False),
        ((9.7, -4.0, 9.7, 4.0, -1.7, 0.0), False),  # another side of the same thing
        ((-8.0, -4.0, -8.0, 4.0, -5.0, 0.0), False),  # behind the vehicle
        (HEAD, False),
    ],
)
def test_a_nearer_outline_on_or_beside_its_own_may_hide_a_part(
    other: tuple[float, ...], expected: bool, turn: int
) -> None:
    angle = 0.25 * np.pi * turn
    c, s = np.cos(angle), np.sin(angle)
    move = np.array([3.0, -7.0])

    def turned(row: tuple[float, ...]) -> np.ndarray:
        ends = [np.array([c * x - s * y, s * x + c * y]) + move for x, y in (row[0:2], row[2:4])]
        return np.array([[*ends[0], *ends[1], *row[4:]]])

    eye_m = float(move[0]), float(move[1]), EYE[2]
    assert partly_hidden(turned(HEAD), turned(other), eye_m).tolist() == [expected]


def test_a_place_on_a_plane_is_no_error() -> None:
    with np.errstate(all="raise"):
        partly_hidden(np.array([HEAD, (0.0, -1.0, 0.0, 1.0, -4.0, -3.0)]), np.array([HEDGE, HEAD]), EYE)
    assert partly_hidden(np.zeros((0, 6)), np.array([HEDGE]), EYE).tolist() == []
    assert partly_hidden(np.array([HEAD]), np.zeros((0, 6)), EYE).tolist() == [False]


def is_marked(found: SharedPlanes) -> list[bool]:
    return ((found.flags & int(CUT)) != 0).tolist()


def test_low_planes_that_may_be_hidden_in_part_are_marked() -> None:
    tall = (10.0, 3.0, 10.0, 3.6, -1.8, 0.0)
    assert is_marked(WholeViews().planes(planes(HEDGE, HEAD, tall), EYE, 1)) == [False, True, False]
    assert is_marked(WholeViews().planes(planes(LOW_HEDGE, HEAD, tall), EYE, 1)) == [False, False, False]


def test_a_plane_counts_as_whole_only_if_its_newest_view_was() -> None:
    """Later it is compared from another place, where the hedge is not in the way."""
    views, away = WholeViews(), (10.0, 8.0, -3.0)
    old = planes(HEDGE, HEAD, age_s=FRESH_S + 0.1)
    assert is_marked(views.planes(old, away, 1)) == [False, True], "it was never examined"
    views.planes(planes(HEDGE, HEAD), EYE, 1)
    assert is_marked(views.planes(old, away, 1)) == [False, True]
    views.planes(planes(HEDGE, HEAD), away, 1)
    assert is_marked(views.planes(old, EYE, 1)) == [False, False]


@pytest.mark.parametrize("change", ["section", "number"])
def test_what_was_found_ends_with_the_frame_and_with_the_plane(change: str) -> None:
    views = WholeViews()
    whole, old = planes(LOW_HEDGE, HEAD), planes(LOW_HEDGE, HEAD, age_s=FRESH_S + 0.1)
    assert is_marked(views.planes(whole, EYE, 1)) == [False, False]
    if change == "number":
        views.planes(planes(LOW_HEDGE), EYE, 1)
    assert is_marked(views.planes(old, EYE, 2 if change == "section" else 1)) == [change == "section", True]


def test_moving_obstacles_that_may_be_hidden_in_part_are_marked() -> None:
    views = WholeViews()

    def partial(mover: SharedMover, *rows: tuple[float, ...]) -> bool:
        (found,) = views.movers((mover,), np.array(rows), EYE)
        return found.partial

    assert partial(SEEN, HEDGE)
    assert not partial(SEEN, LOW_HEDGE)
    assert partial(replace(SEEN, partial=True), LOW_HEDGE), "the border of the image cuts it"
    assert partial(replace(SEEN, age_s=FRESH_S + 0.1), LOW_HEDGE), "as in its newest view"
    assert not partial(SEEN, LOW_HEDGE)
    assert not partial(replace(SEEN, age_s=FRESH_S + 0.1), HEDGE)
    assert views.movers((), np.array([HEDGE]), EYE) == ()
    assert partial(replace(SEEN, age_s=FRESH_S + 0.1), LOW_HEDGE), "it was never examined"


MEMBER = Body(2, (10.0, 0.0, -1.9), 0.4, 0.5)
FRONT, BACK = (9.4, -0.4, 9.4, 0.4, -2.0, -1.7), (10.1, -0.4, 10.1, 0.4, -2.1, -1.8)
LEGS, DRONE, BRANCH = (
    (10.1, -0.3, 10.1, 0.3, -1.1, -0.5),
    (9.4, -0.3, 9.4, 0.3, -1.45, -1.1),
    (8.0, -4.0, 8.0, 4.0, -2.9, -1.88),
)


def test_planes_of_one_vehicle_do_not_hide_each_other() -> None:
    """Ten metres away its depth is uncertain by more than its size: it is observed as two planes, one behind the other."""
    assert is_marked(WholeViews().planes(planes(FRONT, BACK), EYE, 1)) == [False, True], "no vehicle is that large"
    assert is_marked(WholeViews().planes(planes(FRONT, BACK), EYE, 1, (MEMBER,))) == [False, False]
    small = replace(MEMBER, vehicle=3, radius_m=0.1)
    assert is_marked(WholeViews().planes(planes(FRONT, BACK), EYE, 1, (MEMBER, small))) == [False, True]


@pytest.mark.parametrize(
    ("hiders", "expected"),
    [
        ([DRONE], False),  # together not higher than a vehicle
        ([(*DRONE[:4], -1.8, -1.1)], True),
        ([BRANCH], False),
        ([BRANCH, DRONE], True),  # what is behind the drone may go on behind the branch
        ([(9.4, 0.2, 9.4, 2.4, -1.1, -0.6)], True),  # as wide as no vehicle
        ([(-1.0, 0.05, 9.4, 0.05, -1.1, -0.6)], True),  # along the view, past the viewer
    ],
)
def test_a_person_of_whom_more_may_be_hidden_than_a_vehicle_is_large_stays_marked(
    hiders: list[tuple[float, ...]], expected: bool
) -> None:
    found = WholeViews().planes(planes(*hiders, LEGS), EYE, 1, (MEMBER,))
    assert is_marked(found)[-1] == expected


def test_a_moving_vehicle_is_not_hidden_by_its_own_planes() -> None:
    seen = replace(SEEN, centre_m=(10.1, 0.0, -1.95), half_size_m=(0.3, 0.3, 0.15))
    for others, expected in (((), True), ((MEMBER,), False)):
        (found,) = WholeViews().movers((seen,), np.array([FRONT]), EYE, others)
        assert found.partial == expected

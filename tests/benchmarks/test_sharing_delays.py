"""Delay of obstacles between vehicles, by place."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.sharing.delays import NS, Confirmed, Received, contains, delays
from core.sharing.records import SharedPlanes


def planes(number: int, *box: float) -> SharedPlanes:
    return SharedPlanes(
        ids=np.array([number], np.uint16),
        box=np.array([box]),
        margin_m=np.array([0.1]),
        flags=np.zeros(1, np.uint8),
        age_s=np.array([0.1]),
    )


WALL, OTHER = (0.0, 0.0, 4.0, 0.0, -3.0, 0.0), (0.0, 9.0, 4.0, 9.0, -3.0, 0.0)
END = (10 * NS, np.array([50.0, 0.0, 51.0, 0.0, -3.0, 0.0]))


def measured(*arrived: tuple[float, SharedPlanes]) -> tuple[list[float], int]:
    confirmed = Confirmed([(NS, np.array(WALL)), END])
    published = [k * NS // 5 for k in range(60)]
    received = Received([(round(t * NS), 2, p) for t, p in arrived], published)
    return delays(confirmed, received, 2, 0)


def test_the_delay_ends_with_the_publication_of_the_place() -> None:
    found, never = measured((1.25, planes(7, *WALL)))
    assert found == pytest.approx([0.4])
    assert never == 0


def test_another_plane_of_the_same_number_does_not_end_it() -> None:
    assert measured((1.25, planes(7, *OTHER))) == ([], 1)


def test_a_part_does_not_end_it_and_a_lower_one_neither() -> None:
    assert measured((1.25, planes(7, 0.0, 0.0, 2.5, 0.0, -3.0, 0.0))) == ([], 1)
    assert measured((1.25, planes(7, 0.0, 0.0, 4.0, 0.0, -1.0, 0.0))) == ([], 1)


def test_what_the_receiver_has_already_is_not_new() -> None:
    assert measured((0.5, planes(3, *WALL))) == ([], 0)


def test_contains() -> None:
    assert contains(np.array([WALL]), np.array([0.5, 0.4, 3.5, 0.4, -3.2, 0.0]))
    assert not contains(np.array([WALL]), np.array([0.5, 0.6, 3.5, 0.6, -3.0, 0.0]))
    assert not contains(np.zeros((0, 6)), np.array(WALL))

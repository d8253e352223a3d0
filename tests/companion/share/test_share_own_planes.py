"""Which planes of the own world are offered to other vehicles."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from companion.share.own_planes import own_planes
from core.world.plane_index import SLOT
from core.world.world import World

NS = 1_000_000_000
NOW_NS = 10 * NS


def world(x_m: list[float], hits: list[int]) -> World:
    """A world with the newest camera at (100, 0): planes of 2 m along x that begin at these places. The slot of each is its row."""
    table = np.zeros(len(x_m), SLOT)
    table["ax_m"], table["bx_m"], table["top_m"] = x_m, np.array(x_m) + 2.0, -3.0
    table["hits"], table["margin_m"], table["plane_flags"] = hits, 0.25, np.arange(len(x_m))
    table["seen_ns"] = NOW_NS - NS * np.arange(len(x_m))
    section = SimpleNamespace(used_slots=table, place_m=(100.0, 0.0, -2.0), number=7, newest_ns=9 * NS)
    return cast(World, SimpleNamespace(section=section))


def offered(
    x_m: list[float], hits: list[int], least_hits: int = 3, range_m: float = 50.0, most: int = 100
) -> list[int]:
    return own_planes(world(x_m, hits), NOW_NS, least_hits, range_m, most).planes.ids.tolist()


def test_planes_that_few_frames_have_observed_are_not_offered() -> None:
    assert offered([99.0, 99.0, 99.0, 99.0], [2, 3, 0, 4]) == [1, 3]


def test_empty_slots_are_not_offered_whatever_the_limit() -> None:
    assert offered([99.0, 99.0], [0, 1], least_hits=0) == [1]


@pytest.mark.parametrize(("x_m", "expected"), [(49.5, [0]), (48.5, []), (148.5, [0]), (149.5, [])])
def test_planes_beyond_the_range_are_not_offered(x_m: float, expected: list[int]) -> None:
    """The middle counts, 1 m from the end."""
    assert offered([x_m], [5]) == expected


def test_of_many_planes_the_nearest_are_offered() -> None:
    assert offered([120.0, 99.0, 90.0, 104.0], [5] * 4, most=3) == [1, 3, 2]


def test_planes_keep_their_values_and_have_their_age() -> None:
    found = own_planes(world([99.0, 102.0], [5, 5]), NOW_NS + NS // 2, 3, 50.0, 100)
    planes = found.planes
    assert (found.section, found.newest_ns) == (7, 9 * NS)
    assert planes.box.tolist() == [[99.0, 0.0, 101.0, 0.0, -3.0, 0.0], [102.0, 0.0, 104.0, 0.0, -3.0, 0.0]]
    assert planes.age_s.tolist() == [0.5, 1.5]
    assert (planes.margin_m.tolist(), planes.flags.tolist()) == ([0.25, 0.25], [0, 1])


def test_a_world_without_a_frame_offers_nothing() -> None:
    found = own_planes(World(), NOW_NS, 3, 50.0, 100)
    assert (len(found.planes), found.section) == (0, 0)

"""Own moving obstacles after a jump of the own position, and the number of a start with an unset clock."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.share.own_movers import OwnMovers
from companion.share.share_service import MOST_STREAM, stream_of
from core.sharing.records import MOVER_IDS
from core.types import PlaneFlags

from .test_share_thread import NS, Made, attitudes, moving, pose, received_movers, tracked, tracks_of


def test_moving_obstacles_of_frames_before_a_jump_are_left_out() -> None:
    """They stand in the section before it: a tracker follows the jump with the next frame of its camera."""
    own = OwnMovers()
    own.take("front", tracks_of(moving(20.0)), 5 * NS)
    own.take("rear", tracks_of(moving(-20.0)), 6 * NS)
    assert [m.centre_m[0] for m in own.at(6 * NS, 0)] == [20.0, -20.0]
    assert [m.centre_m[0] for m in own.at(6 * NS, 6 * NS)] == [-20.0]
    assert own.at(6 * NS, 6 * NS + 1) == ()


def test_a_jump_of_the_own_position_stops_the_report_of_earlier_moving_obstacles() -> None:
    made = Made()
    made.sharing.tracks(tracked("front", 5 * NS, moving(20.0)))
    made.sharing.samples([*attitudes(5 * NS), pose(5 * NS)])
    made.sharing.samples([pose(5 * NS + NS // 20, 50.0, 1)])
    assert received_movers(made, 5 * NS + NS // 10) == []
    made.sharing.tracks(tracked("front", 5 * NS + NS // 2, moving(70.0)))
    assert received_movers(made, 5 * NS + 6 * NS // 10) == [pytest.approx(70.8, abs=0.3)]


@pytest.mark.parametrize("cameras", [1, 8, 9, 20])
def test_no_two_moving_obstacles_have_one_number(cameras: int) -> None:
    """Each camera numbers its obstacles by itself; a receiver keeps one of each number."""
    own = OwnMovers()
    for camera in range(cameras):
        own.take(f"camera {camera}", tracks_of(*(replace(moving(20.0), id=number) for number in range(1, 10))), 5 * NS)
    numbers = [m.id for m in own.at(5 * NS, 0)]
    assert len(set(numbers)) == len(numbers) == 9 * cameras
    assert max(numbers) < MOVER_IDS


@pytest.mark.parametrize("flag", [PlaneFlags.CUT_LEFT, PlaneFlags.CUT_TOP, PlaneFlags.CUT_BOTTOM])
def test_a_moving_obstacle_that_the_border_of_the_image_cuts_is_partial(flag: PlaneFlags) -> None:
    """If one of its planes is cut; those of static obstacles and of others do not count."""
    own = OwnMovers()
    one, two = moving(20.0), replace(moving(10.0), id=5)
    own.take("front", tracks_of(one, two, flags={0: flag, 5: PlaneFlags.IRREGULAR, 4: flag}), 5 * NS)
    assert [m.partial for m in own.at(5 * NS, 0)] == [True, False]
    own.take("front", tracks_of(one, two, flags={0: flag}), 5 * NS)
    assert [m.partial for m in own.at(5 * NS, 0)] == [False, False]


@pytest.mark.parametrize(("unix_ns", "stream"), [(-5 * NS, 1), (0, 1), (23 * NS, 23), (1 << 62, (1 << 62) // NS)])
def test_the_stream_of_a_start_is_the_time(unix_ns: int, stream: int) -> None:
    assert stream_of(unix_ns) == min(stream, MOST_STREAM)


def test_the_stream_of_a_start_fits_into_a_packet_whatever_the_clock() -> None:
    assert stream_of((1 << 63) - 1) == MOST_STREAM < (1 << 32) - 1

"""What a single frame shows near, with few pixels, is sent once a second frame shows it; what is large, at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.autopilot.phantoms import hover
from companion.autopilot.obstacle_distance import UNKNOWN
from core.types import FrameModel

from .test_obstacle_sender import ARDUPILOT, AVOID, CLEAR, PX4, Chain
from .test_sectors import model, wall_at

CLEAR_CM = 1201


def pole(distance_m: float, support_px: int, at_deg: float = 0.0) -> FrameModel:
    found = model(wall_at(at_deg, distance_m), free_to_m=13.0, view_deg=72.0)
    return replace(found, support_px=np.array([support_px], np.int32))


def seeing(first: FrameModel = CLEAR) -> Chain:
    """A hovering vehicle; what is sent is decided after each frame, as the sender's thread does."""
    chain = Chain(first)
    chain.position = (0.0, 0.0, -2.0)
    for _ in range(10):
        one_frame(chain, first)
    return chain


def one_frame(chain: Chain, found: FrameModel) -> None:
    chain.sees.found = found
    chain.fly(0.1)
    chain.told()


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("distance_m", [1.5, 3.0, 5.5])
def test_few_pixels_on_one_frame_are_neither_sent_nor_remembered(autopilot: object, distance_m: float) -> None:
    chain = seeing()
    one_frame(chain, pole(distance_m, 8))
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, CLEAR)
    for _ in range(30):
        assert chain.ahead(autopilot) == CLEAR_CM
        chain.fly(0.1)


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 5.5])
def test_the_second_frame_sends_it(distance_m: float) -> None:
    chain = seeing()
    one_frame(chain, pole(distance_m, 3))
    assert chain.ahead() == CLEAR_CM
    one_frame(chain, pole(distance_m + 0.1, 3))
    assert chain.ahead() == pytest.approx(100 * (distance_m - 0.2), abs=3)


def test_a_thin_one_that_is_not_found_in_each_frame_is_sent() -> None:
    chain = seeing()
    for found in (pole(3.0, 3), CLEAR, CLEAR):
        one_frame(chain, found)
        assert chain.ahead() == CLEAR_CM
    one_frame(chain, pole(3.0, 3))
    assert chain.ahead() == pytest.approx(270, abs=2)


@pytest.mark.parametrize("other", [pole(3.0, 3, at_deg=12.0), pole(4.2, 3)])
def test_another_place_confirms_nothing(other: FrameModel) -> None:
    chain = seeing()
    one_frame(chain, pole(3.0, 3))
    one_frame(chain, other)
    values = chain.told().values
    assert values is not None
    assert not (values < 1200).any()


@pytest.mark.parametrize(("support_px", "distance_m"), [(9, 3.0), (500, 1.0), (3, 7.0)])
def test_a_large_one_is_sent_at_once_and_so_is_a_far_one(support_px: int, distance_m: float) -> None:
    chain = seeing()
    one_frame(chain, pole(distance_m, support_px))
    assert chain.ahead() == pytest.approx(100 * (distance_m - 0.3), abs=2)


def test_it_can_be_switched_off() -> None:
    chain = Chain(CLEAR, replace(AVOID, confirm_px=0))
    chain.fly(1.0)
    one_frame(chain, pole(3.0, 3))
    assert chain.ahead() == 270


BLOCKED = model(free_to_m=4.0, view_deg=72.0)


@pytest.mark.parametrize(("autopilot", "unseen"), [(PX4, UNKNOWN), (ARDUPILOT, 370)])
def test_a_sector_that_one_frame_does_not_see_stays_as_it_was(autopilot: object, unseen: int) -> None:
    chain = seeing()
    one_frame(chain, BLOCKED)
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, CLEAR)
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, BLOCKED)
    one_frame(chain, BLOCKED)
    assert chain.ahead(autopilot) == unseen
    for _ in range(5):  # and it does not come back by what was seen before
        one_frame(chain, BLOCKED)
        assert chain.ahead(autopilot) == unseen


def test_a_sector_that_was_never_seen_is_not_seen() -> None:
    chain = Chain(BLOCKED)
    for _ in range(8):
        chain.fly(0.1)
        assert chain.ahead() == UNKNOWN


def test_an_obstacle_that_one_frame_loses_stays_where_it_was() -> None:
    chain = seeing(pole(5.0, 500))
    assert chain.ahead() == 470
    one_frame(chain, BLOCKED)
    assert chain.ahead() == 470


def test_what_was_seen_is_not_kept_when_the_vehicle_turns() -> None:
    chain = seeing()
    chain.yaw_rad = 0.05
    one_frame(chain, BLOCKED)
    assert chain.ahead() == UNKNOWN


def test_a_hover_before_a_bare_wall_sends_nothing_near() -> None:
    """The typical camera of 320x240 pixels. Without confirmation the memory makes half of all messages of 2 % of the frames."""
    assert hover(100, 0).near > 20
    assert hover(100, 8).near == 0

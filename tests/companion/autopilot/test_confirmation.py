"""What a single frame shows near, with few pixels, is sent once a second frame shows it; what is large, at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.autopilot.phantoms import hover
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from core.types import FrameModel
from tests.nightly import nightly

from ..hovering import CLEAR_CM, one_frame, pole, seeing
from ..report_chain import ARDUPILOT, AVOID, CAMERA, CLEAR, PX4, Chain
from ..sector_models import model


@pytest.mark.parametrize(
    ("autopilot", "distance_m"),
    [(PX4, 1.5), (ARDUPILOT, 5.5), *nightly((PX4, 5.5), (ARDUPILOT, 1.5), (PX4, 3.0), (ARDUPILOT, 3.0))],
)
def test_few_pixels_on_one_frame_are_neither_sent_nor_remembered(autopilot: object, distance_m: float) -> None:
    chain = seeing()
    one_frame(chain, pole(distance_m, 8))
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, CLEAR)
    for _ in range(30):
        assert chain.ahead(autopilot) == CLEAR_CM
        chain.fly(0.1)


def remembers_free() -> tuple[Chain, list[Surroundings]]:
    """A chain that has seen ten free frames, and the surroundings of each decision."""
    shown: list[Surroundings] = []
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front",), timeout_s=0.3, observer=shown.append))
    chain.builder.announce(CAMERA)
    chain.position = (0.0, 0.0, -2.0)
    for _ in range(10):
        one_frame(chain, CLEAR)
    return chain, shown


def test_what_is_not_sent_yet_ends_the_memory_of_free_space_at_its_place() -> None:
    """A thin obstacle may be found in a single frame only before it leaves the image."""
    chain, shown = remembers_free()

    def free_above() -> bool:
        """At the pole's place, above the image."""
        assert shown[-1].recall is not None
        return bool(shown[-1].recall(np.array([2.6]), np.array([0.0]), np.array([-1.6]))[0])

    assert free_above()
    one_frame(chain, pole(2.6, 3))
    assert len(shown[-1].views[0].model.planes) == 0
    assert not free_above()
    for _ in range(3):
        one_frame(chain, CLEAR)
    assert free_above()


def test_what_was_seen_free_does_not_count_where_a_camera_looks_now() -> None:
    _, shown = remembers_free()
    assert shown[-1].recall is not None
    places = np.array([2.6, 2.6]), np.zeros(2), np.array([-1.6, 0.0])  # above the image, and in it
    assert shown[-1].recall(*places).tolist() == [True, False]


@pytest.mark.parametrize(("ke_per_m", "confirmed"), [(0.0, False), (0.005, True)])
def test_the_place_of_a_far_plane_is_as_uncertain_as_its_noise(ke_per_m: float, confirmed: bool) -> None:
    chain = seeing()
    for x_m in (5.0, 5.7):
        found = model((x_m, -0.1, x_m, 0.1, -2.0, 2.0), free_to_m=13.0, view_deg=72.0)
        one_frame(chain, replace(found, support_px=np.array([8], np.int32), ke_per_m=ke_per_m))
    assert (chain.ahead() < 600) is confirmed


def test_a_part_of_a_wide_plane_confirms_it() -> None:
    """A bar of 1.2 m, of which the frame before showed the left end alone."""
    chain = seeing()
    for y_m in (-0.6, 0.6):
        found = model((3.0, -0.7, 3.0, y_m, -0.1, 0.1), free_to_m=13.0, view_deg=72.0)
        one_frame(chain, replace(found, support_px=np.array([8], np.int32)))
    assert chain.ahead() == pytest.approx(270, abs=3)


@pytest.mark.parametrize("distance_m", [1.5, 3.0, 5.5])
def test_the_second_frame_sends_it(distance_m: float) -> None:
    chain = seeing()
    one_frame(chain, pole(distance_m, 3))
    assert chain.ahead() == CLEAR_CM
    one_frame(chain, pole(distance_m + 0.1, 3))
    assert chain.ahead() == pytest.approx(100 * (distance_m - 0.2), abs=3)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_one_of_less_than_10_cm2_needs_a_second_frame_whatever_its_pixels(autopilot: object) -> None:
    """Two mismatches that join have more pixels than confirm_px. They lie just before the camera, where that is little."""
    chain = seeing()
    one_frame(chain, pole(0.4, 12))
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, pole(0.4, 12))
    assert chain.ahead(autopilot) < 50
    chain = seeing()
    one_frame(chain, pole(0.4, 13))  # 10.3 cm2
    assert chain.ahead(autopilot) < 50


def test_a_tiny_one_needs_a_third_frame() -> None:
    """Less than 1 cm2 just before the camera: mismatches at one place in two frames are frequent there."""
    chain = seeing()
    for _ in range(2):
        one_frame(chain, pole(0.4, 1))
        assert chain.ahead() == CLEAR_CM
    one_frame(chain, pole(0.4, 1))
    assert chain.ahead() < 50


@pytest.mark.parametrize("apart_m", [0.25, 0.28])
def test_close_to_the_vehicle_two_places_are_distinguished(apart_m: float) -> None:
    chain = seeing()
    for n in range(6):
        one_frame(chain, pole(0.6 + apart_m * (n % 2), 3) if n < 2 else CLEAR)
        assert chain.ahead() == CLEAR_CM


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
    values = chain.report().values
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


def test_a_thin_pole_that_is_approached_without_a_position_is_sent_from_the_second_frame_on() -> None:
    chain = Chain(CLEAR)
    for _ in range(10):
        one_frame(chain, CLEAR)
    for n in range(3):
        distance_m = 6.0 - 1.2 * n  # 12 m/s at 10 Hz
        one_frame(chain, pole(distance_m, 3))
        expected = CLEAR_CM if n == 0 else pytest.approx(100 * (distance_m - 0.3), abs=2)
        assert chain.ahead() == expected


def test_a_hover_before_a_bare_wall_sends_nothing_near() -> None:
    """The typical camera of 320x240 pixels. Without confirmation the memory makes half of all messages of 2 % of the frames."""
    assert hover(40, 0).near > 6
    assert hover(40, 8, "PX4").near == 0
    assert hover(40, 8).near <= 1, "sectors that were not kept: the end of the free space, or the wall"

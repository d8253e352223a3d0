"""PX4 beside a pole that stands outside of the view, or at its edge: the hull must fit into what was seen. And beside a blank pole."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.autopilot.edge_px4 import AVOID, CAMERA, LOOKS, Blank, Case, empty_model, flown
from companion.autopilot.camera_coverage import EDGE_MARGIN_M, MOVES_DEG, looked_into, too_near_the_edge
from core.types import CameraInfo, CameraMount, Intrinsics

from ..small_recordings import easy_model

Floats = NDArray[np.float64]
EMPTY = empty_model(easy_model(1.0, 0.0))
CASES = [
    Case((1, 15), 0.0, False, 37.0, 39.5, 3.0),  # the index of a bin is the one below
    Case((1, 16), 0.0, False, 36.0, 43.5, 3.0),
    Case((1, 16), 30.0, False, 33.0, 40.5, 2.0),
    Case((1, 16), 30.0, False, -38.0, -40.5, 2.0),  # guided to the last clear sector
    Case((1, 16), 30.0, True, 32.0, 42.5, 2.0),
]


@pytest.mark.parametrize("case", CASES)
def test_no_pole_beside_the_view_is_hit(case: Case) -> None:
    assert flown(case, EMPTY).clearance_m > 0.4


@pytest.mark.parametrize("case", CASES[2:])
def test_without_the_rule_of_the_edge_it_comes_nearer(case: Case) -> None:
    """The first two do not move without it either: the next sector clockwise is unseen."""
    assert flown(case, EMPTY, trims=False).clearance_m < 0.3


@pytest.mark.parametrize("version", [(1, 15), (1, 16)])
def test_it_flies_ahead_where_the_hull_fits(version: tuple[int, int]) -> None:
    assert flown(Case(version, 0.0, False, 0.0, 90.0, 8.0), EMPTY).flown_m > 10.0


def test_two_cameras_have_no_edge_between_them() -> None:
    right = looked_into(replace(CAMERA, mount=CameraMount(yaw_rad=math.radians(60.0))), AVOID)
    one, both = too_near_the_edge([LOOKS], AVOID), too_near_the_edge([LOOKS, right], AVOID)
    assert np.flatnonzero(~one).tolist() == [0, 1, 2, 3, 4, 68, 69, 70, 71]
    assert np.flatnonzero(~both).tolist() == [*range(17), 68, 69, 70, 71]
    assert too_near_the_edge([], AVOID).all()
    wide = replace(AVOID, radius_m=3.0)  # wider than near_m: only a camera all around would do
    assert too_near_the_edge([LOOKS], wide).all()


def mounted(x_m: float, y_m: float, yaw_deg: float, view_deg: float) -> CameraInfo:
    f_px = 320.0 / math.tan(math.radians(0.5 * view_deg))
    mount = CameraMount(x_m=x_m, y_m=y_m, yaw_rad=math.radians(yaw_deg))
    return CameraInfo(f"yaw{yaw_deg:.0f}", Intrinsics(640, 480, f_px, f_px, 319.5, 239.5), mount)


def seen(info: CameraInfo, x_m: Floats, y_m: Floats) -> NDArray[np.bool_]:
    """Places in level within the horizontal view of a camera."""
    azimuth = np.arctan2(y_m - info.mount.y_m, x_m - info.mount.x_m) - info.mount.yaw_rad
    half = math.atan(0.5 * info.intrinsics.width / info.intrinsics.fx)
    return np.asarray(np.abs(np.remainder(azimuth + math.pi, math.tau) - math.pi) <= half + 1e-9)


@pytest.mark.parametrize(
    ("cameras", "least"),
    [
        ([mounted(0.0, 0.0, 0.0, 75.0)], 9),
        ([mounted(0.1, 0.0, 0.0, 75.0)], 8),
        ([mounted(0.3, 0.0, 0.0, 75.0)], 7),
        ([mounted(0.0, 0.3, 0.0, 75.0)], 8),
        ([mounted(0.0, 0.0, 0.0, 90.0), mounted(0.0, 0.0, 90.0, 90.0)], 30),
        ([mounted(0.2, 0.0, 0.0, 90.0), mounted(0.0, 0.2, 90.0, 90.0)], 22),
        ([mounted(0.2, 0.0, 0.0, 100.0), mounted(0.0, 0.2, 90.0, 100.0)], 30),
    ],
)
def test_the_hull_passes_within_the_views_of_cameras_beside_the_middle(cameras: list[CameraInfo], least: int) -> None:
    """Between two views that touch, of cameras 0.2 m before the middle, lay a strip 0.28 m wide that no camera sees, and
    sectors by which the hull passed through it 3.7 m away were sent as clear."""
    edge = too_near_the_edge([looked_into(camera, AVOID) for camera in cameras], AVOID)
    assert (~edge).sum() >= least
    half_m = AVOID.radius_m + EDGE_MARGIN_M
    along, side = np.meshgrid(np.linspace(0.0, AVOID.max_distance_m, 121), np.linspace(-half_m, half_m, 21))
    for middle_deg in 5.0 * np.flatnonzero(~edge):
        for course in np.radians(middle_deg + np.linspace(*MOVES_DEG, 7)):
            x, y = (
                along * math.cos(course) - side * math.sin(course),
                along * math.sin(course) + side * math.cos(course),
            )
            needed = np.hypot(x, y) >= AVOID.near_m
            assert (np.logical_or.reduce([seen(camera, x, y) for camera in cameras]) | ~needed).all(), middle_deg


@pytest.mark.parametrize(
    ("version", "guide_deg", "stick_deg", "bearing_deg", "range_m"),
    [
        ((1, 15), 0.0, -2.0, 2.5, 9.0),
        ((1, 15), 0.0, 6.5, 12.0, 6.0),
        ((1, 15), 30.0, 7.0, 13.5, 6.0),
        ((1, 16), 0.0, -2.7, 0.3, 6.0),
        ((1, 16), 0.0, 7.2, 14.3, 6.0),
        ((1, 16), 30.0, 10.7, 34.0, 6.0),
    ],
)
def test_a_blank_pole_beside_the_course_is_braked_for(
    version: tuple[int, int], guide_deg: float, stick_deg: float, bearing_deg: float, range_m: float
) -> None:
    """Its sides are measured, and nothing is free in its directions: they are unseen, and PX4 brakes for no unknown sector."""
    case = Case(version, guide_deg, False, stick_deg, bearing_deg, range_m, blank=Blank(0.25), cp_dist_m=3.0)
    assert flown(case, EMPTY).clearance_m > 3.0 - 0.3


@pytest.mark.parametrize(
    ("version", "stick_deg", "bearing_deg"), [((1, 15), -0.7, 3.1), ((1, 15), 9.0, 9.6), ((1, 16), 9.5, 9.8)]
)
def test_px4_does_not_fly_to_a_pole_of_which_nothing_is_measured(
    version: tuple[int, int], stick_deg: float, bearing_deg: float
) -> None:
    """PX4 takes the bin below the stick's direction, so a bin reaches into the sector behind its own."""
    case = Case(version, 0.0, False, stick_deg, bearing_deg, 9.0, blank=Blank(0.25, sides=False), cp_dist_m=3.0)
    assert flown(case, EMPTY).clearance_m > 3.0

"""Which sectors the cameras cover."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.camera_coverage import covered, looked_into
from companion.autopilot.polar_histogram import scan
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from core.types import CameraInfo, CameraMount, Intrinsics

from ..sector_models import AVOID, HERE, model, wall_at


def camera(mount: CameraMount, cx: float = 31.5) -> CameraInfo:
    """71 degrees wide and 56 high."""
    return CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, cx, 23.5), mount)


def sectors_of(info: CameraInfo, avoid: AvoidParams = AVOID) -> tuple[list[int], list[int]]:
    """Numbers from -36 to 35 of the sectors that it looks into in part, and wholly."""
    part, whole = covered([looked_into(info, avoid)])
    return tuple(sorted((int(i) + 36) % 72 - 36 for i in np.flatnonzero(found)) for found in (part, whole))


def test_coverage_of_a_camera_takes_in_sectors_it_looks_into_in_part() -> None:
    assert sectors_of(camera(CameraMount())) == (list(range(-7, 8)), list(range(-6, 7)))
    assert sectors_of(camera(CameraMount(yaw_rad=math.pi / 2)))[0] == list(range(11, 26))
    part, whole = covered([])
    assert not part.any()
    assert not whole.any()


def test_two_cameras_side_by_side_cover_the_sector_between_them_wholly() -> None:
    both = [looked_into(camera(CameraMount(yaw_rad=math.radians(a))), AVOID) for a in (-35.0, 35.0)]
    assert covered(both)[1][0]
    assert not covered(both[:1])[1][0]


def test_coverage_of_a_camera_on_its_side_of_one_that_looks_down_and_of_one_that_looks_aside() -> None:
    upright = sectors_of(camera(CameraMount(roll_rad=math.pi / 2)))[0]
    assert upright == list(range(-6, 7))  # its height lies across
    down = camera(CameraMount(pitch_rad=math.radians(-40.0)))
    assert sectors_of(down)[0] == list(range(-7, 8))  # the upper edge of its image
    # near below the horizon an image takes in more of the compass
    assert sectors_of(down, replace(AVOID, near_m=1.0))[0] == list(range(-9, 10))
    aside = sectors_of(camera(CameraMount(), cx=47.5))[0]
    assert min(aside) == -9
    assert max(aside) == 4
    straight_down = sectors_of(camera(CameraMount(pitch_rad=math.radians(-90.0))))[0]
    assert straight_down == list(range(-36, 36))  # who knows


def test_the_nearest_point_of_a_sector_has_its_own_direction() -> None:
    found = scan([View(model(wall_at(7.0, 3.0, 0.02)), HERE)], AVOID)
    assert math.degrees(found.azimuth_rad[1]) == pytest.approx(7.0, abs=0.25)
    assert found.azimuth_rad[20] == pytest.approx(math.radians(100.0))

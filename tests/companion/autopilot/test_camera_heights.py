"""Cameras that look into one direction at different heights: what one of them covers does not replace the other one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.camera_coverage import covered, covered_sectors, looked_into, too_near_the_edge
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from core.types import CameraInfo, CameraMount, Intrinsics
from tests.nightly import nightly

from .test_obstacle_sender import AVOID, CAMERA, CLEAR, WALL, Chain
from .test_sectors import model

PX4 = AutopilotNow(kind="PX4", cp_dist_m=3.0)
ARDUPILOT = AutopilotNow(kind="ArduPilot", margin_m=3.0)
UNSEEN = model(free_to_m=0.0, view_deg=72.0)


def pitched(camera: str, pitch_deg: float, yaw_deg: float = 0.0) -> CameraInfo:
    mount = CameraMount(pitch_rad=math.radians(pitch_deg), yaw_rad=math.radians(yaw_deg))
    return replace(CAMERA, camera=camera, mount=mount)


def beside_a_blind(other: CameraInfo, seeing: CameraInfo) -> Chain:
    """The camera "front" sees no sector wholly, and the other one does not work."""
    chain = Chain(UNSEEN, replace(AVOID, unseen="unknown"))
    chain.builder = ObstacleReportBuilder(
        replace(AVOID, unseen="unknown"), CameraUse(cameras=("front", other.camera), timeout_s=0.3)
    )
    chain.builder.announce(seeing)
    chain.builder.announce(other)
    chain.fly(1.0)
    return chain


@pytest.mark.parametrize(
    ("seeing_deg", "blind_deg"),
    [(25.0, -25.0), (-25.0, 25.0), (-45.0, 0.0), (55.0, 0.0), *nightly((45.0, 0.0), (-58.0, 0.0))],
)
def test_a_camera_that_covers_other_heights_does_not_replace_a_blind_one(seeing_deg: float, blind_deg: float) -> None:
    """PX4 v1.16 coasted without the wall: 13.5 m from 5 m/s."""
    chain = beside_a_blind(pitched("other", blind_deg), pitched("front", seeing_deg))
    assert (chain.report(PX4).values == 302).all()
    assert chain.ahead(ARDUPILOT) == WALL


@pytest.mark.parametrize(
    ("seeing_deg", "blind_deg"), [(0.0, -45.0), (0.0, 5.0), (5.0, 0.0), *nightly((0.0, 45.0), (0.0, 55.0))]
)
def test_a_camera_that_covers_the_heights_of_a_blind_one_replaces_it(seeing_deg: float, blind_deg: float) -> None:
    chain = beside_a_blind(pitched("other", blind_deg), pitched("front", seeing_deg))
    values = chain.report(ARDUPILOT).values
    assert values is not None
    ahead = values[[*range(6), *range(67, 72)]]
    assert sorted(ahead) == [1199] + 10 * [UNKNOWN]  # the farthest distance, in an empty face between two walls


def test_a_level_camera_that_sees_keeps_its_clear_sectors_beside_a_blind_one_that_looks_up() -> None:
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", "up"), timeout_s=0.3))
    chain.builder.announce(CAMERA)
    chain.builder.announce(pitched("up", 45.0))
    chain.fly(1.0)
    assert chain.ahead(ARDUPILOT) == 1201


@pytest.mark.parametrize("pitch_deg", [40.0, -40.0, 55.0, 80.0, -90.0])
def test_a_camera_that_covers_little_of_the_band_does_not_move_the_edge_of_the_view(pitch_deg: float) -> None:
    """The hull passed through directions of which a tenth of the height was in view."""
    level = looked_into(CAMERA, AVOID)
    beside = looked_into(pitched("other", pitch_deg, yaw_deg=20.0), AVOID)
    in_view, _ = covered([level])  # elsewhere nothing can be clear
    assert (too_near_the_edge([level, beside], AVOID) >= too_near_the_edge([level], AVOID))[in_view].all()


def test_a_second_level_camera_moves_the_edge_of_the_view() -> None:
    level, beside = looked_into(CAMERA, AVOID), looked_into(pitched("other", 3.0, yaw_deg=20.0), AVOID)
    assert np.count_nonzero(~too_near_the_edge([level, beside], AVOID)) > np.count_nonzero(
        ~too_near_the_edge([level], AVOID)
    )


@pytest.mark.parametrize("z_m", [-0.5, -0.2, 0.0, 0.3])
def test_a_camera_above_or_below_the_autopilot_covers_heights_as_far_above_or_below(z_m: float) -> None:
    avoid = replace(AVOID, near_m=1.6, slices=20, band_above_m=1.0, band_below_m=1.0)
    covers = looked_into(replace(CAMERA, mount=CameraMount(z_m=z_m)), avoid).heights[0, 2]
    half_m = avoid.near_m * 0.5 * CAMERA.intrinsics.height / CAMERA.intrinsics.fy
    edges_m = np.linspace(-1.0, 1.0, avoid.slices + 1)
    inside = (edges_m[1:] > z_m - half_m) & (edges_m[:-1] < z_m + half_m)
    assert covers.tolist() == inside.tolist()


def test_a_camera_on_a_mast_does_not_replace_a_blind_one_at_the_height_of_the_autopilot() -> None:
    avoid = replace(AVOID, near_m=1.5)
    level, mast = (looked_into(replace(CAMERA, mount=CameraMount(z_m=z)), avoid) for z in (0.0, -2.0))
    assert covered_sectors([level], [mast], avoid).heights_lost[0]
    assert not covered_sectors([mast], [level], avoid).heights_lost[0]


@pytest.mark.parametrize("roll_deg", [0.0, 90.0])
def test_heights_lower_than_the_distance_of_two_rays_are_covered(roll_deg: float) -> None:
    """A wide camera had 8 of 22 sectors inside of the edge, and did not replace a camera with a slightly other mount."""
    avoid = replace(AVOID, near_m=5.0, slices=20, band_above_m=0.3, band_below_m=0.3)
    wide = replace(CAMERA, intrinsics=Intrinsics(width=640, height=400, fx=160.0, fy=160.0, cx=319.5, cy=199.5))
    mounts = [CameraMount(roll_rad=math.radians(roll_deg), pitch_rad=math.radians(p)) for p in (0.0, 1.3)]
    one, other = (looked_into(replace(wide, mount=mount), avoid) for mount in mounts)
    middle = [0, *range(-5, 0), *range(1, 6)]
    assert not too_near_the_edge([one], avoid)[middle].any()
    assert not covered_sectors([one], [other], avoid).heights_lost[middle].any()


def test_a_camera_that_is_opened_covers_what_it_looks_into_from_then_on() -> None:
    chain = Chain(CLEAR)
    chain.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=("front", "up"), timeout_s=0.3))
    chain.builder.announce(CAMERA)
    chain.fly(1.0)
    never_opened = chain.report(ARDUPILOT).values
    chain.builder.announce(pitched("up", 10.0))
    chain.fly(0.1)
    opened = chain.report(ARDUPILOT).values
    assert never_opened is not None
    assert opened is not None
    assert (never_opened[[20, 36]] == WALL).all()
    assert (opened[[20, 36]] == UNKNOWN).all()

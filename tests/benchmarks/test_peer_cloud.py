"""What the peers are given: the pixels that our own method would take, as points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.peers.cloud import cloud_of, ground_in_level_cam
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import PERFECT, SensorModel
from drivers.simulation.source import Rendered, camera_info, render

KE = 0.0015
INFO = camera_info(160, 120, ke_per_m=KE)


def wall(
    x: float = 8.0,
    slope: float = 0.0,
    *,
    at_x: float = 0.0,
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0),
    sensor: SensorModel = PERFECT,
) -> Rendered:
    """A wall right across the view; the camera 2 m above the ground at the origin; angles: roll, pitch, yaw."""
    b = SceneBuilder("test")
    b.ground(slope, 0.0)
    b.wall("wall", (x, -30.0), (x, 30.0), 30.0, base=-5.0)
    roll, pitch, yaw = angles
    at = (at_x, 0.0, -2.0)
    return render(b.build(), INFO, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw, position_ned_m=at, sensor=sensor)


def test_points_of_a_wall_lie_on_it_at_any_attitude() -> None:
    for roll, pitch in ((0.0, 0.0), (0.4, -0.3)):
        cloud = cloud_of(wall(angles=(roll, pitch, 0.0)), KE)
        assert len(cloud.points_m) > 3000
        assert cloud.ground_z_m == pytest.approx(2.0)
        assert cloud.focal_px == INFO.intrinsics.fx
        np.testing.assert_allclose(cloud.points_m[:, 0], 8.0, atol=0.01)
        assert cloud.points_m[:, 2].max() == pytest.approx(1.75, abs=0.06)


def test_a_heading_turns_the_ground_with_it() -> None:
    frame = wall(slope=0.05, angles=(0.0, 0.0, np.pi / 2))  # looking east, the ground falls to the north, on the left
    np.testing.assert_allclose(ground_in_level_cam(frame), [2.0, 0.0, -0.05], atol=1e-9)
    ahead = wall(slope=0.05, at_x=4.0)
    np.testing.assert_allclose(ground_in_level_cam(ahead), [2.2, 0.05, 0.0], atol=1e-9)


def test_what_only_shows_by_the_near_tail_of_its_noise_is_left_out() -> None:
    # 20 m / (1 + 3 ke 20 m) = 18.35 m
    assert len(cloud_of(wall(18.0), KE).points_m) > 3000
    assert len(cloud_of(wall(19.0), KE).points_m) == 0


def test_flying_pixels_specks_and_saturated_pixels_are_left_out_and_a_pole_is_kept() -> None:
    frame = wall(sensor=SensorModel(saturated_share=0.01))
    depth = frame.depth_mm.copy()
    depth[depth == 65535] = 0
    depth[20:22, 40:42] = 4000  # a mismatch
    depth[10:60, 100] = 5000  # a pole
    depth[30, 60:62] = 3000, 5000  # an edge of something near, one pixel of it between near and far
    points = cloud_of(replace(frame, depth_mm=depth), KE).points_m
    assert (np.abs(points[:, 0] - 5.0) < 0.01).sum() == 50
    assert set(np.round(points[:, 0])) == {5.0, 8.0}
    with_saturated = cloud_of(replace(frame, depth_mm=np.where(depth == 0, 65535, depth).astype(np.uint16)), KE)
    np.testing.assert_array_equal(with_saturated.points_m, points)


def test_near_specks_must_be_larger() -> None:
    # 2 cm at 1 m and 112.5 px of focal length: 2.2 px, hence 7; at 0.3 m: 7.5 px
    frame = wall()
    for z_mm, side, kept in (
        (1000, (2, 4), 8),
        (1000, (2, 3), 0),
        (290, (2, 4), 0),
        (310, (3, 3), 9),
        (310, (1, 7), 0),
    ):
        depth = frame.depth_mm.copy()
        depth[20 : 20 + side[0], 40 : 40 + side[1]] = z_mm
        points = cloud_of(replace(frame, depth_mm=depth), KE).points_m
        assert (points[:, 0] < 2.0).sum() == kept, (z_mm, side)

"""The rotation between two depth images, against rendered views whose rotation is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.self_check.depth_registration import depth_pyramid, motion_between, rotation_vector
from core.types import UNKNOWN_MM
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info, render

INFO = camera_info(320, 240)


def test_a_cell_is_the_mean_of_the_inverse_depth_of_its_measured_pixels() -> None:
    rng = np.random.default_rng(3)
    depth = rng.integers(200, 25_000, (240, 320)).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.3] = UNKNOWN_MM
    pyramid = depth_pyramid(depth, INFO)
    assert pyramid.fine.cells.shape == (60, 80)
    assert pyramid.half.cells.shape == (30, 40)
    for r, c in ((0, 0), (31, 17), (59, 79)):
        z = depth[4 * r : 4 * r + 4 : 2, 4 * c : 4 * c + 4 : 2].astype(float) / 1000.0
        z = z[(z >= INFO.min_range_m) & (z <= INFO.max_range_m)]
        assert (
            (pyramid.fine.cells[r, c] == pytest.approx(np.mean(1.0 / z)))
            if len(z) > 2
            else np.isnan(pyramid.fine.cells[r, c])
        )


@pytest.mark.parametrize(
    ("turn_rad", "moved_m"),
    [
        ((0.0, 0.0, 0.03), (0.0, 0.0, 0.0)),
        ((0.02, -0.02, 0.02), (0.0, 0.0, 0.0)),
        ((0.01, 0.02, -0.04), (0.2, 0.1, 0.0)),
    ],
)
def test_a_turn_is_measured_whether_the_camera_moves_or_not(
    turn_rad: tuple[float, float, float], moved_m: tuple[float, float, float]
) -> None:
    # independent pixels: the error of one pair in correlated noise is larger, and averages out over many pairs
    white = replace(TYPICAL, noise_length_px=0.0)
    first = render("street", INFO, position_ned_m=(0.0, 0.0, -2.0), sensor=white, seed=1)
    x, y, z = moved_m
    second = render(
        "street",
        INFO,
        roll_rad=turn_rad[0],
        pitch_rad=turn_rad[1],
        yaw_rad=turn_rad[2],
        position_ned_m=(x, y, z - 2.0),
        sensor=white,
        seed=1,
        frame=1,
    )
    guess = (rotation_from_euler(*(0.8 * a for a in turn_rad)) @ R_CAMFRD_OPTICAL).T @ R_CAMFRD_OPTICAL
    found = motion_between(depth_pyramid(first.depth_mm, INFO), depth_pyramid(second.depth_mm, INFO), guess)
    assert found is not None
    truth = rotation_vector(second.R_ned_optical.T @ first.R_ned_optical)
    np.testing.assert_allclose(found.rotation_rad, truth, atol=0.003)


def test_a_translation_is_not_taken_for_a_turn() -> None:
    first = render("street", INFO, position_ned_m=(0.0, 0.0, -2.0), sensor=TYPICAL, seed=1)
    second = render("street", INFO, position_ned_m=(0.2, 0.15, -2.0), sensor=TYPICAL, seed=1, frame=1)
    found = motion_between(depth_pyramid(first.depth_mm, INFO), depth_pyramid(second.depth_mm, INFO), np.eye(3))
    assert found is not None
    assert float(np.abs(found.rotation_rad).max()) < 0.004


def test_images_without_measurements_give_no_rotation() -> None:
    pyramid = depth_pyramid(np.full((240, 320), UNKNOWN_MM, np.uint16), INFO)
    assert motion_between(pyramid, pyramid, np.eye(3)) is None


def test_the_heading_over_bare_ground_is_not_determined() -> None:
    k = INFO.intrinsics
    y = (np.arange(240)[:, None] - k.cy) / k.fy
    with np.errstate(divide="ignore"):
        z = 2.0 / (math.sin(0.6) + math.cos(0.6) * y)  # ground 2 m below, camera pitched 0.6 rad down
    depth = np.where((z > 0.3) & (z < 20.0), 1000.0 * z, UNKNOWN_MM).astype(np.uint16) * np.ones((1, 320), np.uint16)
    pyramid = depth_pyramid(depth, INFO)
    found = motion_between(pyramid, pyramid, np.eye(3))
    assert found is not None
    sigma = found.rotation_sd_rad
    assert sigma[1] > 10.0 * sigma[0]

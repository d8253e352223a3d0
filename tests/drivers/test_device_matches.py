"""Depth matched by a device, tested with its rectified images: what the images do not confirm is not measured."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from core.params import Params
from core.types import UNKNOWN_MM
from drivers.cameras.device_matches import confirmed_depth, device_limits, disparity_of, needs_images
from drivers.cameras.stereo import MatchParams, StereoMatcher, confidence_limits

HEIGHT, WIDTH, SHIFT = 80, 240, 12
F_PX, BASELINE_M = 400.0, 0.075
F_B_PX_M = F_PX * BASELINE_M
WALL_MM = round(1000.0 * F_B_PX_M / SHIFT)
OFF = MatchParams(correlation=0.0, texture=0.0, period=1.0)


def scene(sky_rows: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A textured wall at WALL_MM in both images, under a sky of sky_rows; noise of one grey level."""
    rng = np.random.Generator(np.random.PCG64(1))
    wall = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH + SHIFT)), (0, 0), 1.2)
    wall = 120.0 + 30.0 * wall / wall.std()
    wall[:sky_rows] = 200.0 + 0.3 * (np.arange(sky_rows)[:, None] - sky_rows)
    views = (wall[:, :WIDTH], wall[:, SHIFT : SHIFT + WIDTH])
    left, right = (np.clip(np.rint(v + rng.standard_normal(v.shape)), 0, 255).astype(np.uint8) for v in views)
    return left, right


def device_depth(value_mm: int = WALL_MM) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), value_mm, np.uint16)


def test_right_matches_keep_the_depth_of_the_device() -> None:
    tested = confirmed_depth(device_depth(), scene(), F_B_PX_M, MatchParams())
    inner = tested[8:-8, 24:-8]
    assert np.mean(inner == WALL_MM) > 0.97
    assert set(np.unique(tested)) <= {UNKNOWN_MM, WALL_MM}


def test_the_limits_for_refined_matches_do_not_hold_for_a_device() -> None:
    host, device = confidence_limits(MatchParams()), device_limits(MatchParams())
    assert device.far_correlation == host.strong_correlation < host.far_correlation
    assert device.level_correlation < host.level_correlation


@pytest.mark.parametrize("wrong_mm", [1200, 5000, 20_000])
def test_wrong_matches_of_a_texture_are_not_measured(wrong_mm: int) -> None:
    depth = device_depth()
    depth[20:60, 100:160] = wrong_mm
    tested = confirmed_depth(depth, scene(), F_B_PX_M, MatchParams())
    assert np.mean(tested[20:60, 100:160] == wrong_mm) < 0.005
    assert np.mean(tested[70:76, 100:160] == WALL_MM) > 0.9


def test_chance_depths_of_a_noisy_sky_are_not_measured() -> None:
    rng = np.random.Generator(np.random.PCG64(2))
    depth = device_depth()
    depth[:40] = cv2.resize(rng.integers(1500, 9000, (5, 30)).astype(np.uint16), (WIDTH, 40), interpolation=0)
    tested = confirmed_depth(depth, scene(sky_rows=40), F_B_PX_M, MatchParams())
    assert not tested[:34].any()
    without_rules = confirmed_depth(
        depth,
        scene(sky_rows=40),
        F_B_PX_M,
        replace(OFF, patch_px=0, patch_per_px=0.0, shared=1.0, smear_px=0, smear_rows=0, level_px=0),
    )
    assert np.array_equal(without_rules[:, 24:], depth[:, 24:])  # to the left matches lie outside of the right image


def test_images_of_another_scene_confirm_nothing() -> None:
    """Exchanged, mirrored or foreign images: no depth, and so nothing free."""
    left, right = scene()
    for pair in ((right, left), (left[:, ::-1].copy(), right[:, ::-1].copy()), (left, np.flipud(right).copy())):
        assert np.mean(confirmed_depth(device_depth(), pair, F_B_PX_M, MatchParams()) > 0) < 0.01


def test_no_depth_is_changed_or_added() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    depth = rng.integers(0, 65536, (HEIGHT, WIDTH)).astype(np.uint16)
    depth[::3] = 0
    tested = confirmed_depth(depth, scene(), F_B_PX_M, OFF)
    assert ((tested == depth) | (tested == UNKNOWN_MM)).all()


def test_the_disparity_is_that_of_the_depth_inside_of_the_right_image() -> None:
    depth = np.zeros((1, 400), np.uint16)
    depth[0, [0, 5, 6, 74, 75, 100, 399]] = 65_535, 5000, 5000, 400, 400, 30_000, 1
    found = disparity_of(depth, F_B_PX_M)
    assert found[0, [6, 75, 100]] == pytest.approx([6.0, 75.0, 1.0], rel=1e-5)
    found[0, [6, 75, 100]] = -1.0
    assert (found == -1.0).all()


def test_the_images_are_needed_by_each_rule() -> None:
    assert not needs_images(OFF)
    for change in ({"correlation": 0.7}, {"texture": 3.0}, {"period": 0.9}):
        assert needs_images(replace(OFF, **change))
    assert needs_images(MatchParams())


def test_exchanged_images_are_not_measured() -> None:
    """Cables of left and right that are exchanged: neither the device's depth is confirmed nor does the host find a match, also where
    there are too few corners to name the cause. Chance matches are too few for a valid frame."""
    left, right = scene()
    assert not confirmed_depth(device_depth(), (right, left), F_B_PX_M, MatchParams()).any()
    matched = StereoMatcher(MatchParams(disparities=32)).depth(right, left, F_PX, BASELINE_M)
    assert np.mean(matched != UNKNOWN_MM) < 0.5 * Params().min_measured_share

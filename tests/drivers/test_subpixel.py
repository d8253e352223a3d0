"""Fractions of a pixel of far matches: moved towards the true disparity, never far, and not where there is none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.cameras.stereo import MatchParams, StereoMatcher
from drivers.cameras.subpixel import refined

WIDTH, HEIGHT, D = 320, 96, 32
FINE = 16
"""Samples of a drawn pixel along the row."""
INNER = np.s_[8:-8, D + 8 : -8]


def pair(disparity_px: float, noise_grey: float = 1.0, brighter_grey: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Both images of a wall with fine texture at a disparity that is a multiple of 1 / FINE."""
    rng = np.random.Generator(np.random.PCG64(7))
    drawn = cv2.GaussianBlur(rng.standard_normal((HEIGHT, (WIDTH + D) * FINE)), (0, 0), sigmaX=0.9 * FINE, sigmaY=0.9)
    drawn = 120.0 + 20.0 * drawn / drawn.std()
    images = []
    for first, brighter in ((0, 0.0), (round(disparity_px * FINE), brighter_grey)):
        seen = drawn[:, first : first + WIDTH * FINE].reshape(HEIGHT, WIDTH, FINE).mean(axis=2)
        noise = noise_grey * rng.standard_normal(seen.shape)
        images.append(np.clip(np.rint(seen + brighter + noise), 0, 255).astype(np.uint8))
    return images[0], images[1]


@pytest.mark.parametrize("disparity_px", [1.25, 1.6875, 3.375])
@pytest.mark.parametrize("brighter_grey", [0.0, 30.0])
def test_whole_pixels_are_moved_to_the_fraction(disparity_px: float, brighter_grey: float) -> None:
    left, right = pair(disparity_px, brighter_grey=brighter_grey)
    whole = np.full(left.shape, np.rint(disparity_px), np.float32)
    found = refined(left, right, whole)[INNER]
    assert abs(np.median(found) - disparity_px) < 0.05
    assert np.percentile(np.abs(found - disparity_px), 90) < 0.12


@pytest.mark.parametrize("disparity_px", [1.25, 1.6875, 3.375])
def test_the_matcher_does_not_prefer_whole_pixels(disparity_px: float) -> None:
    left, right = pair(disparity_px)
    found = StereoMatcher(MatchParams(disparities=D, edge_px=0)).disparity(left, right)[INNER]
    error = found[found >= 0.0] - disparity_px
    assert np.mean(found >= 0.0) > 0.95
    assert abs(np.median(error)) < 0.05
    assert np.percentile(np.abs(error), 90) < 0.1


def test_a_match_is_moved_by_half_a_pixel_at_most_and_not_behind_infinity() -> None:
    left, right = pair(3.0)
    start = np.full(left.shape, 1.5, np.float32)
    found = refined(left, right, start)
    assert np.abs(found - start).max() <= 0.5
    left, right = pair(0.0)
    assert refined(left, right, np.zeros(left.shape, np.float32)).min() == 0.0


def test_a_near_match_stays_where_it_is() -> None:
    left, right = pair(20.75)
    disparity = np.full(left.shape, 21.0, np.float32)
    np.testing.assert_array_equal(refined(left, right, disparity), disparity)


def test_nothing_is_found_where_the_matcher_has_no_match() -> None:
    left, right = pair(3.375)
    disparity = np.full(left.shape, 3.0, np.float32)
    disparity[:, 100:200] = -1.0
    found = refined(left, right, disparity)
    np.testing.assert_array_equal(found < 0.0, disparity < 0.0)
    assert set(found[:, 100:200].ravel()) == {-1.0}


def test_a_surface_without_texture_stays_where_it_is() -> None:
    blank = np.full((HEIGHT, WIDTH), 150, np.uint8)
    disparity = np.full(blank.shape, 3.0, np.float32)
    np.testing.assert_array_equal(refined(blank, blank, disparity), disparity)

"""Census matching as cameras do it on the device: known shifts, blank areas, subpixel steps, one-sided views."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.open_air.census_matching import CensusParams, census_disparity

WIDTH, HEIGHT = 120, 64
PARAMS = CensusParams(disparities=32)


def textured(seed: int, width: int = WIDTH + 40) -> np.ndarray:
    rng = np.random.Generator(np.random.PCG64(seed))
    image = cv2.GaussianBlur(rng.standard_normal((HEIGHT, width)), (0, 0), 1.2)
    return 120.0 + 30.0 * image / image.std()


def views(image: np.ndarray, shift: float, noise_grey: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Left view and a right one in which everything lies `shift` px to the left."""
    rng = np.random.Generator(np.random.PCG64(9))
    move = np.array([[1.0, 0.0, -shift], [0.0, 1.0, 0.0]])
    right = cv2.warpAffine(image, move, (image.shape[1], HEIGHT), flags=cv2.INTER_CUBIC)
    both = (v[:, :WIDTH] + noise_grey * rng.standard_normal((HEIGHT, WIDTH)) for v in (image, right))
    left, right = (np.clip(np.rint(v), 0, 255).astype(np.uint8) for v in both)
    return left, right


@pytest.mark.parametrize("shift", [3.0, 11.0, 7.5])
@pytest.mark.parametrize("paths", [2, 4])
def test_the_shift_of_a_texture_is_found(shift: float, paths: int) -> None:
    found = census_disparity(*views(textured(1), shift), replace(PARAMS, paths=paths, subpixel_bits=4))
    inner = found[8:-8, 40:-8]
    assert np.mean(inner >= 0.0) > 0.95
    assert np.median(np.abs(inner[inner >= 0.0] - shift)) < 0.3


def test_disparities_come_in_the_device_s_steps() -> None:
    found = census_disparity(*views(textured(2), 6.3), replace(PARAMS, subpixel_bits=3))
    assert np.array_equal(found[found >= 0.0] * 8.0, np.rint(found[found >= 0.0] * 8.0))


def test_a_blank_image_has_no_match_at_a_finite_depth() -> None:
    blank = np.full((HEIGHT, WIDTH), 120, np.uint8)
    assert (census_disparity(blank, blank, PARAMS) <= 0.0).all()


def test_the_threshold_takes_noise_out_of_the_census() -> None:
    """Differences of less than three grey levels are no pattern: of a noisy blank wall hardly anything is matched."""
    rng = np.random.Generator(np.random.PCG64(4))
    left, right = (np.rint(120.0 + 0.6 * rng.standard_normal((HEIGHT, WIDTH))).astype(np.uint8) for _ in range(2))
    loose = np.mean(census_disparity(left, right, replace(PARAMS, least_margin=0.0, most_cost=1.0)) > 0.5)
    strict = np.mean(census_disparity(left, right, replace(PARAMS, threshold_grey=3)) > 0.5)
    assert loose > 0.05
    assert strict < 0.005


def test_what_only_the_left_image_shows_is_not_matched() -> None:
    """A board 20 px in front of a wall hides a band of it from the right camera."""
    wall, board = textured(5), textured(6, 40)
    left, right = wall[:, :WIDTH].copy(), wall[:, 4 : 4 + WIDTH].copy()
    left[:, 70:110], right[:, 50:90] = board, board
    found = census_disparity(left.astype(np.uint8), right.astype(np.uint8), PARAMS)
    assert np.mean(found[8:-8, 56:68] >= 0.0) < 0.4
    assert np.median(found[8:-8, 75:105]) == pytest.approx(20.0, abs=0.3)

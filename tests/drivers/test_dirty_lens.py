"""Dirt, water and covers on one lens of a stereo camera: what they hide is unmeasured, never measured too far."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import CONTINUED_MM, TEXTURELESS_MM
from drivers.cameras.stereo import MatchParams, StereoDepth, StereoMatcher
from tests.nightly import nightly

from .zed_images import CALIBRATION, pair

Float = NDArray[Any]
Y, X = np.mgrid[0:376, 0:672].astype(np.float32)
SPOT = np.clip((60.0 - np.hypot(X - 330.0, Y - 190.0)) / 10.0 + 0.5, 0.0, 1.0)  # a disc with a soft edge


def _seen(image: Float, noise: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(np.round(image + noise.normal(0.0, 1.2, image.shape)), 0, 255).astype(np.uint8)


def _on_spot(image: Float, other: Float) -> Float:
    return image * (1.0 - SPOT) + other * SPOT


def _dirt(image: Float) -> Float:
    return _on_spot(image, np.full_like(image, 25.0))


def _blur(image: Float) -> Float:
    return _on_spot(image, cv2.GaussianBlur(image, (0, 0), 8.0))


def _drop(image: Float) -> Float:
    """A drop shows the scene upside down and smaller."""
    x, y = 330.0 - 3.0 * (X - 330.0), 190.0 - 3.0 * (Y - 190.0)
    return _on_spot(image, cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT))


def _fog(image: Float) -> Float:
    return 0.35 * cv2.GaussianBlur(image, (0, 0), 4.0) + 110.0


def _cover(image: Float) -> Float:
    return np.full_like(image, 12.0)


@pytest.mark.parametrize(("effect", "around"), [(_dirt, 0.6), (_drop, 0.6), (_blur, 0.6), (_fog, 0.0), (_cover, 0.0)])
def test_what_one_dirty_lens_hides_is_not_measured(effect: Callable[[Float], Float], around: float) -> None:
    """around: least share of the image that is measured nevertheless."""
    left, right = (image.astype(np.float32) for image in pair(CALIBRATION, 6.0))
    noise = np.random.Generator(np.random.PCG64(1))
    depth_mm = StereoDepth(CALIBRATION).depth(_seen(left, noise), _seen(effect(right), noise))
    assert np.mean(depth_mm > 0) >= around
    assert np.mean(depth_mm > 1.2 * 6000) < 0.0001
    assert not depth_mm[175:205, 322:352].any()  # the spot lies 7 px farther right in the left image


BRIGHTER_DOWNWARDS: Float = np.linspace(-30.0, 30.0, 376)[:, None]
"""As a sky: what has one brightness at all heights is none."""


def _smooth_share(depth_mm: NDArray[np.uint16]) -> float:
    return float(np.mean((depth_mm == TEXTURELESS_MM) | (depth_mm == CONTINUED_MM)))


def _half(image: Float) -> Float:
    """A finger over the left half of a lens."""
    blurred = 0.2 * cv2.GaussianBlur(image, (0, 0), 40.0) + 102.0
    return np.where(X < 336.0, blurred, image)


@pytest.mark.parametrize("dirty", ["left", "right"])
@pytest.mark.parametrize("effect", [_blur, _drop, _fog, _half, _cover])
def test_what_one_dirty_lens_hides_is_no_sky(effect: Callable[[Float], Float], dirty: str) -> None:
    """[open_sky] presumes surfaces without texture open. Half of a wall before a blurred left lens counted as such by a tenth."""
    left, right = (image.astype(np.float32) + BRIGHTER_DOWNWARDS for image in pair(CALIBRATION, 6.0))
    noise = np.random.Generator(np.random.PCG64(1))
    images = (effect(left), right) if dirty == "left" else (left, effect(right))
    depth_mm = StereoDepth(CALIBRATION, MatchParams(mark_smooth=True)).depth(*(_seen(image, noise) for image in images))
    assert _smooth_share(depth_mm) < 0.005


@pytest.mark.parametrize("dirty", ["left", "right"])
@pytest.mark.parametrize(("grain_px", "contrast_grey"), [(0.7, 6.0), (1.2, 12.0), *nightly((0.7, 12.0), (1.2, 6.0))])
def test_a_fine_texture_before_one_blurred_lens_is_no_sky(grain_px: float, contrast_grey: float, dirty: str) -> None:
    """Its brightness is that of the other image: 31 to 95 % of such a surface counted as without texture before a blurred left
    lens, and up to 16 % before a blurred right one, since it has no match there."""
    rng = np.random.Generator(np.random.PCG64(7))
    grain = cv2.GaussianBlur(rng.standard_normal((376, 692)), (0, 0), grain_px)
    wall = 130.0 + contrast_grey * grain / grain.std() + BRIGHTER_DOWNWARDS
    left, right = wall[:, :672], wall[:, 20:]
    matcher = StereoMatcher(MatchParams(mark_smooth=True))
    blurred = cv2.GaussianBlur(left if dirty == "left" else right, (0, 0), 6.0)
    images = (blurred, right) if dirty == "left" else (left, blurred)
    assert _smooth_share(matcher.depth(*(_seen(image, rng) for image in images), 400.0, 0.1)) < 0.005
    assert np.mean(matcher.depth(_seen(left, rng), _seen(right, rng), 400.0, 0.1) == 2000) > 0.0

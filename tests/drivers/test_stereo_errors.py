"""Errors of depth from errors of disparity."""

from __future__ import annotations

import pytest

from core.types import MOST_BIAS_PER_M, Intrinsics
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient


@pytest.mark.parametrize("scale", [1.0, 2.0, 3.3])
def test_the_bias_of_a_camera_does_not_depend_on_the_size_of_its_image(scale: float) -> None:
    """An error of the calibration is an angle: it grows in pixels as the image does."""
    width, f_px = round(672 * scale), 350.0 * scale
    k = Intrinsics(width, round(376 * scale), f_px, f_px, 0.5 * width, 188.0 * scale)
    assert bias_coefficient(k, 0.12) == pytest.approx(0.15 * 672 / 640 / (350.0 * 0.12), rel=1e-3)


def test_both_coefficients_stay_within_what_a_camera_info_accepts() -> None:
    wide = Intrinsics(640, 480, 100.0, 100.0, 320.0, 240.0)
    assert bias_coefficient(wide, 0.01) == MOST_BIAS_PER_M
    assert noise_coefficient(0.3, 20.0, 0.01) == 0.05
    assert noise_coefficient(1e-9, 2000.0, 1.0) == 1e-4

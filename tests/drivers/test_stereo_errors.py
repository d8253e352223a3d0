"""Errors of depth from errors of disparity."""

from __future__ import annotations

import pytest

from core.types import CameraInfo, Intrinsics
from drivers.cameras.row_check import MAX_VERTICAL_PX
from drivers.cameras.stereo_errors import bias_coefficient, noise_coefficient


@pytest.mark.parametrize("scale", [1.0, 2.0, 3.3])
def test_the_bias_of_a_camera_does_not_depend_on_the_size_of_its_image(scale: float) -> None:
    """An error of the calibration is an angle: it grows in pixels as the image does."""
    width, f_px = round(672 * scale), 350.0 * scale
    k = Intrinsics(width, round(376 * scale), f_px, f_px, 0.5 * width, 188.0 * scale)
    assert bias_coefficient(k, 0.12) == pytest.approx(0.15 * 672 / 640 / (350.0 * 0.12), rel=1e-3)


@pytest.mark.parametrize(("baseline_m", "f_px"), [(0.02, 390.0), (0.063, 350.0), (0.075, 450.0)])
@pytest.mark.parametrize("row_error_px", [0.3, 0.9, MAX_VERTICAL_PX])
def test_the_bias_of_a_short_baseline_is_not_understated(baseline_m: float, f_px: float, row_error_px: float) -> None:
    """Of an OAK-D SR, a ZED Mini and an OAK-D, up to the rows that are a fault. All are accepted by a CameraInfo."""
    k = Intrinsics(640, 400, f_px, f_px, 320.0, 200.0)
    bias_per_m = bias_coefficient(k, baseline_m, row_error_px)
    assert bias_per_m == pytest.approx(1.5 * row_error_px / (f_px * baseline_m))
    assert CameraInfo("front", k, bias_per_m=bias_per_m).bias_per_m == bias_per_m


def test_the_noise_stays_within_what_a_camera_info_accepts() -> None:
    assert noise_coefficient(0.3, 20.0, 0.01) == 0.05
    assert noise_coefficient(1e-9, 2000.0, 1.0) == 1e-4

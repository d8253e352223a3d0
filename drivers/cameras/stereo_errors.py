"""Errors of a stereo camera's depth, from errors of the disparity in pixels.

Z = f B / d, so an error e of the disparity d is an error of e Z^2 / (f B) of the depth."""

from __future__ import annotations

from core.types import Intrinsics

DISPARITY_BIAS_PX, BIAS_WIDTH_PX = 0.15, 640
"""Error of the disparity that all pixels share, in an image of this width: of a factory calibration, and of the matcher. It is an
error of an angle, so in wider images it is as many times more pixels. docs/research/recorded-stereo.md has measurements and the
makers' statements. Nothing in a frame shows it."""
ROW_ERROR_SHARE = 1.5
"""Assumed error of the disparity over the measured error of the rows. No measurement supports the value: both errors are
rotations of the same two cameras, so that they are taken for alike, with a reserve."""
_LEAST_KE, _MOST_KE = 1e-4, 0.05


def noise_coefficient(sigma_px: float, f_px: float, baseline_m: float) -> float:
    """ke_per_m of a CameraInfo for a standard deviation of the disparity."""
    return min(max(sigma_px / (f_px * baseline_m), _LEAST_KE), _MOST_KE)


def assumed_bias_px(width: int, row_error_px: float) -> float:
    """Error of the disparity that all pixels of an image of a width may share: DISPARITY_BIAS_PX, more where the rows of both images
    differ by more than such a calibration explains."""
    return max(DISPARITY_BIAS_PX * width / BIAS_WIDTH_PX, ROW_ERROR_SHARE * row_error_px)


def bias_coefficient(intrinsics: Intrinsics, baseline_m: float, row_error_px: float = 0.0) -> float:
    """bias_per_m of a CameraInfo for the error of `assumed_bias_px`. Without an error of the rows it does not depend on the size of
    the image. It is not limited: a CameraInfo refuses what is more than MOST_BIAS_PER_M."""
    return assumed_bias_px(intrinsics.width, row_error_px) / (intrinsics.fx * baseline_m)

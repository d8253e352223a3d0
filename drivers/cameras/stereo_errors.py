"""Errors of a stereo camera's depth, from errors of the disparity in pixels.

Z = f B / d, so an error e of the disparity d is an error of e Z^2 / (f B) of the depth."""

from __future__ import annotations

from core.types import MOST_BIAS_PER_M

DISPARITY_BIAS_PX = 0.15
"""Error of the disparity that all pixels share, at a width of about 640 px: of a factory calibration, and of the matcher.
docs/research/recorded-stereo.md has measurements and the makers' statements. Nothing in a frame shows it."""
_LEAST_KE, _MOST_KE = 1e-4, 0.05


def noise_coefficient(sigma_px: float, f_px: float, baseline_m: float) -> float:
    """ke_per_m of a CameraInfo for a standard deviation of the disparity."""
    return min(max(sigma_px / (f_px * baseline_m), _LEAST_KE), _MOST_KE)


def bias_coefficient(f_px: float, baseline_m: float) -> float:
    """bias_per_m of a CameraInfo for DISPARITY_BIAS_PX."""
    return min(DISPARITY_BIAS_PX / (f_px * baseline_m), MOST_BIAS_PER_M)

"""Fractions of a pixel of far stereo matches. See docs/explanation/stereo-depth.md.

The semi-global matcher compares costs at whole pixels and fits a parabola, which pulls disparities to whole pixels. Beyond 10 m a
whole pixel is several metres, and fine texture does not agree in both images a third of a pixel beside its place. So each far match is
moved by one step of Gauss and Newton towards the least difference of both images (Lucas and Kanade, 1981). Nearer matches stay: moved,
more of the rim of a blank thing agreed with the texture behind it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .match_confidence import BACKGROUND_PX, Gray, derivatives_at_match

_WINDOW = (7, 7)
"""Window of the step, pixels: that of the test of a match."""
_MOST_PX = 0.5
"""Greatest step: farther away another whole pixel would have been the better match."""
_LEAST_POWER = 1e-6
"""Keeps a window without texture where it is, (grey levels per pixel^2)^2."""
_SLOPE = np.array([[1.0, -8.0, 0.0, 8.0, -1.0]], np.float32) / np.float32(12.0)
"""Derivative of the fourth order: with that of the second order, half of the difference of both neighbours, the slope of fine texture
is too small, and the step a third too large."""


def refined(left: Gray, right: Gray, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """The disparity (H, W) float32 px, negative: none; matches of less than BACKGROUND_PX are moved by at most half a pixel to where both
    images agree best.

    Compared are the derivatives along the row, so that a difference in brightness does not matter. Noise makes the step smaller, never
    larger, since it adds to the slopes by which it is divided. left, right: (H, W) uint8, rectified."""
    g_left, g_right = derivatives_at_match(left, right, disparity)
    matched = disparity >= 0.0
    slope = np.where(matched, cv2.filter2D(np.float32(0.5) * (g_left + g_right), cv2.CV_32F, _SLOPE), np.float32(0.0))
    power = cv2.boxFilter(slope * slope, cv2.CV_32F, _WINDOW)
    step = cv2.boxFilter(slope * (g_right - g_left), cv2.CV_32F, _WINDOW) / np.maximum(power, np.float32(_LEAST_POWER))
    moved = np.maximum(disparity + np.clip(step, -_MOST_PX, _MOST_PX), np.float32(0.0))
    return np.where(matched & (disparity < BACKGROUND_PX), moved, disparity)

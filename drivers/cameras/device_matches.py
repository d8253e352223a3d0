"""Tests depth that a camera has matched itself with its rectified images, by the rules for matches of the host.

The device's own confidence says how clearly a match differs from other matches; noise and repetition can differ clearly. See
docs/explanation/stereo-depth.md."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.types import UNKNOWN_MM

from .match_confidence import ConfidenceLimits, accepted_matches
from .stereo import MatchParams, confidence_limits

Gray = NDArray[np.uint8]

_LEVEL_CORRELATION = 0.6
"""Lower than for matches of the host, whose fraction of a pixel is refined."""


def needs_images(match: MatchParams) -> bool:
    """Whether a rule is on that compares both images. Otherwise the device alone decides."""
    return match.correlation > 0.0 or match.texture > 0.0 or match.period < 1.0


def disparity_of(depth_mm: NDArray[np.uint16], f_b_px_m: float) -> NDArray[np.float32]:
    """(H, W) float32 px, d = f B / Z, -1 without a depth, and where the match would lie outside of the right image.
    depth_mm: (H, W) uint16, 0: none. f_b_px_m: focal length times baseline."""
    f_b_px_mm = np.float32(1000.0 * f_b_px_m)
    disparity = np.full(depth_mm.shape, -1.0, np.float32)
    np.divide(f_b_px_mm, depth_mm, out=disparity, where=depth_mm > 0, casting="same_kind")
    disparity[disparity > np.arange(depth_mm.shape[1], dtype=np.float32)] = -1.0
    return disparity


def device_limits(match: MatchParams) -> ConfidenceLimits:
    """The limits of the confidence rules for matches of a device: those for refined matches are lower."""
    return replace(
        confidence_limits(match), far_correlation=match.strong_correlation, level_correlation=_LEVEL_CORRELATION
    )


def confirmed_depth(
    depth_mm: NDArray[np.uint16], pair: tuple[Gray, Gray], f_b_px_m: float, match: MatchParams
) -> NDArray[np.uint16]:
    """(H, W) uint16 mm: the device's depth where its match is accepted, elsewhere UNKNOWN_MM.

    depth_mm: (H, W) uint16, aligned with the left image, 0: none. pair: rectified left and right image, each (H, W) uint8.
    f_b_px_m: focal length of the rectified images times baseline."""
    accepted = accepted_matches(*pair, disparity_of(depth_mm, f_b_px_m), device_limits(match))
    return np.where(accepted >= 0.0, depth_mm, np.uint16(UNKNOWN_MM))

"""Checks with both rectified images that depth a camera has matched itself is aligned with its left image.

The match of a depth at the column x with disparity d lies in the right image at x - d if the depth is aligned with the left image.
If it is aligned with the right one, its place is x there, and x + d in the left image: every position is then wrong by the baseline,
and surfaces are in front of the wrong parts of what is behind them. Where the disparity does not change along the row both hold.
Beside edges of depth and on surfaces seen at an angle only one does."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import BadData
from .device_matches import disparity_of
from .match_confidence import MatchStatistics, match_statistics
from .stereo import MatchParams

Gray = NDArray[np.uint8]
LEAST_CORRELATION, LEAST_ADVANTAGE = 0.9, 0.4
"""A pixel counts for an alignment where its images have this correlation, and with the other alignment one that is so much less."""
LEAST_TEXTURE = 6.0
"""Least variance of the texture over that of the noise: twice that of an accepted match."""
LEAST_PIXELS, LEAST_RATIO = 300, 2.0
"""Pixels that must count for one alignment, and their ratio to those that count for the other one. In 21 rendered views of 7 scenes
where any pixel counts the true alignment has at least 2.3 times as many, mostly ten times; docs/research/stereo-confidence.md."""
CHECK_AGAIN_NS = 1_000_000_000
"""Time until the next check while neither alignment is known, as before a flat wall."""


@dataclass(slots=True)
class DepthAlignment:
    """The check of one camera since its opening. left_px, right_px: pixels that counted for an alignment so far."""

    camera: str
    left_px: int = 0
    right_px: int = 0
    _next_ns: int = 0

    @property
    def due(self) -> bool:
        """Whether the next frame is to be checked."""
        return not self.settled and time.monotonic_ns() >= self._next_ns

    @property
    def settled(self) -> bool:
        """Whether the depth is known to be aligned with the left image, which does not change while the camera is open."""
        return self.left_px >= max(LEAST_PIXELS, LEAST_RATIO * self.right_px)

    def take(self, depth_mm: NDArray[np.uint16], pair: tuple[Gray, Gray], f_b_px_m: float, match: MatchParams) -> None:
        """Counts the pixels of one frame. depth_mm: (H, W), 0: none; pair: rectified left and right image, (H, W) uint8; f_b_px_m: focal
        length times baseline. Raises BadData where the depth is aligned with the right image."""
        self._next_ns = time.monotonic_ns() + CHECK_AGAIN_NS
        left, right = alignment_pixels(depth_mm, pair, f_b_px_m, match.window_px | 1)
        self.left_px += left
        self.right_px += right
        if self.right_px >= max(LEAST_PIXELS, LEAST_RATIO * self.left_px):
            raise BadData(
                f"camera {self.camera}: the device's depth is aligned with its right image ({self.right_px} pixels fit it, "
                f"{self.left_px} the left one), although the left one was requested: all positions would be wrong by the baseline. "
                'Install another version of depthai, or set match_on = "host"'
            )


def alignment_pixels(
    depth_mm: NDArray[np.uint16], pair: tuple[Gray, Gray], f_b_px_m: float, window_px: int
) -> tuple[int, int]:
    """Returns the numbers of pixels whose depth fits the images better if aligned with the left, and with the right one."""
    left, right = pair
    as_left = match_statistics(left, right, disparity_of(depth_mm, f_b_px_m), window_px)
    # mirrored, the right image is a left one
    mirrored = np.ascontiguousarray(depth_mm[:, ::-1])
    images = np.ascontiguousarray(right[:, ::-1]), np.ascontiguousarray(left[:, ::-1])
    as_right = match_statistics(*images, disparity_of(mirrored, f_b_px_m), window_px)
    fit_left, fit_right = _fits(as_left), _fits(as_right)[:, ::-1]
    correlation_left, correlation_right = as_left.correlation, as_right.correlation[:, ::-1]
    known = depth_mm > 0
    return (
        int(np.count_nonzero(known & fit_left & (correlation_left - correlation_right >= LEAST_ADVANTAGE))),
        int(np.count_nonzero(known & fit_right & (correlation_right - correlation_left >= LEAST_ADVANTAGE))),
    )


def _fits(found: MatchStatistics) -> NDArray[np.bool_]:
    """(H, W) whether the texture is clear and agrees."""
    clear = found.variance >= np.float32(LEAST_TEXTURE * found.noise_variance)
    return np.asarray(clear & (found.correlation >= LEAST_CORRELATION) & (found.matched >= 0.5))

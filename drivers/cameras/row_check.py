"""Checks that both rectified images of a stereo camera show the same points on the same rows, and that the left image is
the left one.

The rows differ after a crash, or with the calibration of another camera: matching then finds wrong disparities."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .corner_matches import CornerMatches, Gray, match_corners

MAX_VERTICAL_PX = 1.5
MIN_CORNERS = 30
MAX_THIRDS_PX, MIN_THIRD_CORNERS = 2.0, 10
"""Greatest difference between the median row differences of two opposite thirds of the image, and least number of corners
in each. It is 0 for 16 rendered pairs and a real one, and 2.6 to 4.6 for a roll of 0.5 degrees at 350 px focal length."""


@dataclass(frozen=True, slots=True)
class MatchedCorners:
    """Corners of a rectified pair that were found in both images.

    Attributes:
        corners: those with a possible disparity.
        rows_px: median size of their row differences, 0 when the calibration fits; NaN: there are none. The sign does
            not count: where one camera is rolled, the differences on both sides are opposite.
        backwards: those that lie farther right in the right image, as when left and right are exchanged.
        roll_px: by how much the row differences of the left and the right third of the image differ, NaN: too few corners.
            A rolled camera has corners of both signs, and few of them lie at the borders, so that rows_px stays small.
        stretch_px: the same of the upper and the lower third, as with another focal length."""

    corners: int
    rows_px: float
    backwards: int
    roll_px: float = math.nan
    stretch_px: float = math.nan

    @property
    def enough(self) -> bool:
        """Whether there are enough for a verdict."""
        return max(self.corners, self.backwards) >= MIN_CORNERS

    @property
    def complete(self) -> bool:
        """Whether there are enough in both the left and the right third, too."""
        return self.enough and not math.isnan(self.roll_px)

    @property
    def fault(self) -> str:
        """What is wrong; empty: nothing, or there are too few corners."""
        if not self.enough:
            return ""
        if self.backwards > self.corners:
            return (
                f"{self.backwards} of {self.backwards + self.corners} corners are farther right in the right image than in "
                "the left one: left and right are exchanged, or the calibration is wrong"
            )
        differ = "the rectified images differ by"
        if self.rows_px > MAX_VERTICAL_PX:
            return f"{differ} {self.rows_px:.1f} px in height"
        for apart_px, sides in ((self.roll_px, "left and right"), (self.stretch_px, "upper and lower")):
            if apart_px > MAX_THIRDS_PX:
                return f"{differ} {apart_px:.1f} px in height between their {sides} thirds"
        return ""


def matched_corners(left: Gray, right: Gray) -> MatchedCorners:
    """Finds corners of a rectified pair in both images."""
    return judged(match_corners(left, right), left.shape)


def judged(matches: CornerMatches, shape: tuple[int, ...]) -> MatchedCorners:
    """What the corners of images of a shape (H, W) show."""
    if not len(matches.left_px):
        return MatchedCorners(0, math.nan, matches.backwards)
    height, width = shape
    return MatchedCorners(
        corners=len(matches.left_px),
        rows_px=float(np.median(np.abs(matches.rows_px))),
        backwards=matches.backwards,
        roll_px=_between_thirds_px(matches.left_px[:, 0], matches.rows_px, width),
        stretch_px=_between_thirds_px(matches.left_px[:, 1], matches.rows_px, height),
    )


def _between_thirds_px(at_px: NDArray[np.float32], rows_px: NDArray[np.float32], size_px: int) -> float:
    """Returns the difference between the medians of the first and the last third, NaN where one has too few corners."""
    first, last = rows_px[at_px < size_px / 3], rows_px[at_px > 2 * size_px / 3]
    if min(len(first), len(last)) < MIN_THIRD_CORNERS:
        return math.nan
    return abs(float(np.median(first)) - float(np.median(last)))

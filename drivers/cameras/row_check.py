"""Checks that both rectified images of a stereo camera show the same points on the same rows, and that the left image is
the left one.

The rows differ after a crash, or with the calibration of another camera: matching then finds wrong disparities."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..base import BadData

Gray = NDArray[np.uint8]
MAX_VERTICAL_PX = 1.5
MIN_CORNERS = 30
MAX_THIRDS_PX, MIN_THIRD_CORNERS = 2.0, 10
"""Greatest difference between the median row differences of two opposite thirds of the image, and least number of corners
in each. It is 0 for 16 rendered pairs and a real one, and 2.6 to 4.6 for a roll of 0.5 degrees at 350 px focal length."""
CHECK_AGAIN_NS = 1_000_000_000
"""Time until the next check, where too few corners were in view."""
LEAST_DISPARITY_PX, GREATEST_SHARE = -4.0, 0.3
"""Disparities of matched corners: at least the first, for errors of the calibration, and at most the second of the width."""


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
    finder = cv2.ORB.create(nfeatures=800)
    points_l, descriptors_l = finder.detectAndCompute(left, np.empty(0))
    points_r, descriptors_r = finder.detectAndCompute(right, np.empty(0))
    if descriptors_l is None or descriptors_r is None:
        return MatchedCorners(0, math.nan, 0)
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(descriptors_l, descriptors_r)
    pairs = [(points_l[m.queryIdx].pt, points_r[m.trainIdx].pt) for m in matches if m.distance < 40]
    greatest_px = GREATEST_SHARE * left.shape[1]
    backwards = sum(-greatest_px < at_l[0] - at_r[0] <= LEAST_DISPARITY_PX for at_l, at_r in pairs)
    kept = [(at_l, at_r[1] - at_l[1]) for at_l, at_r in pairs if LEAST_DISPARITY_PX < at_l[0] - at_r[0] < greatest_px]
    if not kept:
        return MatchedCorners(0, math.nan, backwards)
    at_px, rows_px = np.array([at for at, _ in kept]), np.array([rows for _, rows in kept])
    height, width = left.shape
    return MatchedCorners(
        corners=len(kept),
        rows_px=float(np.median(np.abs(rows_px))),
        backwards=backwards,
        roll_px=_between_thirds_px(at_px[:, 0], rows_px, width),
        stretch_px=_between_thirds_px(at_px[:, 1], rows_px, height),
    )


def _between_thirds_px(at_px: NDArray[np.float64], rows_px: NDArray[np.float64], size_px: int) -> float:
    """Returns the difference between the medians of the first and the last third, NaN where one has too few corners."""
    first, last = rows_px[at_px < size_px / 3], rows_px[at_px > 2 * size_px / 3]
    if min(len(first), len(last)) < MIN_THIRD_CORNERS:
        return math.nan
    return abs(float(np.median(first)) - float(np.median(last)))


@dataclass(slots=True)
class RowCheck:
    """The check of one camera, with the first pair that has enough corners in the left and in the right third.

    remedy: what to do about a wrong calibration."""

    camera: str
    remedy: str
    done: bool = False
    _next_ns: int = 0

    @property
    def due(self) -> bool:
        """Whether the next pair is to be checked."""
        return not self.done and time.monotonic_ns() >= self._next_ns

    def take(self, left: Gray, right: Gray) -> None:
        """Checks a rectified pair. Raises BadData."""
        self._next_ns = time.monotonic_ns() + CHECK_AGAIN_NS
        found = matched_corners(left, right)
        self.done = bool(found.fault) or (found.enough and not math.isnan(found.roll_px))
        if found.fault:
            raise BadData(f"camera {self.camera}: {found.fault}; {self.remedy}")

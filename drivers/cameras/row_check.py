"""Checks that both rectified images of a stereo camera show the same points on the same rows.

They do not after a crash, or with the calibration of another camera: matching then finds wrong disparities."""

from __future__ import annotations

import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..base import BadData

Gray = NDArray[np.uint8]
MAX_VERTICAL_PX = 1.5
MIN_CORNERS = 30
CHECK_AGAIN_NS = 1_000_000_000
"""Time until the next check, where too few corners were in view."""


def vertical_disparity_px(left: Gray, right: Gray) -> tuple[float, int]:
    """(median size of the row differences of matched corners, their number) of a rectified pair; 0 when the calibration fits.

    The sign does not count: where one camera is rolled, the differences on both sides are opposite."""
    finder = cv2.ORB.create(nfeatures=800)
    points_l, descriptors_l = finder.detectAndCompute(left, np.empty(0))
    points_r, descriptors_r = finder.detectAndCompute(right, np.empty(0))
    if descriptors_l is None or descriptors_r is None:
        return float("nan"), 0
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(descriptors_l, descriptors_r)
    rows = [
        abs(points_r[m.trainIdx].pt[1] - points_l[m.queryIdx].pt[1])
        for m in matches
        if m.distance < 40 and -4.0 < points_l[m.queryIdx].pt[0] - points_r[m.trainIdx].pt[0] < 0.3 * left.shape[1]
    ]
    return (float(np.median(rows)), len(rows)) if rows else (float("nan"), 0)


@dataclass(slots=True)
class RowCheck:
    """The check of one camera, with the first pair that has enough corners. remedy: what to do about a wrong calibration."""

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
        rows_px, corners = vertical_disparity_px(left, right)
        self.done = corners >= MIN_CORNERS
        if self.done and rows_px > MAX_VERTICAL_PX:
            raise BadData(
                f"camera {self.camera}: the rectified images differ by {rows_px:.1f} px in height; {self.remedy}"
            )

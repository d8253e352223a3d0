"""Corners that both rectified images of a stereo camera show."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Points = NDArray[np.float32]
CORNERS = 800
MOST_DIFFERENT_BITS = 40
"""Of the 256 bits of an ORB descriptor."""
LEAST_DISPARITY_PX, GREATEST_SHARE = -4.0, 0.3
"""Disparities of matched corners: at least the first, for errors of the calibration, and at most the second of the width."""
WINDOW_PX, MOST_MOVED_PX, MOST_RETURN_PX = 15, 4.0, 0.2
"""Refinement: side of the window, greatest distance from the matched corner, and greatest distance from the first corner
after the way from the left to the right image and back."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CornerMatches:
    """Corners with a possible disparity. left_px, right_px: (N, 2) x and y in each image; backwards: number of corners that lie
    farther right in the right image, as when left and right are exchanged."""

    left_px: Points
    right_px: Points
    backwards: int = 0

    @property
    def rows_px(self) -> Points:
        """(N,) by how much lower each corner is in the right image."""
        return np.asarray(self.right_px[:, 1] - self.left_px[:, 1], np.float32)


def match_corners(left: Gray, right: Gray) -> CornerMatches:
    """Finds corners of a rectified pair in both images, to about a pixel."""
    finder = cv2.ORB.create(nfeatures=CORNERS)
    points_l, descriptors_l = finder.detectAndCompute(left, np.empty(0))
    points_r, descriptors_r = finder.detectAndCompute(right, np.empty(0))
    found = []
    if descriptors_l is not None and descriptors_r is not None:
        matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(descriptors_l, descriptors_r)
        found = [m for m in matches if m.distance < MOST_DIFFERENT_BITS]
    left_px = np.array([points_l[m.queryIdx].pt for m in found], np.float32).reshape(-1, 2)
    right_px = np.array([points_r[m.trainIdx].pt for m in found], np.float32).reshape(-1, 2)
    disparity_px, greatest_px = left_px[:, 0] - right_px[:, 0], GREATEST_SHARE * left.shape[1]
    kept = (disparity_px > LEAST_DISPARITY_PX) & (disparity_px < greatest_px)
    return CornerMatches(
        left_px=left_px[kept],
        right_px=right_px[kept],
        backwards=int(((disparity_px > -greatest_px) & (disparity_px <= LEAST_DISPARITY_PX)).sum()),
    )


def refined(matches: CornerMatches, left: Gray, right: Gray) -> CornerMatches:
    """The corners whose place in the right image is found to a fraction of a pixel, and again from there in the left one."""
    if not len(matches.left_px):
        return matches
    there = _tracked(left, right, matches.left_px, matches.right_px)
    back = _tracked(right, left, there, matches.left_px)
    kept = np.linalg.norm(there - matches.right_px, axis=1) < MOST_MOVED_PX
    kept &= np.linalg.norm(back - matches.left_px, axis=1) < MOST_RETURN_PX
    return CornerMatches(left_px=matches.left_px[kept], right_px=there[kept])


def _tracked(first: Gray, second: Gray, at_px: Points, guess_px: Points) -> Points:
    """(N, 2) places in the second image of points of the first one, NaN: none."""
    found_px, status, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        np.ascontiguousarray(at_px),
        guess_px.copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 0.005),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.where(status == 1, found_px, np.nan).astype(np.float32)

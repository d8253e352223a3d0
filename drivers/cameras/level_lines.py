"""Matches on level lines: rods, wires and rims along the image rows. See docs/explanation/stereo-depth.md.

A level line has no differences of grey along the row, so nothing on it can be matched. The window of a match reaches to the rows
above and below, and the texture there gives it the disparity of what is behind the line: a rod before a meadow would be measured as
meadow. So a match on such a line counts only where the texture of its own row agrees in both images. Rows that belong to a line in
part, or lie next to one, are dropped with it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_GREY = 3.0
"""Difference of grey over two rows, on average along a line."""
_COHERENCE = 0.75
"""Share of the mean square of that difference that its mean along the line makes up. For texture it is the inverse of the number of
independent places along the line."""
_REACH_ROWS = 2
"""Rows above and below the edge of a line that are tested: a line is up to twice as wide, plus the rows of its edges."""
_BESIDE_ROWS, _STEP_PX = 8, 1.0
"""A match that is nearer by more than this step than what lies so many rows above or below is not that."""
_ROW_PX, _ROW_CORRELATION = 31, 0.6
"""Columns of one row that must agree by this correlation."""


def level_lines(image: Gray, length_px: int) -> Mask:
    """(H, W) whether a level edge at least length_px long passes through a pixel. image: (H, W) uint8."""
    smooth = cv2.blur(np.asarray(image, np.float32), (3, 1))
    down = cv2.filter2D(smooth, cv2.CV_32F, np.array([[-1.0], [0.0], [1.0]], np.float32))
    mean, square = cv2.blur(down, (length_px, 1)), cv2.blur(down * down, (length_px, 1))
    return np.asarray((np.abs(mean) >= _LEAST_GREY) & (mean * mean >= _COHERENCE * square))


def own_row_agrees(left: Gray, right: Gray, disparity: Image) -> Mask:
    """(N, W) whether both images agree at a disparity along the row of a pixel, without the rows beside it. All (N, W)."""
    kernel = np.array([[-0.5, 0.0, 0.5]], np.float32)
    columns = np.arange(left.shape[1], dtype=np.float32)[None, :] - disparity
    rows = np.broadcast_to(np.arange(left.shape[0], dtype=np.float32)[:, None], left.shape)
    g_left = cv2.filter2D(left, cv2.CV_32F, kernel)
    g_right = cv2.remap(cv2.filter2D(right, cv2.CV_32F, kernel), columns, np.ascontiguousarray(rows), cv2.INTER_LINEAR)

    def mean(values: Image) -> Image:
        return np.asarray(cv2.blur(values, (_ROW_PX, 1)), np.float32)

    both = mean(g_left * g_left) * mean(g_right * g_right)
    return np.asarray(mean(g_left * g_right) > np.float32(_ROW_CORRELATION) * np.sqrt(both))


def is_background(disparity: Image, lines: Mask) -> Mask:
    """(H, W) whether a match is no nearer than what is measured within _BESIDE_ROWS rows above or below it outside of `lines` (H, W). What
    stands out was measured by itself."""
    around = np.where((disparity >= 0.0) & ~lines, disparity, np.float32(np.inf))
    farthest = cv2.erode(around, np.ones((2 * _BESIDE_ROWS + 1, 1), np.uint8), borderValue=np.inf)
    return np.asarray((disparity >= 0.0) & np.isfinite(farthest) & (disparity - farthest <= _STEP_PX))


def without_level_lines(left: Gray, right: Gray, disparity: Image, length_px: int) -> Image:
    """The disparity (H, W) float32 px, negative: none, without matches on level lines that their own row does not confirm."""
    lines = level_lines(left, length_px)
    if not lines.any():
        return disparity
    near = np.ones((2 * _REACH_ROWS + 1, 1), np.uint8)
    tested = cv2.dilate(lines.view(np.uint8), near).view(np.bool_)
    wrong = tested & is_background(disparity, tested)
    rows = np.flatnonzero(wrong.any(axis=1))
    if not len(rows):
        return disparity
    wrong[rows] &= ~own_row_agrees(left[rows], right[rows], disparity[rows])
    dropped = cv2.dilate(wrong.view(np.uint8), near).view(np.bool_) & tested
    return np.where(dropped, np.float32(-1.0), disparity)

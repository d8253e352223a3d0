"""Matches on nearly level lines: rods, wires and rims along the image rows. See docs/explanation/stereo-depth.md.

A level line has no differences of grey along the row, so nothing on it can be matched. The window of a match reaches to the rows
above and below, and the texture there gives it the disparity of what is behind the line: a rod before a meadow would be measured as
meadow. So a match on such a line counts only where the texture of its own row agrees in both images. Rows that belong to a line in
part, or lie next to one, are dropped with it. A line that is inclined by some degrees has weak differences along the row, and
is treated alike: a vehicle that flies or a wire that sags inclines it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_GREY = 3.0
"""Difference of grey over two rows, on average along a line."""
_SLOPES_DEG = (-4.0, -2.0, 0.0, 2.0, 4.0)
"""Inclinations in the image at which lines are looked for. A line of the least length may differ from one of them by a degree."""
_COARSE_PX = 4
"""Columns that are averaged before lines are followed. An inclined line leaves its row by at most a third of a pixel over them."""
_COHERENCE = 0.75
"""Share of the mean square of that difference that its mean along the line makes up. For texture it is the inverse of the number of
independent places along the line."""
_REACH_ROWS = 2
"""Rows above and below the edge of a line that are tested: a line is up to twice as wide, plus the rows of its edges."""
_BESIDE_ROWS, _STEP_PX = 8, 1.0
"""A match that is nearer by more than this step than what lies so many rows above or below is not that."""
_ROW_PX = 31
"""Columns of one row that must agree."""


def level_lines(image: Gray, length_px: int) -> Mask:
    """(H, W) whether an edge at least length_px long, inclined by at most 5 degrees, passes through a pixel. image: (H, W) uint8."""
    return np.asarray(line_steps(image, length_px) != 0.0)


def line_steps(image: Gray, length_px: int) -> Image:
    """(H, W) float32 by how many grey levels such an edge gets brighter downwards over two rows; 0: there is none."""
    height, width = image.shape
    smooth = cv2.resize(
        np.asarray(image, np.float32), (max(1, width // _COARSE_PX), height), interpolation=cv2.INTER_AREA
    )
    down = cv2.filter2D(smooth, cv2.CV_32F, np.array([[-1.0], [0.0], [1.0]], np.float32))
    found = np.zeros(down.shape, np.float32)
    for slope_deg in _SLOPES_DEG:
        steps = _steps_of_slope(down, length_px // _COARSE_PX, _COARSE_PX * math.tan(math.radians(slope_deg)))
        found = np.where(np.abs(steps) > np.abs(found), steps, found)
    return np.asarray(cv2.resize(found, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)


def _steps_of_slope(down: Image, length: int, slope: float) -> Image:
    """(H, W) mean of a difference of grey over two rows (H, W) along lines of so many columns that fall by `slope` rows per column; 0
    where the difference is not coherent along them."""
    height, width = down.shape
    beyond = math.ceil(0.5 * abs(slope) * width)
    # moves each column so that these lines become rows
    move = np.array([[1.0, 0.0, 0.0], [slope, 1.0, -0.5 * slope * width - beyond]])
    size, flags = (width, height + 2 * beyond), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    rows = cv2.warpAffine(down, move, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    along = max(1, length), 1
    mean, square = cv2.blur(rows, along), cv2.blur(rows * rows, along)
    lines = (np.abs(mean) >= _LEAST_GREY) & (mean * mean >= _COHERENCE * square)
    steps = np.where(lines, mean, np.float32(0.0))
    return np.asarray(cv2.warpAffine(steps, move, (width, height), flags=cv2.INTER_NEAREST), np.float32)


def own_row_agrees(left: Gray, right: Gray, disparity: Image, correlation: float) -> Mask:
    """(N, W) whether both images agree by this correlation at a disparity along the row of a pixel, without the rows beside it. All
    (N, W)."""
    kernel = np.array([[-0.5, 0.0, 0.5]], np.float32)
    columns = np.arange(left.shape[1], dtype=np.float32)[None, :] - disparity
    rows = np.broadcast_to(np.arange(left.shape[0], dtype=np.float32)[:, None], left.shape)
    g_left = cv2.filter2D(left, cv2.CV_32F, kernel)
    g_right = cv2.remap(cv2.filter2D(right, cv2.CV_32F, kernel), columns, np.ascontiguousarray(rows), cv2.INTER_LINEAR)

    def mean(values: Image) -> Image:
        return np.asarray(cv2.blur(values, (_ROW_PX, 1)), np.float32)

    both = mean(g_left * g_left) * mean(g_right * g_right)
    return np.asarray(mean(g_left * g_right) > np.float32(correlation) * np.sqrt(both))


def is_background(disparity: Image, lines: Mask) -> Mask:
    """(H, W) whether a match is no nearer than what is measured within _BESIDE_ROWS rows above or below it outside of `lines` (H, W). What
    stands out was measured by itself."""
    around = np.where((disparity >= 0.0) & ~lines, disparity, np.float32(np.inf))
    farthest = cv2.erode(around, np.ones((2 * _BESIDE_ROWS + 1, 1), np.uint8), borderValue=np.inf)
    return np.asarray((disparity >= 0.0) & np.isfinite(farthest) & (disparity - farthest <= _STEP_PX))


def without_level_lines(left: Gray, right: Gray, disparity: Image, length_px: int, correlation: float) -> Image:
    """The disparity (H, W) float32 px, negative: none, without matches on `level_lines` that their own row does not confirm by this
    correlation."""
    lines = level_lines(left, length_px)
    if not lines.any():
        return disparity
    near = np.ones((2 * _REACH_ROWS + 1, 1), np.uint8)
    tested = cv2.dilate(lines.view(np.uint8), near).view(np.bool_)
    wrong = tested & is_background(disparity, tested)
    rows = np.flatnonzero(wrong.any(axis=1))
    if not len(rows):
        return disparity
    wrong[rows] &= ~own_row_agrees(left[rows], right[rows], disparity[rows], correlation)
    dropped = cv2.dilate(wrong.view(np.uint8), near).view(np.bool_) & tested
    return np.where(dropped, np.float32(-1.0), disparity)

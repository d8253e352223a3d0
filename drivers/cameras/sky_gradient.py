"""Smooth areas whose brightness does not change with height. See docs/explanation/open-space.md.

A clear sky gets brighter towards the horizon, since light passes through more air there, and a closed cover gets darker
(CIE S 011: Spatial distribution of daylight). A painted face has one brightness: where the smooth pixels above an edge
have one too, they may be such a face."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_ALONG_PX = 31
"""Columns of which most must have one brightness: specks end the smooth pixels of single columns high in the sky."""
_EDGE_ROWS, _MEAN = 6, (7, 5)
"""Rows above an edge that its marks and a blurring lens take; and columns and rows of a mean."""
_LEAST_CHANGE = 0.006
"""Least change over `rise_px` rows as a share of the brightness, in grey levels: a tenth of that of a clear sky, and half
of that of a hazy one."""
_LEAST_SIGMAS = 0.4
"""The same in standard deviations of the sensor's noise, of which the difference of two means has 0.24: the noise of a dim
face is more than that share of its brightness."""


def columns_without_gradient(even: Mask, left: Gray, rise_px: int, noise_grey: float) -> Mask:
    """Returns (W,): columns in which the smooth pixels below the upper border have one brightness over the lowest
    `rise_px` rows: most columns around do not get brighter, and most do not get darker.

    Columns with fewer smooth rows are judged by those that there are, with less than half of them not at all.

    Args:
        even: (H, W) whether a pixel is smooth.
        left: (H, W) uint8 left image.
        rise_px: rows.
        noise_grey: standard deviation of the noise of the image, grey levels."""
    first = np.where((~even).any(axis=0), np.argmax(~even, axis=0), even.shape[0])
    low = first - _EDGE_ROWS - _MEAN[1] // 2
    high = np.maximum(low - rise_px, _MEAN[1] // 2)
    valid = low - high >= 0.5 * rise_px
    columns = np.flatnonzero(valid)
    mean = cv2.boxFilter(left, cv2.CV_32F, _MEAN)
    lower, upper = mean[low[valid], columns], mean[high[valid], columns]
    share = _LEAST_CHANGE * (low - high)[valid] / rise_px
    least = np.maximum(share * lower, _LEAST_SIGMAS * noise_grey)
    brighter, darker = np.zeros((2, len(valid)), np.float32)
    brighter[columns], darker[columns] = lower - upper >= least, upper - lower >= least
    most = np.maximum(_along(brighter), _along(darker))
    return np.asarray(valid & (most <= 0.5 * _along(valid.astype(np.float32))))


def _along(values: Image) -> Image:
    """Sum of values (W,) over _ALONG_PX columns; there are none beyond the borders."""
    row, size = values.reshape(1, -1), (_ALONG_PX, 1)
    return np.asarray(cv2.boxFilter(row, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT).ravel())

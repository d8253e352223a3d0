"""Lower edges of smooth areas that are near by their own parallax. See docs/explanation/open-space.md.

An edge that is inclined by m (rows per column) lies m d rows apart at the same column of both images, where d is its disparity. The edge
of the sky is far. The shift of its profile is measured to some hundredths of a pixel in each column, far better than an edge along the rows
is matched, and is averaged along the edge."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Image = NDArray[np.float32]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ABOVE_ROWS, _BELOW_ROWS, _BORDER_ROWS = 6, 9, 6
"""Rows of the profile of an edge before and from the first row that is not smooth, and rows at the upper border that are left out."""
_ALONG_PX, _LEAST_SHARE = 61, 0.9
"""Columns along which a shift is averaged, and share of them that must have an edge."""
_STRAIGHT_ROWS, _MOST_ROWS = 3.0, 2.0
"""Standard deviation of an edge from a line, at most; and the greatest shift of a column that is averaged as it is."""
_FAR_PX, _LEAST_ROWS, _LEAST_SLOPE = 2.0, 0.12, 0.03
"""An edge of at least this slope is near whose shift is more than that of so much disparity, by so many rows: rows of both images differ
by some hundredths, and interpolation moves a level edge by more than a tenth in steps of one row."""


def columns_with_near_edge(even: Mask, left: Gray, right: Gray) -> Mask:
    """(W,) columns in which the smooth pixels below the upper border end at an edge that is near. even: (H, W) whether a pixel is
    smooth; left, right: (H, W) uint8, rectified."""
    height, width = even.shape
    below_border = ~even[_BORDER_ROWS:]
    row = np.where(below_border.any(axis=0), np.argmax(below_border, axis=0) + _BORDER_ROWS, 0)
    valid = (row >= _BORDER_ROWS + 2 * _ABOVE_ROWS) & (row < height - _BELOW_ROWS - 1)
    shift = np.zeros(width)
    shift[valid] = _shifts(left, right, row[valid], np.flatnonzero(valid))
    slope, straight = _slopes(row.astype(np.float64), valid)
    mean = _along(np.clip(shift, -_MOST_ROWS, _MOST_ROWS) * valid) / np.maximum(_along(valid.astype(np.float64)), 1e-9)
    near = straight & (np.abs(slope) >= _LEAST_SLOPE)
    near &= mean * np.sign(slope) > _FAR_PX * np.abs(slope) + _LEAST_ROWS
    reach = np.ones((1, _ALONG_PX), np.uint8)
    return np.asarray(cv2.dilate(near.view(np.uint8)[None, :], reach)[0]).view(np.bool_)


def _along(values: Floats) -> Floats:
    """Mean of values (W,) over _ALONG_PX columns; there are none beyond the borders."""
    return np.asarray(
        cv2.blur(values.reshape(1, -1), (_ALONG_PX, 1), borderType=cv2.BORDER_CONSTANT).ravel(), np.float64
    )


def _shifts(left: Gray, right: Gray, row: NDArray[np.intp], column: NDArray[np.intp]) -> Floats:
    """(N,) rows by which the profile around a row of a column lies lower in the right image. Both imagers need not be equally bright."""
    rows = row + np.arange(-_ABOVE_ROWS - 1, _BELOW_ROWS + 1)[:, None]
    one, other = (cv2.GaussianBlur(i.astype(np.float32), (0, 0), 0.7)[rows, column] for i in (left, right))
    slope = 0.5 * (one[2:] - one[:-2])
    terms = np.stack([slope, one[1:-1], np.ones_like(slope)]).astype(np.float64)  # (3, rows, N)
    squares = np.einsum("irn,jrn->nij", terms, terms) + 1e-6 * np.eye(3)
    products = np.einsum("irn,rn->ni", terms, (other - one)[1:-1].astype(np.float64))
    return np.asarray(-np.linalg.solve(squares, products[..., None])[:, 0, 0])


def _slopes(row: Floats, valid: Mask) -> tuple[Floats, Mask]:
    """(rows per column by which the edge falls along _ALONG_PX columns (W,), whether it is straight there (W,))."""
    weight, x = valid.astype(np.float64), np.arange(len(row), dtype=np.float64)
    n = np.maximum(_along(weight), 1e-9)
    mean_x, mean_y = _along(weight * x) / n, _along(weight * row) / n
    spread = np.maximum(_along(weight * x * x) / n - mean_x**2, 1e-9)
    slope = (_along(weight * x * row) / n - mean_x * mean_y) / spread
    rest = _along(weight * row * row) / n - mean_y**2 - slope**2 * spread
    return slope, np.asarray((n >= _LEAST_SHARE) & (rest <= _STRAIGHT_ROWS**2))

"""Lower edges of smooth areas that are near by their own parallax. See docs/explanation/open-space.md.

An edge that is inclined by m (rows per column) lies m d rows apart at the same column of both images, where d is its disparity. The edge
of the sky is far. The shift of its profile is measured to some hundredths of a pixel in each column, far better than an edge along the rows
is matched, and is averaged along the edge. Where it is greater than the profile, both profiles are not alike."""

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
FAR_PX = 2.0
"""Greatest disparity of an edge of the sky: 21 m for a ZED at 672 columns."""
_LEAST_ROWS, _LEAST_SLOPE = 0.12, 0.03
"""An edge of at least this slope is near whose shift is more than that of the disparity of a far edge, by so many rows: rows of both
images differ by some hundredths, and interpolation moves a level edge by more than a tenth in steps of one row."""
_LEAST_CORRELATION = 0.6
"""An edge of at least this slope is near too where its profiles in both images correlate by less: a shift of about 3 rows."""


def columns_with_near_edge(even: Mask, left: Gray, right: Gray, far_px: float = FAR_PX) -> Mask:
    """(W,) columns in which the smooth pixels below the upper border end at an edge that is near. even: (H, W) whether a pixel is
    smooth; left, right: (H, W) uint8, rectified; far_px: greatest disparity of an edge that is not near."""
    height, width = even.shape
    below_border = ~even[_BORDER_ROWS:]
    row = np.where(below_border.any(axis=0), np.argmax(below_border, axis=0) + _BORDER_ROWS, 0)
    valid = (row >= _BORDER_ROWS + 2 * _ABOVE_ROWS) & (row < height - _BELOW_ROWS - 1)
    one, other = _profiles(left, right, row[valid], np.flatnonzero(valid))
    shift, products = np.zeros(width), np.zeros((3, width))
    shift[valid] = np.clip(_shifts(one, other), -_MOST_ROWS, _MOST_ROWS)
    products[:, valid] = _products(one, other)
    slope, straight = _slopes(row.astype(np.float64), valid)
    mean = _along(shift) / np.maximum(_along(valid.astype(np.float64)), 1e-9)
    both, of_one, of_other = (_along(p) for p in products)
    apart = mean * np.sign(slope) > far_px * np.abs(slope) + _LEAST_ROWS
    apart |= both < _LEAST_CORRELATION * np.sqrt(np.maximum(of_one * of_other, 0.0))
    near = straight & (np.abs(slope) >= _LEAST_SLOPE) & apart
    reach = np.ones((1, _ALONG_PX), np.uint8)
    return np.asarray(cv2.dilate(near.view(np.uint8)[None, :], reach)[0]).view(np.bool_)


def _along(values: Floats) -> Floats:
    """Mean of values (W,) over _ALONG_PX columns; there are none beyond the borders."""
    return np.asarray(
        cv2.blur(values.reshape(1, -1), (_ALONG_PX, 1), borderType=cv2.BORDER_CONSTANT).ravel(), np.float64
    )


def _profiles(left: Gray, right: Gray, row: NDArray[np.intp], column: NDArray[np.intp]) -> tuple[Image, Image]:
    """The profiles around a row of a column in both images, (rows, N) each."""
    rows = row + np.arange(-_ABOVE_ROWS - 1, _BELOW_ROWS + 1)[:, None]
    one, other = (cv2.GaussianBlur(i.astype(np.float32), (0, 0), 0.7)[rows, column] for i in (left, right))
    return one, other


def _products(one: Image, other: Image) -> Floats:
    """(3, N) sums along profiles (rows, N), less their means: of the product of both, and of the squares of each."""
    first, second = (np.asarray(p - p.mean(axis=0), np.float64) for p in (one, other))
    return np.stack([(first * second).sum(axis=0), (first**2).sum(axis=0), (second**2).sum(axis=0)])


def _shifts(one: Image, other: Image) -> Floats:
    """(N,) rows by which the second profile (rows, N) lies lower than the first one. Both imagers need not be equally bright."""
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

"""Table of strips, and how one strip is made from pixels of a column (Section 4.2, Eq. 9).

A strip is a vertical run of pixels of one column of the levelled view at one distance, a record of STRIP. The stages
from windows.py to gap_filling.py fill and change one table, (N,) STRIP in the order of columns."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, record

PX = 16
"""Support is counted in sixteenths of a source pixel: where the view magnifies, a cell is less than one pixel."""

STRIP = record(
    ("column", np.int32),
    ("top_row", np.int32),  # first row
    ("bottom_row", np.int32),  # last row, inclusive
    ("support", np.int32),  # distinct source pixels in 1/PX; 0: the strip was joined to another one
    ("kind", np.int32),  # SMOOTH to MERGED
    ("cluster", np.int32),  # -1 before it is known
    ("track", np.int32),  # -1 before it is known
    ("filled_rows", np.int32),  # rows without a measurement
    ("cut", np.int32),  # CUT_TOP, CUT_BOTTOM
    ("disparity_px", np.float32),
    ("near_px", np.float32),  # disparity of the near edge, a lower confidence bound
    ("sigma_px", np.float32),  # standard deviation of disparity_px
    ("x_m", np.float32),  # forward, right and down in level_cam, see `clusters.place_strips`
    ("y_m", np.float32),
    ("top_m", np.float32),
    ("bottom_m", np.float32),
)
"""A strip."""

SMOOTH, ROUGH, IRREGULAR, MERGED = range(4)
"""Kinds of strips: the depth varies by noise only; it varies by more; made of pixels outside of all windows; several
strips of a full column."""
CUT_TOP, CUT_BOTTOM = 1, 2
"""Bits of `cut`: the border of the image cuts the strip there."""

NEAR_RANK = 3
"""The near edge of a rough strip is this closest pixel, so that two wrong ones do not move it."""

COUNTS = record(("strips", np.int64), ("in_columns_before", np.int64), ("merged", np.int64))
"""Number of strips so far, their number before this column, and the number of strips that were merged in full
columns."""


class Column(NamedTuple):
    """One column of the levelled view."""

    u: Any  # index
    line: Any  # (V,) uint16 quantised disparity
    label: Any  # (V rounded up to 8,) uint8 labels of `row_mask`
    H: Any  # (3, 3) homography of the view
    area: Any  # `homography_area` of H


class StripOutput(NamedTuple):
    """Output of the strip stages."""

    strips: Any  # (N,) STRIP
    counts: Any  # a record of COUNTS


class Pixels(NamedTuple):
    """Pixels codes[first..last - 1] of one strip. Zeros among the codes are not counted."""

    codes: Any  # (V,) int32 quantised disparity
    first: Any  # index of the first pixel
    last: Any  # end of the pixels
    count: Any  # number of pixels
    total: Any  # sum of their codes
    top: Any  # first row that they span
    bottom: Any  # last row that they span, inclusive
    filled: Any  # number of these rows that were not measured at this distance


class StripList(NamedTuple):
    """Strips for kernels."""

    table: Any  # (N,) STRIP in the order of columns, of which the first `count` are used
    count: Any  # number of strips
    first_of_column: Any  # (cols + 1,) int32, index of the first strip of each column


@inner_inline
def add_strip(pixels, distance, kind, column, settings, out):
    """Appends a strip. In a column that already has max_column_strips strips it extends the last one instead.

    The extended strip spans both and has the nearer of both distances, so that nothing is lost; counts.merged is
    increased.
    distance: (disparity_px, near_px, sigma_px) of STRIP."""
    n = out.counts.strips
    top, bottom, filled = pixels.top, pixels.bottom, pixels.filled
    support = support_of(column, top, bottom, pixels.count)
    if n - out.counts.in_columns_before < settings.max_column_strips:
        s = out.strips[n]
        s.column, s.top_row, s.bottom_row = column.u, top, bottom
        s.support, s.kind, s.cluster, s.track = support, kind, -1, -1
        s.filled_rows, s.cut = filled, 0
        s.disparity_px, s.near_px, s.sigma_px = distance
        out.counts.strips = n + 1
        return
    s = out.strips[n - 1]
    between = max(0, max(top - s.bottom_row, s.top_row - bottom) - 1)
    s.top_row, s.bottom_row = min(s.top_row, top), max(s.bottom_row, bottom)
    s.support += support
    s.kind = MERGED
    s.filled_rows += filled + between
    disparity_px, near_px, sigma_px = distance
    s.disparity_px, s.near_px = max(s.disparity_px, disparity_px), max(s.near_px, near_px)
    s.sigma_px = max(s.sigma_px, sigma_px)
    out.counts.merged += 1


@inner_inline
def support_of(column, top, bottom, count):
    """Returns the number of distinct source pixels, in 1/PX, of `count` cells of a column.

    It is less than the number of cells where the view repeats pixels."""
    H = column.H
    w = H[2, 0] * column.u + H[2, 1] * (0.5 * (top + bottom)) + H[2, 2]
    share = 0.0
    if w > 1e-6:
        share = min(1.0, column.area / (w * w * w))
    return max(1, int(PX * count * share + 0.5))


@inner_inline
def kth_closest(codes, first, last, k):
    """Returns the k-th largest of codes[first..last - 1], k from 1 to NEAR_RANK. There is no branch in the loop."""
    a, b, c = np.int32(-1), np.int32(-1), np.int32(-1)
    for i in range(np.uint64(first), np.uint64(last)):
        x = codes[i]
        a, b, c = max(a, x), max(b, min(a, x)), max(c, min(b, x))
    return a if k == 1 else b if k == 2 else c


@inner
def mean_noise(sigma, count, alike_px):
    """Returns the standard deviation of the mean of `count` neighbouring pixels of standard deviation `sigma`.

    Runs of alike_px pixels share their noise; 1: independent pixels."""
    return sigma * math.sqrt(alike_px / (count + alike_px - 1.0))


@inner_inline
def emit(pixels, rough, kind, column, settings, out):
    """Appends one strip made of some pixels (Eq. 9).

    The disparity of a smooth strip is the mean of its pixels. Eq. 9 uses the greatest disparity for a rough one; a
    single wrong pixel would move it. Here its near edge is the k-th largest disparity less near_sigmas of noise,
    where k is NEAR_RANK, at most half of the pixels, and not behind the mean. The strip itself stands at most safe_distance_m
    behind that edge.
    rough: True if the depth varies by more than noise."""
    count, sigma_d = pixels.count, settings.sigma_d_px
    mean = np.float32(pixels.total / (settings.lsb_per_px * count))
    d, near = mean, mean
    if rough:
        k = min(NEAR_RANK, (count + 1) // 2)
        closest = np.float32(kth_closest(pixels.codes, pixels.first, pixels.last, k) / settings.lsb_per_px)
        near = max(closest - np.float32(settings.near_sigmas * sigma_d), mean)
        d = max(mean, np.float32(settings.f_px * near / (settings.f_px + settings.safe_distance_m * near)))
    sigma = mean_noise(sigma_d, count, settings.noise_alike_px if kind == SMOOTH else 1.0)
    # a lower confidence bound, so that a few stray pixels in front of a wall do not move its plane
    near = np.float32(max(settings.near_edge_share * d, near - settings.band_sigmas * sigma))
    add_strip(pixels, (d, near, np.float32(sigma)), kind, column, settings, out)

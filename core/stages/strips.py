"""Strips: the table, and how one strip is made from the pixels of a column (Section 4.2).

A strip is a vertical run of pixels of one column of the levelled view at one distance: a record of STRIP. The stages from
`windows` to `gap_filling` fill and change one table of them, (N,) STRIP in order of columns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, record

PX = 16
"""Support is counted in sixteenths of a source pixel: where the view magnifies, a cell is less than one."""

STRIP = record(
    ("column", np.int32),
    ("top_row", np.int32),
    ("bottom_row", np.int32),
    ("support", np.int32),
    ("kind", np.int32),
    ("cluster", np.int32),
    ("track", np.int32),
    ("filled_rows", np.int32),
    ("cut", np.int32),
    ("disparity_px", np.float32),
    ("near_px", np.float32),
    ("sigma_px", np.float32),
    ("x_m", np.float32),
    ("y_m", np.float32),
    ("top_m", np.float32),
    ("bottom_m", np.float32),
)
"""column; first and last row, inclusive; support: distinct source pixels in 1/16 (0: the strip was joined to another);
kind: see SMOOTH; cluster and track: -1 before they are known; filled_rows: rows without a measurement; cut: CUT_TOP and
CUT_BOTTOM. disparity_px; near_px: disparity of the robust near edge, a lower bound; sigma_px: 1 sigma of disparity_px.
x_m forward, y_m right, top_m and bottom_m down: the place in level_cam (`clusters.place_strips`)."""

SMOOTH, ROUGH, IRREGULAR, HORIZONTAL, MERGED = range(5)
"""Kinds of strips: within the noise of one distance; wider than that; of what no window took; of that a horizontal
surface; several strips of a column for which there was no room."""
CUT_TOP, CUT_BOTTOM = 1, 2
"""Bits of `cut`: the image border cut the strip there."""

COUNTS = record(("strips", np.int64), ("in_columns_before", np.int64), ("merged", np.int64))
"""Strips so far, those of the columns before this one, and strips that were merged for want of room."""


class Column(NamedTuple):
    """One column of the levelled view: its index, quantised disparity (V,) uint16, labels (V rounded up to 8,) uint8 of
    `row_mask`, the homography H (3, 3) of the view and `homography_area` of that."""

    u: Any
    line: Any
    label: Any
    H: Any
    area: Any


class StripOutput(NamedTuple):
    """Where strips are added: strips (N,) STRIP, and counts, a record of COUNTS."""

    strips: Any
    counts: Any


class Pixels(NamedTuple):
    """Pixels codes[first..last - 1] of one strip: their number and sum, the rows top..bottom that they span (inclusive),
    and how many of these rows were filled. Zeros among the codes are not counted."""

    codes: Any
    first: Any
    last: Any
    count: Any
    total: Any
    top: Any
    bottom: Any
    filled: Any


@inner
def kth_largest(values, n, k):
    """The k-th largest of values[:n], k counted from 1; reorders values."""
    left, right, want = 0, n - 1, k - 1
    for _ in range(2 * n + 2):
        if left >= right:
            break
        pivot = values[(left + right) // 2]
        i, j = left, right
        for _a in range(n + 1):
            if i > j:
                break
            for _b in range(n):
                if values[i] <= pivot:
                    break
                i += 1
            for _b in range(n):
                if values[j] >= pivot:
                    break
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if want <= j:
            right = j
        elif want >= i:
            left = i
        else:
            break
    return values[want]


@inner_inline
def add_strip(out, room, u, pixels, support, kind, disparity_px, near_px, sigma_px):
    """Appends a strip. A column that has `room` strips extends its last one instead: from end to end, at the nearer of
    both distances. Nothing is dropped, and counts.merged counts how often that was."""
    n = out.counts.strips
    top, bottom, filled = pixels.top, pixels.bottom, pixels.filled
    if n - out.counts.in_columns_before < room:
        s = out.strips[n]
        s.column, s.top_row, s.bottom_row = u, top, bottom
        s.support, s.kind, s.cluster, s.track = support, kind, -1, -1
        s.filled_rows, s.cut = filled, 0
        s.disparity_px, s.near_px, s.sigma_px = disparity_px, near_px, sigma_px
        out.counts.strips = n + 1
        return
    s = out.strips[n - 1]
    between = max(0, max(top - s.bottom_row, s.top_row - bottom) - 1)
    s.top_row, s.bottom_row = min(s.top_row, top), max(s.bottom_row, bottom)
    s.support += support
    s.kind = MERGED
    s.filled_rows += filled + between
    s.disparity_px, s.near_px = max(s.disparity_px, disparity_px), max(s.near_px, near_px)
    s.sigma_px = max(s.sigma_px, sigma_px)
    out.counts.merged += 1


@inner
def homography_area(H):
    """|det(H)|: over w^3 it is the area of a cell of the levelled view in source pixels (its Jacobian)."""
    a = H[0, 0] * (H[1, 1] * H[2, 2] - H[1, 2] * H[2, 1])
    b = H[0, 1] * (H[1, 0] * H[2, 2] - H[1, 2] * H[2, 0])
    c = H[0, 2] * (H[1, 0] * H[2, 1] - H[1, 1] * H[2, 0])
    return abs(a - b + c)


@inner_inline
def support_of(column, top, bottom, count):
    """Distinct source pixels, in 1/16, of `count` cells of a column: fewer than cells where these repeat pixels."""
    H = column.H
    w = H[2, 0] * column.u + H[2, 1] * (0.5 * (top + bottom)) + H[2, 2]
    share = 0.0
    if w > 1e-6:
        share = min(1.0, column.area / (w * w * w))
    return max(1, int(PX * count * share + 0.5))


@inner_inline
def kth_closest(codes, first, last, k, buffer):
    """The k-th largest of codes[first..last - 1], k counted from 1. buffer: scratch, at least as long."""
    if k <= 3:
        a, b, c = np.int32(-1), np.int32(-1), np.int32(-1)
        for i in range(np.uint64(first), np.uint64(last)):
            x = codes[i]
            a, b, c = max(a, x), max(b, min(a, x)), max(c, min(b, x))
        return a if k == 1 else b if k == 2 else c
    for i in range(last - first):
        buffer[i] = codes[first + i]
    return kth_largest(buffer, last - first, k)


@inner
def mean_noise(sigma, count, alike_px):
    """Noise of the mean of `count` neighbouring pixels of noise sigma, of which runs of alike_px share theirs (1: none)."""
    return sigma * math.sqrt(alike_px / (count + alike_px - 1.0))


@inner_inline
def emit(pixels, rough, kind, column, settings, buffer, out):
    """Adds one strip of some pixels.

    A smooth one stands at their mean. The near edge of a rough one is the k-th closest less near_sigmas of noise, never
    behind the mean; k is at most half of them. It stands at most safe_distance behind that edge (Eq. 9 with a
    k-th largest for its one-pixel maximum). settings: a record of STRIP_SETTINGS; buffer: scratch of `kth_closest`."""
    count, sigma_d = pixels.count, settings.sigma_d_px
    mean = np.float32(pixels.total / (settings.lsb_per_px * count))
    d, near = mean, mean
    if rough:
        k = min(max(settings.near_rank, int(settings.near_quantile * count)), (count + 1) // 2)
        closest = np.float32(kth_closest(pixels.codes, pixels.first, pixels.last, k, buffer) / settings.lsb_per_px)
        near = max(closest - np.float32(settings.near_sigmas * sigma_d), mean)
        d = max(mean, np.float32(settings.f_px * near / (settings.f_px + settings.safe_distance_m * near)))
    # leaves scatter by more than noise: the mean of a rough strip is no more certain for many pixels
    sigma = mean_noise(sigma_d, count, settings.noise_alike_px if kind == SMOOTH else 1.0)
    # a lower confidence bound: a few stray pixels in front of a wall move no plane
    near = np.float32(max(settings.near_edge_share * d, near - settings.band_sigmas * sigma))
    support = support_of(column, pixels.top, pixels.bottom, count)
    add_strip(out, settings.max_column_strips, column.u, pixels, support, kind, d, near, np.float32(sigma))

"""Sections 4.1 to 4.3 as printed: peaks of density, windows with Eq. 9, and the rest in segments without horizontal ones.

A strip is a record of `STRIP`; strips come in order of their columns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.stages.density import MAX_PEAKS, BinTable, Peaks, find_peaks, soft_counts
from core.stages.row_mask import (
    CLOSED,
    CODE,
    NO_PEAK,
    ROW,
    TAKEN,
    ends_of,
    gather_rows,
    label_rows,
    mask_remaining_rows,
)
from core.stages.view_geometry import ViewGeometry

from .params import PaperParams

STRIP = np.dtype(
    [
        ("u", np.int32),
        ("top", np.int32),
        ("bottom", np.int32),
        ("support", np.int32),
        ("cluster", np.int32),
        ("disparity", np.float32),
        ("x_m", np.float32),
        ("y_m", np.float32),
        ("top_m", np.float32),
        ("bottom_m", np.float32),
    ]
)
"""A vertical run of pixels at one distance: column, first and last row of the levelled view (inclusive), pixels, cluster
(-1: none), disparity in px; distance, lateral offset, top and bottom in level_cam."""

SETTINGS = np.dtype(
    [
        ("sigma_d_px", np.float64),
        ("f_px", np.float64),
        ("horizon_row", np.float64),
        ("lsb_per_px", np.float64),
        ("ke_per_m", np.float64),
        ("peak_alpha", np.float64),
        ("peak_valley", np.float64),
        ("passable_height_m", np.float64),
        ("segment_height_m", np.float64),
        ("majority", np.float64),
        ("correlation", np.float64),
        ("centre_px", np.float64),
        ("window_min_px", np.int64),
        ("members", np.int64),
        ("gap_px", np.int64),
        ("horizontal_min_px", np.int64),
    ]
)
"""What the kernels read of the parameters and the view."""


def settings_of(view: ViewGeometry, ke_per_m: float, sigma_d_px: float, p: PaperParams) -> NDArray[np.void]:
    """(1,) of SETTINGS for a view and its noise."""
    values = (
        sigma_d_px,
        view.f_px,
        view.cv,
        view.lsb_per_px,
        ke_per_m,
        p.peak_alpha,
        p.peak_valley,
        p.passable_height_m,
        p.segment_height_m,
        p.window_majority,
        p.horizontal_correlation,
        p.horizontal_centre_px,
        p.window_min_px,
        p.window_members,
        p.irregular_gap_px,
        p.horizontal_min_px,
    )
    return np.array([values], SETTINGS)


def strips_paper(codes: NDArray[np.uint16], settings: NDArray[np.void], bins: BinTable) -> NDArray[np.void]:
    """(N,) of STRIP without places and clusters, by column, top row and disparity from near to far.

    codes: (cols, rows) uint16 quantised disparity of the levelled view."""
    strips = np.empty(codes.size, STRIP)
    found = _search(codes, settings, bins, strips)
    strips = strips[:found]
    return strips[np.lexsort((-strips["disparity"], strips["top"], strips["u"]))]


@njit(cache=True, nogil=True)
def _search(codes: Any, settings: Any, bins: Any, strips: Any) -> Any:
    """All strips of a view, column by column; returns their number."""
    p, bin_px, bin_width_px, weights = settings[0], bins.disparity_px, bins.width_px, bins.weights
    cols, rows = codes.shape
    n_bins, half = bin_px.shape[0], weights.shape[0] // 2
    whole = (rows + 7) // 8 * 8
    mask, mark = np.zeros(whole, np.uint8), np.full(whole, CLOSED, np.uint8)
    px = np.zeros((2, rows + 8), np.int32)
    hist, counts = np.zeros(n_bins + 2 * half, np.int32), np.zeros(n_bins, np.int32)
    low, high, top = np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32)
    found = 0
    for u in range(cols):
        line = codes[u]
        for v in range(rows):
            mask[v] = line[v] > 1
        n = gather_rows(line, mask, px)
        if n == 0:
            continue
        first_row, last_row = px[ROW, 0], px[ROW, n - 1]
        begin, end = soft_counts(px, n, bins, hist, counts)
        of_column = Peaks(low, high, top)
        peaks = find_peaks(counts, bins.threshold, begin, end, p, of_column)
        open_mask, open_marks = mask[first_row : last_row + 1], mark[first_row : last_row + 1]
        label_rows(line[first_row : last_row + 1], open_mask, of_column, peaks, bins.first_code, open_marks)
        for k in range(peaks):
            spread = bin_px[high[k]] - bin_px[low[k]] + bin_width_px[top[k]]
            kernel = 2.0 * p.peak_alpha * weights.shape[0] * bin_width_px[top[k]]
            # as printed: ke * (C f / x)^2, metres, added to a disparity
            metres = p.ke_per_m * (p.f_px / bin_px[top[k]]) ** 2
            rough = spread > p.sigma_d_px + kernel + (metres - p.sigma_d_px)
            low_code = (bin_px[low[k]] - 0.5 * bin_width_px[low[k]]) * p.lsb_per_px
            high_code = (bin_px[high[k]] + 0.5 * bin_width_px[high[k]]) * p.lsb_per_px
            a, b = _windows(line, mark, first_row, last_row, k, bin_px[top[k]], low_code, high_code, p)
            if a <= b:
                found = _emit(line, mark, a, b, rough, u, p.lsb_per_px, strips, found)
                for v in range(a, b + 1):
                    mark[v] = TAKEN if mark[v] <= NO_PEAK else mark[v]
        if peaks > 0:
            mask_remaining_rows(open_marks, open_mask)
            n = gather_rows(line, mask, px)
        found = _rest(line, mark, px, n, u, p, strips, found)
    return found


@njit(cache=True, nogil=True)
def _windows(
    line: Any, mark: Any, first: Any, last: Any, label: Any, d: Any, low_code: Any, high_code: Any, p: Any
) -> Any:
    """(first, last) row of the first run of accepted windows of one peak; first > last: none.

    A window is accepted when most of its rows belong to the peak and their mean lies in the interval (Eq. 7, 8)."""
    first, last = ends_of(mark, label, first, last)
    if first > last:
        return first, last
    z = p.f_px / d
    z_near = max(0.5 * z, z - p.ke_per_m * z * z)
    length = min(max(p.passable_height_m * p.f_px / z_near, p.window_min_px), line.shape[0])
    half = max(1, int(length / 2.0 + 0.5))
    need = min(p.window_min_px, p.members)
    count = (last - first) // half + 1
    run = -1
    for j in range(count):
        begin, end = first + j * half, min(last + 1, first + (j + 2) * half)
        members, valid, total = 0, 0, 0
        for v in range(begin, end):
            if mark[v] <= NO_PEAK:
                valid += 1
                total += line[v]
            if mark[v] == label:
                members += 1
        size = (min(j + 2, count) - j) * half
        good = members >= need and members > p.majority * size and low_code * valid <= total <= high_code * valid
        if good and run < 0:
            run = j
        if run >= 0 and (not good or j == count - 1):
            return ends_of(mark, label, first + run * half, min(last, begin + half - 1))
    return 1, 0


@njit(cache=True, nogil=True)
def _emit(line: Any, mark: Any, top: Any, bottom: Any, rough: Any, u: Any, lsb_per_px: Any, strips: Any, n: Any) -> Any:
    """Eq. 9 as printed: the mean or the one-pixel maximum over all measured pixels between both ends."""
    count, total, most = 0, np.int64(0), np.int64(0)
    for v in range(top, bottom + 1):
        if mark[v] <= NO_PEAK or mark[v] == TAKEN:
            total += line[v]
            most = max(most, np.int64(line[v]))
            count += 1
    if count == 0:
        return n
    strip = strips[n]
    strip.u, strip.top, strip.bottom, strip.support, strip.cluster = u, top, bottom, count, -1
    strip.disparity = (most if rough else total / count) / lsb_per_px
    return n + 1


@njit(cache=True, nogil=True)
def _rest(line: Any, mark: Any, px: Any, n: Any, u: Any, p: Any, strips: Any, found: Any) -> Any:
    """Section 4.3: what no window took, in segments that end at a gap or when they are Hd tall at their nearest pixel."""
    if n == 0:
        return found
    first, most = 0, px[CODE, 0] / p.lsb_per_px
    for i in range(1, n):
        d = px[CODE, i] / p.lsb_per_px
        tall = px[ROW, i] - px[ROW, first] + 1
        if px[ROW, i] - px[ROW, i - 1] > p.gap_px or tall > p.segment_height_m * most:
            found = _close(line, mark, px, first, i, u, p, strips, found)
            first, most = i, d
        most = max(most, d)
    return _close(line, mark, px, first, n, u, p, strips, found)


@njit(cache=True, nogil=True)
def _close(line: Any, mark: Any, px: Any, first: Any, last: Any, u: Any, p: Any, strips: Any, found: Any) -> Any:
    """Ends one segment of the rest: a strip, unless the segment is a horizontal surface."""
    if last - first >= p.horizontal_min_px and _is_horizontal(px, first, last, p):
        return found
    return _emit(line, mark, px[ROW, first], px[ROW, last - 1], True, u, p.lsb_per_px, strips, found)


@njit(cache=True, nogil=True)
def _is_horizontal(px: Any, first: Any, last: Any, p: Any) -> Any:
    """Eq. 12-14: do disparity and row of the pixels first..last - 1 correlate, and does their line meet the horizon?"""
    n = last - first
    sd, sv, sdd, svv, sdv = np.int64(0), np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for i in range(first, last):
        d, v = np.int64(px[CODE, i]), np.int64(px[ROW, i])
        sd, sv, sdd, svv, sdv = sd + d, sv + v, sdd + d * d, svv + v * v, sdv + d * v
    var_d, var_v, cov = n * sdd - sd * sd, n * svv - sv * sv, n * sdv - sd * sv
    if var_d <= 0 or var_v <= 0:
        return False
    r = cov / (math.sqrt(var_d) * math.sqrt(var_v))
    centre = (1.0 * sv * sdd - 1.0 * sd * sdv) / var_d
    return 1.0 - abs(r) < p.correlation and abs(centre - p.horizon_row) < p.centre_px

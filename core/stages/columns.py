"""Strips of a levelled view, column by column (Sections 4.1-4.3): density, peaks, windows and the irregular rest.

Input: quantised disparity and the threshold of the ground. Output: the table of strips, in the order of columns."""

from __future__ import annotations

import numpy as np

from ..jit import inner_inline, kernel
from .density import LANES, MAX_PEAKS, count_bins, peaks_of_column, soft_counts
from .irregular import irregular_rest
from .row_mask import (
    CLOSED,
    ROW,
    gather_rows,
    label_rows,
    limit_rises,
    mask_open_rows,
    mask_remaining_rows,
    tile_columns,
    tile_limits,
)
from .strips import COUNTS, Column, StripOutput
from .view_geometry import homography_area
from .windows import Peak, WindowBuffers, slide_windows

_ROUGH_FACTOR = 1.2
"""A peak wider than this times e(x) is rough."""


@kernel
def extract_strips(codes, ground, view, bins, settings, strips):
    """Extracts all strips of a levelled view; returns (strips, ground cells, strips merged because their column was
    full).

    Args:
        codes: (cols, rows) uint16 quantised disparity.
        ground: GroundThreshold.
        view: ViewGeometry.
        bins: BinTable.
        settings: (1,) STRIP_SETTINGS.
        strips: (N,) STRIP out, with room for max_column_strips per column."""
    p = settings[0]
    cols, rows = codes.shape
    n_bins, half = bins.disparity_px.shape[0], bins.weights.shape[0] // 2
    whole = (rows + 7) // 8 * 8
    mask, undecided, label = np.zeros(whole, np.uint8), np.zeros(whole, np.uint8), np.full(whole, CLOSED, np.uint8)
    below, above = np.zeros(rows, np.uint16), np.zeros(rows, np.uint16)
    measured = np.zeros(rows, np.uint16)
    px = np.zeros((2, rows + 8), np.int32)
    lanes = np.zeros((LANES, n_bins), np.int32)
    hist, counts = np.zeros(n_bins + 2 * half, np.int32), np.zeros(n_bins, np.int32)
    low, high, top = np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32)
    sums_open, sums_own, own_codes = (
        np.zeros(rows + 1, np.int64),
        np.zeros(rows + 1, np.int64),
        np.zeros(rows, np.int32),
    )
    parts = np.zeros((3, rows // p.band_rows + 2), np.int64)
    buffers = WindowBuffers(sums_open, sums_own, own_codes, parts)
    counted = np.zeros(1, COUNTS)
    found = counted[0]
    out = StripOutput(strips, found)
    H = view.H
    limit, shift, tan_mid, threshold = ground.limit, ground.shift, view.tan_mid, bins.threshold
    area = homography_area(H)
    rises = limit_rises(limit)
    tile = tile_columns(tan_mid, shift)
    limited, between = -1, False
    opened = np.int64(0)
    for u in range(cols):
        if u // tile != limited:
            limited = u // tile
            shifts = shift[limited * tile : (limited + 1) * tile]
            between = tile_limits(limit, rises, tan_mid, shifts, below, above)
        line = codes[u]
        mask_open_rows(line, limit, shift[u], tan_mid, below, above, between, mask, undecided, measured)
        n = gather_rows(line, mask, px)
        if n == 0:
            continue
        opened += n
        top_row, bottom_row = px[ROW, 0], px[ROW, n - 1]
        found.in_columns_before = found.strips
        first, last = count_bins(px, n, bins.bin_of_code, lanes)
        begin, end = soft_counts(lanes, first, last, bins.weights, hist, counts)
        peaks = peaks_of_column(counts, begin, end, threshold, p.peak_valley, p.peak_alpha, low, high, top)
        column = Column(u, line, label, H, area)
        if peaks > 0:
            label_rows(line, mask, top_row, bottom_row, peaks, low, high, bins.first_code, label)
        for k in range(peaks):
            peak = peak_of(k, low[k], high[k], top[k], bins, p)
            slide_windows(column, peak, top_row, bottom_row, p, buffers, out)
        if peaks > 0:
            mask_remaining_rows(label, top_row, bottom_row, mask)
            n = gather_rows(line, mask, px)
        irregular_rest(px, n, column, p, out)
    return found.strips, np.int64(measured.sum()) - opened, found.merged


@inner_inline
def peak_of(label, low, high, top, bins, settings):
    """Returns the Peak with this label that covers the bins low..high and has its greatest count in bin `top`.

    It is rough if its width exceeds the noise e(x) of Eq. 9, sigma_d + 2 alpha h, by _ROUGH_FACTOR."""
    bin_px, width_px = bins.disparity_px, bins.width_px
    spread = bin_px[high] - bin_px[low] + width_px[top]
    noise = settings.sigma_d_px + 2.0 * settings.peak_alpha * bins.weights.shape[0] * width_px[top]
    low_code = (bin_px[low] - 0.5 * width_px[low]) * settings.lsb_per_px
    high_code = (bin_px[high] + 0.5 * width_px[high]) * settings.lsb_per_px
    return Peak(label, bin_px[top], low_code, high_code, spread > _ROUGH_FACTOR * noise)

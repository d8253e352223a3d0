"""Strips of a levelled view, column by column (Sections 4.1-4.3): density, peaks, windows and the irregular rest.

Input: quantised disparity and the threshold of the ground. Output: the table of strips, in the order of columns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner_inline, kernel
from .density import MAX_PEAKS, Peaks, find_peaks, soft_counts
from .irregular import irregular_rest
from .row_mask import (
    CLOSED,
    ROW,
    gather_rows,
    label_rows,
    mask_open_rows,
    mask_remaining_rows,
)
from .strips import COUNTS, Column, StripOutput
from .view_geometry import homography_area
from .windows import Peak, WindowBuffers, slide_windows

_ROUGH_FACTOR = 1.2
"""A peak wider than this times e(x) is rough."""


class ColumnBuffers(NamedTuple):
    """Scratch memory of `extract_strips` for columns of V rows and B bins of disparity."""

    mask: Any  # (V rounded up to 8,) uint8, the open rows, see `mask_open_rows`
    label: Any  # (V rounded up to 8,) uint8, labels of row_mask.py
    px: Any  # (2, V + 8) int32, list of pixels, see row_mask.py
    hist: Any  # (B + 2 + 2 half,) int32, see `soft_counts`
    counts: Any  # (B + 2,) int32, soft counts
    peaks: Any  # Peaks
    windows: Any  # WindowBuffers


@kernel
def column_buffers(rows, bins, settings):
    """Allocates ColumnBuffers for columns of so many rows. bins: BinTable; settings: a record of VIEW_SETTINGS."""
    n_bins, half, whole = bins.disparity_px.shape[0], bins.weights.shape[0] // 2, (rows + 7) // 8 * 8
    low, high, top = np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32)
    sums_open, sums_own, codes = np.zeros(rows + 1, np.int64), np.zeros(rows + 1, np.int64), np.zeros(rows, np.int32)
    return ColumnBuffers(
        np.zeros(whole, np.uint8),
        np.full(whole, CLOSED, np.uint8),
        np.zeros((2, rows + 8), np.int32),
        np.zeros(n_bins + 2 * half, np.int32),
        np.zeros(n_bins, np.int32),
        Peaks(low, high, top),
        WindowBuffers(sums_open, sums_own, codes, np.zeros((3, rows // settings.band_rows + 2), np.int64)),
    )


@kernel
def extract_strips(codes, ground, view, bins, settings, strips):
    """Extracts all strips of a levelled view; returns (strips, ground cells, strips merged because their column was
    full).

    strips: (N,) STRIP out, with room for max_column_strips per column."""
    p, counted = settings[0], np.zeros(1, COUNTS)
    cols, rows = codes.shape
    out, b = StripOutput(strips, counted[0]), column_buffers(rows, bins, p)
    area, measured, opened = homography_area(view.H), 0, 0
    for u in range(cols):
        line = codes[u]
        measured += mask_open_rows(line, ground, ground.shift[u], view.tan_mid, b.mask)
        n = gather_rows(line, b.mask, b.px)
        if n > 0:
            opened += n
            out.counts.in_columns_before = out.counts.strips
            strips_of_column(Column(u, line, b.label, view.H, area), n, bins, p, b, out)
    return out.counts.strips, measured - opened, out.counts.merged


@inner_inline
def strips_of_column(column, n, bins, settings, buffers, out):
    """Extracts the strips of one column: first those of its peaks, from near to far, then those of the rest.

    n: number of its open pixels, at least 1; buffers: ColumnBuffers with the open pixels in mask and px."""
    line, label, mask, px, peaks = column.line, column.label, buffers.mask, buffers.px, buffers.peaks
    first, last = px[ROW, 0], px[ROW, n - 1]
    begin, end = soft_counts(px, n, bins, buffers.hist, buffers.counts)
    found = find_peaks(buffers.counts, bins.threshold, begin, end, settings, peaks)
    if found > 0:
        open_mask, open_labels = mask[first : last + 1], label[first : last + 1]
        label_rows(line[first : last + 1], open_mask, peaks, found, bins.first_code, open_labels)
        for k in range(found):
            peak = peak_of(k, peaks.low[k], peaks.high[k], peaks.top[k], bins, settings)
            slide_windows(column, peak, first, last, settings, buffers.windows, out)
        mask_remaining_rows(open_labels, open_mask)
        n = gather_rows(line, mask, px)
    irregular_rest(px, n, column, settings, out)


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

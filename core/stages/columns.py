"""Sections 4.1-4.3 for a whole levelled view: column by column density, peaks, windows, and the irregular rest."""

from __future__ import annotations

import numpy as np

from ..jit import inner_inline, kernel
from .density import LANES, MAX_PEAKS, count_bins, peaks_of_column, soft_counts
from .irregular import irregular_rest
from .row_mask import CLOSED, ROW, free_rows, gate_rises, gather_rows, mark_rows, open_rows, tile_columns, tile_limits
from .strips import (
    FIRST,
    I_BAND_ROWS,
    OVERFLOW,
    S_ALPHA,
    S_QUANTUM,
    S_ROUGH,
    S_SIGMA_D,
    S_VALLEY,
    N,
    homography_area,
    slide_windows,
)


@kernel
def extract_strips(
    codes, gate, shift, tan_mid, H, bin_of_code, bin_px, bin_width_px, threshold, weights, first_code, fs, si, ints,
    floats,
):  # fmt: skip
    """All strips of a levelled view, column by column: (their number, ground pixels, strips merged for want of room).

    codes: (cols, rows) uint16. gate, shift: see `ground_gate`; shift: (cols,) float32. tan_mid: (rows,) float32.
    The bin arrays: BinTable. fs, si: settings by the S_ and I_ indices. ints, floats: outputs, with room for I_ROOM
    strips of each column."""
    cols, rows = codes.shape
    n_bins, half = bin_px.shape[0], weights.shape[0] // 2
    whole = (rows + 7) // 8 * 8
    mask, doubt, mark = np.zeros(whole, np.uint8), np.zeros(whole, np.uint8), np.full(whole, CLOSED, np.uint8)
    below, above = np.zeros(rows, np.uint16), np.zeros(rows, np.uint16)
    measured = np.zeros(rows, np.uint16)
    px = np.zeros((2, rows + 8), np.int32)
    lanes = np.zeros((LANES, n_bins), np.int32)
    hist, counts = np.zeros(n_bins + 2 * half, np.int32), np.zeros(n_bins, np.int32)
    low, high, top = np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32)
    seen, own, best = np.zeros(rows + 1, np.int64), np.zeros(rows + 1, np.int64), np.zeros((2, rows), np.int32)
    parts = np.zeros((3, rows // si[I_BAND_ROWS] + 2), np.int64)
    tally = np.zeros(3, np.int64)
    area = homography_area(H)
    rises = gate_rises(gate)
    tile = tile_columns(tan_mid, shift)
    limited, between = -1, False
    opened = np.int64(0)
    for u in range(cols):
        if u // tile != limited:
            limited = u // tile
            shifts = shift[limited * tile : (limited + 1) * tile]
            between = tile_limits(gate, rises, tan_mid, shifts, below, above)
        line = codes[u]
        open_rows(line, gate, shift[u], tan_mid, below, above, between, mask, doubt, measured)
        n = gather_rows(line, mask, px)
        if n == 0:
            continue
        opened += n
        top_row, bottom_row = px[ROW, 0], px[ROW, n - 1]
        tally[FIRST] = tally[N]
        first, last = count_bins(px, n, bin_of_code, lanes)
        begin, end = soft_counts(lanes, first, last, weights, hist, counts)
        peaks = peaks_of_column(counts, begin, end, threshold, fs[S_VALLEY], fs[S_ALPHA], low, high, top)
        if peaks > 0:
            mark_rows(line, mask, top_row, bottom_row, peaks, low, high, first_code, mark)
        for p in range(peaks):
            d, low_code, high_code, rough = peak_range(low[p], high[p], top[p], bin_px, bin_width_px, weights, fs)
            slide_windows(
                line, mark, top_row, bottom_row, p, d, low_code, high_code, rough, u, H, area, fs, si, seen, own, best,
                parts, ints, floats, tally,
            )  # fmt: skip
        if peaks > 0:
            free_rows(mark, top_row, bottom_row, mask)
            n = gather_rows(line, mask, px)
        irregular_rest(px, n, u, H, area, fs, si, best, ints, floats, tally)
    return tally[N], np.int64(measured.sum()) - opened, tally[OVERFLOW]


@inner_inline
def peak_range(low, high, top, bin_px, bin_width_px, weights, fs):
    """(disparity of a peak, px, the codes it reaches from and to, whether it is rough: wider than noise and kernel)."""
    spread = bin_px[high] - bin_px[low] + bin_width_px[top]
    e = fs[S_SIGMA_D] + 2.0 * fs[S_ALPHA] * weights.shape[0] * bin_width_px[top]
    low_code = (bin_px[low] - 0.5 * bin_width_px[low]) * fs[S_QUANTUM]
    high_code = (bin_px[high] + 0.5 * bin_width_px[high]) * fs[S_QUANTUM]
    return bin_px[top], low_code, high_code, spread > fs[S_ROUGH] * e

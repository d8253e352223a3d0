"""Sections 4.1-4.3 for a whole levelled view: column by column density, peaks, windows, and the irregular rest."""

from __future__ import annotations

import numpy as np
from numba import njit

from .density import MAX_PEAKS, NO_PEAK, find_peaks, soft_counts
from .irregular import irregular_rest
from .strips import (
    I_PAPER,
    S_ALPHA,
    S_F,
    S_KE,
    S_QUANTUM,
    S_ROUGH,
    S_SIGMA_D,
    S_VALLEY,
    histogram,
    slide_windows,
)


@njit(cache=True, nogil=True)
def extract_strips(
    codes, gate, shift, tan_mid, H, bin_of_code, bin_px, bin_width_px, threshold, weights, fs, si,
    ints, floats, states, ground_px,
):  # fmt: skip
    """All strips of a levelled view, column by column; returns their number.

    codes: (cols, rows) uint16. gate, shift: see `histogram`; shift: (cols,) float32. tan_mid: (rows,) float32.
    The bin arrays: BinTable. fs, si: settings by the S_ and I_ indices. ints, floats: outputs. states: (cols, rows)
    uint8 out."""
    cols, rows = codes.shape
    n_bins = bin_px.shape[0]
    hist = np.zeros(n_bins, np.int32)
    counts = np.zeros(n_bins, np.int32)
    bins = np.zeros(rows, np.uint16)
    member = np.zeros(rows, np.uint8)
    peak_of_bin = np.zeros(n_bins, np.uint8)
    low, high, top = np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32), np.zeros(MAX_PEAKS, np.int32)
    scratch = np.zeros(rows, np.float32)
    blocks = np.zeros((3, rows + 2), np.int64)
    cuts = np.zeros(rows + 1, np.int32)
    n = 0
    for u in range(cols):
        line, state = codes[u], states[u]
        ground_px[u] = histogram(line, gate, shift[u], tan_mid, bin_of_code, bins, state, hist)
        soft_counts(hist, weights, counts)
        peaks = find_peaks(counts, threshold, fs[S_VALLEY], fs[S_ALPHA], low, high, top)
        peak_of_bin[:] = NO_PEAK
        for p in range(peaks):
            peak_of_bin[low[p] : high[p] + 1] = p
        for v in range(rows):
            member[v] = peak_of_bin[bins[v]] if bins[v] > 0 else NO_PEAK
        for p in range(peaks):
            x = top[p]
            spread = bin_px[high[p]] - bin_px[low[p]] + bin_width_px[x]
            e = fs[S_SIGMA_D] + 2.0 * fs[S_ALPHA] * weights.shape[0] * bin_width_px[x]
            if si[I_PAPER] == 1:
                # as printed: ke*(C f/x)^2, metres, added to a disparity
                e += fs[S_KE] * (fs[S_F] / bin_px[x]) ** 2 - fs[S_SIGMA_D]
            rough = spread > fs[S_ROUGH] * e
            low_code = (bin_px[low[p]] - 0.5 * bin_width_px[low[p]]) * fs[S_QUANTUM]
            high_code = (bin_px[high[p]] + 0.5 * bin_width_px[high[p]]) * fs[S_QUANTUM]
            n = slide_windows(
                line, state, member, p, bin_px[x], low_code, high_code, rough, u, H, fs, si, scratch, blocks, cuts,
                ints, floats, n,
            )  # fmt: skip
        n = irregular_rest(line, state, member, u, H, fs, si, scratch, ints, floats, n)
    return n

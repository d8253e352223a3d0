"""Density of the disparity of a column and its peaks (Section 4.1, Eq. 4-6).

Input: the pixels of a column. Output: intervals of disparity bins, one for each peak that exceeds the threshold of
Eq. 6.

The density is a histogram smoothed by the Gaussian kernel: the soft count of a bin is sum K((x - D)/h) / K(0), in
1/64 of a pixel. It is compared with the number of pixels that an obstacle of the least height fills, Hm x / C. Bins
are uniform in disparity, as stereo noise is, until they would be thinner than bin_depth_m; nearer than that they are
uniform in depth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner_inline, kernel_ieee
from ..params import Params
from .row_mask import CODE

ONE_PX = 64
"""Soft count of one pixel."""
MAX_PEAKS = 24
"""Greatest number of peaks of a column. Pixels of further peaks are left to the irregular rest."""
_MAX_BINS = 4096
"""Greatest number of bins. Bins that are too fine are widened; those uniform in disparity use three quarters of the
table."""


class BinTable(NamedTuple):
    """Bins of disparity for one focal length and noise level, indexed from 1; bin 0: no measurement."""

    bin_of_code: NDArray[np.uint16]  # (65536,), the bin of a code of the levelled view
    disparity_px: NDArray[np.float32]  # (B + 2,), centre of a bin, increasing
    width_px: NDArray[np.float32]  # (B + 2,), width of a bin
    threshold: NDArray[np.int32]  # (B + 2,), least soft count of a peak in 1/ONE_PX px (Eq. 6).
    weights: NDArray[np.int32]  # (2 kernel_half_bins + 1,), the kernel of Eq. 5.
    first_code: NDArray[np.int32]  # (B + 3,), the least code that falls into a bin or a greater one


class Peaks(NamedTuple):
    """Peaks of the density of a column, from near to far, as bins."""

    low: NDArray[np.int32]  # (MAX_PEAKS,), first bin of the interval of a peak
    high: NDArray[np.int32]  # (MAX_PEAKS,), last bin of the interval
    top: NDArray[np.int32]  # (MAX_PEAKS,), bin of the greatest count


def bin_table(f_px: float, lsb_per_px: float, sigma_d_px: float, params: Params) -> BinTable:
    """Returns the bins for one focal length and noise level.

    Their width is sigma_d / bin_per_sigma up to the disparity at which that is bin_depth_m deep, then uniform in
    depth."""
    uniform = sigma_d_px / params.bin_per_sigma
    top = 65535.0 / lsb_per_px
    depth = params.bin_depth_m
    knee = math.sqrt(uniform * f_px / depth) if depth > 0.0 else top
    uniform = max(uniform, min(knee, top) / (0.75 * _MAX_BINS))
    bins = bins_of_codes(lsb_per_px, uniform, knee, f_px / depth if depth > 0.0 else 0.0)
    count = int(bins[-1])
    edges = np.arange(count + 2, dtype=np.float64) - 0.5  # centre of bin b (from 1) stands at position b - 0.5
    knee_at = knee / uniform
    inverse = 1.0 / knee - (edges - knee_at) * (depth / f_px)
    centre = np.where(edges <= knee_at, edges * uniform, 1.0 / np.maximum(inverse, 1.0 / top))
    centre[0] = 0.0
    width = np.maximum(uniform, centre * centre * depth / f_px)
    taps = np.arange(-params.kernel_half_bins, params.kernel_half_bins + 1)
    weights = np.rint(ONE_PX * np.exp(-0.5 * (taps / params.kernel_sigma_bins) ** 2)).astype(np.int32)
    threshold = np.maximum(params.density_share * params.min_obstacle_height_m * centre, params.density_min_px)
    return BinTable(
        bin_of_code=bins,
        disparity_px=centre.astype(np.float32),
        width_px=width.astype(np.float32),
        threshold=np.minimum(ONE_PX * threshold, 2.0**30).astype(np.int32),
        weights=weights,
        first_code=np.searchsorted(bins, np.arange(count + 3)).astype(np.int32),
    )


@kernel_ieee
def bins_of_codes(lsb_per_px, uniform_px, knee_px, f_per_depth):
    """Returns bin_of_code of BinTable: bins are uniform_px wide up to a disparity of knee_px, and uniform in depth
    beyond it, f_per_depth / disparity bins."""
    bins = np.empty(65536, np.uint16)
    for code in range(65536):
        px = np.int32(code) / lsb_per_px
        beyond = knee_px / uniform_px + f_per_depth * (1.0 / knee_px - 1.0 / px)
        position = px / uniform_px if px <= knee_px else beyond
        bins[code] = np.int32(min(position, _MAX_BINS - 2.0)) + 1
    bins[:2] = 0  # unknown, far
    return bins


@inner_inline
def soft_counts(px, n, bins, hist, counts):
    """Computes the soft count of each bin from the first n pixels of px (Eq. 4).

    counts[b] is the sum over k of weights[k] times the number of pixels in bin b + k - half.

    Args:
        px: (2, V) int32 of `gather_rows`.
        n: number of pixels, at least 1.
        bins: BinTable with B bins and 2 half + 1 weights.
        hist: (B + 2 + 2 half,) int32 scratch, zero before and after. The number of pixels in bin b is hist[b + half].
        counts: (B + 2,) int32 out, valid in the returned range.

    Returns:
        The least and the greatest bin that the kernel reaches."""
    half = bins.weights.shape[0] // 2
    least, most = px[CODE, 0], px[CODE, 0]
    for i in range(n):
        code = px[CODE, i]
        hist[half + bins.bin_of_code[code]] += 1
        least, most = min(least, code), max(most, code)
    first, last = np.int64(bins.bin_of_code[least]), np.int64(bins.bin_of_code[most])
    begin, end = max(0, first - half), min(counts.shape[0] - 1, last + half)
    convolve(hist[begin:], bins.weights, counts[begin : end + 1])
    hist[first + half : last + half + 1] = 0
    return begin, end


@inner_inline
def convolve(hist, weights, out):
    """Computes out[i], the sum over k of weights[k] hist[i + k]. weights: (2 half + 1,) int32, symmetric."""
    half = weights.shape[0] // 2
    if half == 3:  # the default kernel in one pass, which saves 3 % of a frame
        w0, w1, w2, w3 = weights[3], weights[4], weights[5], weights[6]
        for i in range(len(out)):
            one, two, three = hist[i + 2] + hist[i + 4], hist[i + 1] + hist[i + 5], hist[i] + hist[i + 6]
            out[i] = w0 * hist[i + 3] + w1 * one + w2 * two + w3 * three
        return
    out[:] = 0
    for k in range(len(weights)):
        for i in range(len(out)):
            out[i] += weights[k] * hist[i + k]


@inner_inline
def find_peaks(counts, threshold, first, last, settings, peaks):
    """Finds the peaks of counts[first..last] over their threshold, from near (high bins) to far; returns their number.

    The interval of a peak is where the count stays at or above peak_alpha times the peak, but never past the valley to
    the next peak. A valley above peak_valley times the smaller of two peaks does not separate them. A plateau is one
    peak. Beyond MAX_PEAKS the farthest are left to the irregular rest, which uses every remaining pixel.

    Args:
        counts: (B + 2,) int32 of `soft_counts`.
        threshold: of BinTable.
        first, last: range of bins.
        settings: a record with peak_alpha, the paper's alpha, and peak_valley.
        peaks: Peaks, out."""
    found = 0
    start = last
    best, best_at = 0, last
    valley, valley_at = 0, last
    for i in range(last - first + 1):
        b = last - i
        c = counts[b]
        if c == 0 and valley == 0 and b > first:  # empty, as the bin before
            continue
        if c > best and valley >= settings.peak_valley * best:
            best, best_at = c, b
            valley, valley_at = c, b
        elif c < valley:
            valley, valley_at = c, b
        if b == first or (valley < settings.peak_valley * best and valley < settings.peak_valley * c):
            if best >= threshold[best_at] and best > 0 and found < MAX_PEAKS:
                end = first if b == first else valley_at
                low, high = peak_interval(counts, best_at, end, start, settings.peak_alpha * best)
                peaks.low[found], peaks.high[found], peaks.top[found] = low, high, best_at
                found += 1
            start = valley_at - 1
            best, best_at = c, b
            valley, valley_at = c, b
    return found


@inner_inline
def peak_interval(counts, top, first, last, least):
    """Returns the first and last bin around `top`, within first..last, up to which all counts are at least `least`."""
    low, high = top, top
    for b in range(top + 1, last + 1):
        if counts[b] < least:
            break
        high = b
    for k in range(top - first):
        if counts[top - 1 - k] < least:
            break
        low = top - 1 - k
    return low, high

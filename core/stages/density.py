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
LANES = 4
"""Number of histograms that are used in turns: consecutive rows of a wall fall into one bin, and each addition would
wait for the one before."""
_MAX_BINS = 4096
"""Greatest number of bins. Bins that are too fine are widened; those uniform in disparity use three quarters of the
table."""


class BinTable(NamedTuple):
    """Bins of disparity for one focal length and noise level, indexed from 1; bin 0: no measurement.

    Attributes:
        bin_of_code: (65536,) uint16, the bin of a code of the levelled view.
        disparity_px: (B + 2,) float32, centre of a bin, increasing.
        width_px: (B + 2,) float32, width of a bin.
        threshold: (B + 2,) int32, least soft count of a peak in 1/ONE_PX px (Eq. 6).
        weights: (2 kernel_half_bins + 1,) int32, the kernel of Eq. 5.
        first_code: (B + 3,) int32, the least code that falls into a bin or a greater one."""

    bin_of_code: NDArray[np.uint16]
    disparity_px: NDArray[np.float32]
    width_px: NDArray[np.float32]
    threshold: NDArray[np.int32]
    weights: NDArray[np.int32]
    first_code: NDArray[np.int32]


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
def count_bins(px, n, bin_of_code, lanes):
    """Counts the first n pixels of px by bin; returns the least and the greatest bin with any.

    Args:
        px: (2, V) int32 of `gather_rows`.
        n: number of pixels, at least 1.
        bin_of_code: of BinTable.
        lanes: (LANES, B + 2) int32, zero before. The count of a bin is the sum over the lanes."""
    for i in range(n):
        b = bin_of_code[np.uint32(px[CODE, i])]  # an unsigned index needs no test for negative values
        lanes[i & (LANES - 1), b] += 1
    least, most = px[CODE, 0], px[CODE, 0]
    for i in range(n):
        least, most = min(least, px[CODE, i]), max(most, px[CODE, i])
    return np.int64(bin_of_code[least]), np.int64(bin_of_code[most])


@inner_inline
def soft_counts(lanes, first, last, weights, hist, counts):
    """Computes counts[b] = sum_k weights[k] hist[b + k - half] for the bins first..last and those within the kernel
    (Eq. 4).

    Args:
        lanes: (LANES, B + 2) int32 of `count_bins`, zero afterwards.
        first, last: least and greatest bin with pixels.
        weights: (2 half + 1,) int32, symmetric.
        hist: (B + 2 + 2 half,) int32 scratch, zero before and after.
        counts: (B + 2,) int32 out, valid in the returned range.

    Returns:
        The least and greatest bin that the kernel reaches, and one empty bin before them."""
    half = weights.shape[0] // 2
    begin, end = max(0, first - half - 1), min(counts.shape[0] - 1, last + half)
    h = np.uint64(half)  # unsigned indices, so that the loops below are vectorised
    for b in range(np.uint64(first), np.uint64(last + 1)):
        hist[b + h] = lanes[0, b] + lanes[1, b] + lanes[2, b] + lanes[3, b]
        lanes[0, b], lanes[1, b], lanes[2, b], lanes[3, b] = 0, 0, 0, 0
    u_begin, u_end = np.uint64(begin), np.uint64(end + 1)
    if half == 3:  # the default kernel, in one pass
        w0, w1, w2, w3 = weights[3], weights[4], weights[5], weights[6]
        for b in range(u_begin, u_end):
            at = b + h
            one, two = (
                hist[at - np.uint64(1)] + hist[at + np.uint64(1)],
                hist[at - np.uint64(2)] + hist[at + np.uint64(2)],
            )
            counts[b] = w0 * hist[at] + w1 * one + w2 * two + w3 * (hist[b] + hist[at + h])
    else:
        for b in range(u_begin, u_end):
            counts[b] = weights[half] * hist[b + h]
        for k in range(1, half + 1):
            weight, left, right = weights[half + k], np.uint64(half - k), np.uint64(half + k)
            for b in range(u_begin, u_end):
                counts[b] += weight * (hist[b + left] + hist[b + right])
    for b in range(np.uint64(first + half), np.uint64(last + half + 1)):
        hist[b] = 0
    return begin, end


@inner_inline
def peaks_of_column(counts, begin, end, threshold, valley_share, alpha, low, high, top):
    """Finds the peaks of counts[begin..end], from near to far, and returns their number.

    The result is that of `find_peaks` over all bins. Only ranges between empty bins that contain a bin over its
    threshold are searched. The arguments are those of `find_peaks`."""
    found = 0
    for _ in range(end - begin + 1):
        b = last_over(counts, threshold, begin, end)
        if b < 0 or found == MAX_PEAKS:
            break
        first, last = b, b
        for _a in range(end - b):
            if counts[last + 1] == 0:
                break
            last += 1
        for _a in range(b - begin):
            first -= 1
            if counts[first] == 0:
                break
        found = find_peaks(counts, threshold, first, last, valley_share, alpha, found, low, high, top)
        end = first - 1
    return found


@inner_inline
def last_over(counts, threshold, begin, end):
    """Returns the greatest bin of begin..end whose count is not zero and not below its threshold, or -1."""
    none = np.int32(-1)
    last = none
    for b in range(np.uint64(begin), np.uint64(end + 1)):
        over = (counts[b] >= threshold[b]) & (counts[b] > 0)
        last = max(last, np.int32(b) if over else none)
    return np.int64(last)


@inner_inline
def find_peaks(counts, threshold, first, last, valley_share, alpha, found, low, high, top):
    """Appends the peaks of counts[first..last] over their threshold, from near (high bins) to far; returns the number
    of peaks.

    The interval of a peak is where the count stays at or above alpha times the peak, but never past the valley to the
    next peak. A valley above valley_share of the smaller of two peaks does not separate them. A plateau is one peak.
    Beyond MAX_PEAKS the farthest are left to the irregular rest, which uses every remaining pixel.

    Args:
        counts: soft counts.
        threshold: of BinTable.
        first, last: range of bins.
        valley_share: see above.
        alpha: see above; the paper's alpha.
        found: number of peaks so far.
        low, high: (MAX_PEAKS,) int32 out, first and last bin of each peak.
        top: (MAX_PEAKS,) int32 out, bin of the greatest count."""
    start = last
    best, best_at = 0, last
    valley, valley_at = 0, last
    for i in range(last - first + 1):
        b = last - i
        c = counts[b]
        if c > best and valley >= valley_share * best:
            best, best_at = c, b
            valley, valley_at = c, b
        elif c < valley:
            valley, valley_at = c, b
        if b == first or (valley < valley_share * best and valley < valley_share * c):
            if best >= threshold[best_at] and best > 0 and found < MAX_PEAKS:
                end = first if b == first else valley_at
                low[found], high[found] = peak_interval(counts, best_at, end, start, alpha * best)
                top[found] = best_at
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

"""Section 4.1: how many pixels of a column lie near each disparity, and where that has its peaks.

Bins follow the noise, which stereo has constant in disparity; near the camera, where a bin would be thinner than any
obstacle is flat, they have a least depth instead. The soft count of a bin is sum K((x - D)/h)/K(0) with a Gaussian
over a few bins, in 1/64 of a pixel, to be compared with the pixels an obstacle of the least height fills: Hm * x / C.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner_inline
from ..params import Params
from .row_mask import CODE

ONE_PX = 64
"""Soft counts are in this fraction of a pixel: their resolution."""
MAX_PEAKS = 24
"""Room for the peaks of one column: what no peak takes, the irregular rest does."""
LANES = 4
"""Histograms that take turns: rows of one wall fall into one bin, and would wait for each other."""
_MAX_BINS = 4096
"""Room for the bins: finer ones than fit are widened. Three quarters are for those uniform in disparity."""


class BinTable(NamedTuple):
    """bin_of_code: (65536,) uint16, the bin of a code of the levelled view, counted from 1 (0: no measurement).
    disparity_px: (B + 2,) float32 at bin centres, rising with the bin. threshold: (B + 2,) int32, least soft count of
    a peak in 1/64 px. weights: (2 kernel_half_bins + 1,) int32. width_px: (B + 2,) float32 width of a bin.
    first_code: (B + 3,) int32, the least code of a bin or of a greater one. All indexed by bin."""

    bin_of_code: NDArray[np.uint16]
    disparity_px: NDArray[np.float32]
    width_px: NDArray[np.float32]
    threshold: NDArray[np.int32]
    weights: NDArray[np.int32]
    first_code: NDArray[np.int32]


def bin_table(f_px: float, lsb_per_px: float, sigma_d_px: float, params: Params) -> BinTable:
    """The bins for one focal length and noise level.

    Uniform with sigma_d / bin_per_sigma up to where that is bin_depth_m deep, then uniform in depth."""
    uniform = sigma_d_px / params.bin_per_sigma
    top = 65535.0 / lsb_per_px
    depth = params.bin_depth_m
    knee = math.sqrt(uniform * f_px / depth) if depth > 0.0 else top
    uniform = max(uniform, min(knee, top) / (0.75 * _MAX_BINS))
    code_px = np.arange(65536) / lsb_per_px
    with np.errstate(divide="ignore"):
        beyond = knee / uniform + (f_px / depth if depth > 0.0 else 0.0) * (
            1.0 / knee - 1.0 / np.maximum(code_px, knee)
        )
    position = np.where(code_px <= knee, code_px / uniform, beyond)
    bins = np.minimum(position.astype(np.int64), _MAX_BINS - 2) + 1
    bins[:2] = 0  # unknown, far
    count = int(bins.max())
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
        bin_of_code=bins.astype(np.uint16),
        disparity_px=centre.astype(np.float32),
        width_px=width.astype(np.float32),
        threshold=np.minimum(ONE_PX * threshold, 2.0**30).astype(np.int32),
        weights=weights,
        first_code=np.searchsorted(bins, np.arange(count + 3)).astype(np.int32),
    )


@inner_inline
def count_bins(px, n, bin_of_code, lanes):
    """How many of the first n pixels of px are in each bin; returns the least and the greatest bin with any.

    lanes: (LANES, B + 2) int32, zero before; the count of a bin is the sum over the lanes. n: at least 1."""
    for i in range(n):
        b = bin_of_code[np.uint32(px[CODE, i])]  # without a sign: no look whether it counts from the end
        lanes[i & (LANES - 1), b] += 1
    least, most = px[CODE, 0], px[CODE, 0]
    for i in range(n):
        least, most = min(least, px[CODE, i]), max(most, px[CODE, i])
    return np.int64(bin_of_code[least]), np.int64(bin_of_code[most])


@inner_inline
def soft_counts(lanes, first, last, weights, hist, counts):
    """counts[b] = sum_k weights[k] hist[b + k - half] for the bins with pixels (first..last) and around them.

    lanes: (LANES, B + 2) int32 as of `count_bins`, zero again afterwards. weights: (2 half + 1,) int32, symmetric.
    hist: (B + 2 + 2 half,) int32 scratch, zero before and after. counts: (B + 2,) int32 out, only the returned range:
    (least, greatest bin that a kernel reaches), with one bin without counts before it."""
    half = weights.shape[0] // 2
    begin, end = max(0, first - half - 1), min(counts.shape[0] - 1, last + half)
    h = np.uint64(half)  # indices without a sign: the loops below are then done many bins at a time
    for b in range(np.uint64(first), np.uint64(last + 1)):
        hist[b + h] = lanes[0, b] + lanes[1, b] + lanes[2, b] + lanes[3, b]
        lanes[0, b], lanes[1, b], lanes[2, b], lanes[3, b] = 0, 0, 0, 0
    u_begin, u_end = np.uint64(begin), np.uint64(end + 1)
    if half == 3:  # the usual kernel in one pass
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
    """Peaks of counts[begin..end] over `threshold`, from near to far, as `find_peaks` over all bins would give them.

    What is parted by bins without any count can be looked at by itself, and most of it is nowhere over its threshold."""
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
    """The greatest bin of begin..end whose count is not below its threshold and not zero, or -1."""
    none = np.int32(-1)
    last = none
    for b in range(np.uint64(begin), np.uint64(end + 1)):
        over = (counts[b] >= threshold[b]) & (counts[b] > 0)
        last = max(last, np.int32(b) if over else none)
    return np.int64(last)


@inner_inline
def find_peaks(counts, threshold, first, last, valley_share, alpha, found, low, high, top):
    """Adds the peaks of counts[first..last] over `threshold`, from near (high bins) to far, to the `found` ones;
    returns how many there are then (at most MAX_PEAKS).

    low, high: (MAX_PEAKS,) int32 intervals, where the count stays at or above alpha of the peak, never past the valley
    to the next peak; top: (MAX_PEAKS,) int32 bins. A valley above valley_share of the smaller peak joins both; a plateau
    is one peak. Beyond MAX_PEAKS the farthest are left to the irregular rest, which takes every pixel that is over."""
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
    """The bins around `top`, within first..last, whose counts are not below `least`: (first, last)."""
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

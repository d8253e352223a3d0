"""Section 4.1: how many pixels of a column lie near each disparity, and where that has its peaks.

Bins follow the noise, which stereo has constant in disparity; near the camera, where a bin would be thinner than any
obstacle is flat, they have a least depth instead. The soft count of a bin is sum K((x - D)/h)/K(0) with a Gaussian
over a few bins, in 1/64 of a pixel, to be compared with the pixels an obstacle of the least height fills: Hm * x / C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .params import Params

ONE_PX = 64
"""Soft counts are in this fraction of a pixel: their resolution."""
MAX_PEAKS = 24
"""Room for the peaks of one column: what no peak takes, the irregular rest does."""
NO_PEAK = 255
"""Mark of a row that belongs to no peak."""
_MAX_BINS = 4096
"""Room for the bins: finer ones than fit are widened. Three quarters are for those uniform in disparity."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BinTable:
    """bin_of_code: (65536,) uint16, the bin of a code of the levelled view, counted from 1 (0: no measurement).
    disparity_px: (B + 2,) float32 at bin centres, rising with the bin. threshold: (B + 2,) int32, least soft count of
    a peak in 1/64 px. weights: (2 kernel_half_bins + 1,) int32. width_px: (B + 2,) float32 width of a bin. All indexed by bin."""

    bin_of_code: NDArray[np.uint16]
    disparity_px: NDArray[np.float32]
    width_px: NDArray[np.float32]
    threshold: NDArray[np.int32]
    weights: NDArray[np.int32]


def bin_table(f_px: float, quantum: float, sigma_d_px: float, params: Params) -> BinTable:
    """The bins for one focal length and noise level.

    Uniform with sigma_d / bin_per_sigma up to where that is bin_depth_m deep, then uniform in depth."""
    uniform = sigma_d_px / params.bin_per_sigma
    top = 65535.0 / quantum
    depth = 0.0 if params.paper else params.bin_depth_m
    knee = math.sqrt(uniform * f_px / depth) if depth > 0.0 else top
    uniform = max(uniform, min(knee, top) / (0.75 * _MAX_BINS))
    code_px = np.arange(65536) / quantum
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
    if params.paper:
        # the printed kernel has unit area over its total width h, so its centre counts K(0) > 1 pixels
        s = params.kernel_sigma_bins / len(taps)
        peak = 1.0 / (math.erf(1.0 / (2.0 * math.sqrt(2.0) * s)) * s * math.sqrt(2.0 * math.pi))
        threshold = params.min_obstacle_height_m * centre / peak
    else:
        threshold = np.maximum(params.density_share * params.min_obstacle_height_m * centre, params.density_min_px)
    return BinTable(
        bin_of_code=bins.astype(np.uint16), disparity_px=centre.astype(np.float32), width_px=width.astype(np.float32),
        threshold=np.minimum(ONE_PX * threshold, 2.0**30).astype(np.int32), weights=weights,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def soft_counts(hist, weights, out):
    """out[b] = sum_k weights[k] hist[b + k - half], int32; hist and out: (B + 2,), zero at both ends."""
    n, taps = hist.shape[0], weights.shape[0]
    half = taps // 2
    for b in range(n):
        total = 0
        for k in range(max(0, half - b), min(taps, n + half - b)):
            total += weights[k] * hist[b + k - half]
        out[b] = total


@njit(cache=True, nogil=True)
def find_peaks(counts, threshold, valley_share, alpha, low, high, top):
    """Peaks of `counts` over `threshold`, from near (high bins) to far; returns how many (at most MAX_PEAKS).

    low, high: (24,) int32 intervals, where the count stays at or above alpha of the peak, never past the valley to the
    next peak; top: (24,) int32 bins. A valley above valley_share of the smaller peak joins both; a plateau is one
    peak. Beyond MAX_PEAKS the farthest are left to the irregular rest, which takes every pixel that is over."""
    n = counts.shape[0]
    found = 0
    start = n - 1
    best = 0
    best_at = n - 1
    valley = 0
    valley_at = n - 1
    for i in range(n):
        b = n - 1 - i
        c = counts[b]
        if c > best and valley >= valley_share * best:
            best = c
            best_at = b
            valley = c
            valley_at = b
        elif c < valley:
            valley = c
            valley_at = b
        last = b == 0
        if last or (valley < valley_share * best and valley < valley_share * c):
            end = 0 if last else valley_at
            if best >= threshold[best_at] and best > 0 and found < MAX_PEAKS:
                floor_ = alpha * best
                hi = best_at
                for j in range(best_at + 1, start + 1):
                    if counts[j] < floor_:
                        break
                    hi = j
                lo = best_at
                for j in range(best_at - end):
                    if counts[best_at - 1 - j] < floor_:
                        break
                    lo = best_at - 1 - j
                low[found], high[found], top[found] = lo, hi, best_at
                found += 1
            start = valley_at - 1
            best = c
            best_at = b
            valley = c
            valley_at = b
    return found

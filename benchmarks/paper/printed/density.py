"""Section 4.1 as printed: bins uniform in disparity, and a kernel of unit area over its total width."""

from __future__ import annotations

import math

import numpy as np

from core.stages.density import ONE_PX, BinTable

from .params import PaperParams

_MOST_BINS = 3072
"""Room for the bins: finer ones than fit are widened."""


def bin_table_paper(f_px: float, lsb_per_px: float, sigma_d_px: float, params: PaperParams) -> BinTable:
    """The bins for one noise level, sigma_d / bin_per_sigma wide. f_px: focal length; lsb_per_px: quantised disparity per
    pixel of disparity; sigma_d_px: noise of disparity."""
    top = 65535.0 / lsb_per_px
    width = max(sigma_d_px / params.bin_per_sigma, top / _MOST_BINS)
    bins = (np.arange(65536) / lsb_per_px / width).astype(np.int64) + 1
    bins[:2] = 0  # unknown, far
    count = int(bins.max())
    centre = (np.arange(count + 2, dtype=np.float64) - 0.5) * width  # of bin b, counted from 1
    centre[0] = 0.0
    taps = np.arange(-params.kernel_half_bins, params.kernel_half_bins + 1)
    weights = np.rint(ONE_PX * np.exp(-0.5 * (taps / params.kernel_sigma_bins) ** 2)).astype(np.int32)
    # the centre of the kernel counts K(0) > 1 pixels
    s = params.kernel_sigma_bins / len(taps)
    peak = 1.0 / (math.erf(1.0 / (2.0 * math.sqrt(2.0) * s)) * s * math.sqrt(2.0 * math.pi))
    threshold = params.min_obstacle_height_m * centre / peak
    return BinTable(
        bin_of_code=bins.astype(np.uint16),
        disparity_px=centre.astype(np.float32),
        width_px=np.full(count + 2, width, np.float32),
        threshold=np.minimum(ONE_PX * threshold, 2.0**30).astype(np.int32),
        weights=weights,
        first_code=np.searchsorted(bins, np.arange(count + 3)).astype(np.int32),
    )

"""Pixels: measured, unknown or far; flying pixels; and how noisy this frame is."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .params import Params
from .types import FAR_MM, SATURATED_MM, CameraInfo

UNKNOWN, FAR = np.float32(0.0), np.float32(-1.0)
"""Values of the inverse-depth image besides a measured 1/Z > 0."""


def depth_to_mm(depth: NDArray[np.uint16] | NDArray[np.float32], out: NDArray[np.uint16]) -> None:
    """Writes depth as uint16 millimetres into `out` (H, W).

    uint16 is taken as it is. Of float32 metres, anything not finite, not positive or beyond 65.533 m becomes
    UNKNOWN_MM: infinity too, since most stereo nodes write it where they found no match. Raises ValueError on any
    other dtype or on a shape that is not that of `out`."""
    if depth.shape != out.shape:
        raise ValueError(
            f"depth image is {depth.shape[1::-1]}, the camera's intrinsics say {out.shape[1::-1]} (width, height): "
            "use the intrinsics of this resolution"
        )
    if depth.dtype == np.uint16:
        np.copyto(out, depth)
    elif depth.dtype == np.float32:
        # what rounds to 1..65533: the values above are marks
        with np.errstate(invalid="ignore"):
            good = (depth > 0.0005) & (depth < 65.533)
        out[...] = np.where(good, np.where(good, depth, 0.0) * 1000.0 + 0.5, 0.0).astype(np.uint16)
    else:
        raise ValueError(f"depth of dtype {depth.dtype}: expected uint16 millimetres or float32 metres")


def clear_range_m(info: CameraInfo, ke_per_m: float, params: Params) -> float:
    """Greatest depth that counts as measured, m: what lies beyond it is FAR, so that FAR is free up to here only.

    A surface closer to the clip than `clear_sigmas` would survive by its near noise tail alone and come out metres
    close."""
    return info.max_range_m / (1.0 + params.clear_sigmas * ke_per_m * info.max_range_m)


def inverse_depth_table(info: CameraInfo, ke_per_m: float, params: Params) -> NDArray[np.float32]:
    """(65536,) float32: uint16 millimetres -> 1/Z in 1/m, UNKNOWN or FAR.

    Too near is UNKNOWN. Beyond `clear_range_m` is FAR."""
    z_mm = np.arange(65536)
    table = np.full(65536, UNKNOWN, np.float32)
    cut_mm = 1000.0 * clear_range_m(info, ke_per_m, params)
    measured = (z_mm >= max(1.0, 1000.0 * info.min_range_m)) & (z_mm <= cut_mm)
    table[measured] = 1000.0 / z_mm[measured]
    table[z_mm > cut_mm] = FAR
    table[FAR_MM] = FAR
    table[SATURATED_MM] = UNKNOWN
    return table


@njit(cache=True, nogil=True)
def classify(depth_mm, table, relative, absolute, raw, out):
    """Looks every pixel up and marks flying pixels unknown; returns counts (measured, far, flying).

    depth_mm: (H, W) uint16. table: (65536,) float32. relative: share of the disparity; absolute: 1/m. raw, out: (H, W)
    float32 inverse depth, before and after. A flying pixel lies strictly between its left and right (or upper
    and lower) neighbours in disparity and far from both; what stands in front of both is a thin thing, and is kept."""
    rows, cols = depth_mm.shape
    measured = 0
    far = 0
    flying = 0
    for v in range(rows):
        for u in range(cols):
            d = table[depth_mm[v, u]]
            raw[v, u] = d
            out[v, u] = d
    for v in range(rows):
        for u in range(cols):
            d = raw[v, u]
            if d > 0.0:
                measured += 1
                t = absolute + relative * d
                fly = False
                if 0 < u < cols - 1:
                    a, b = raw[v, u - 1], raw[v, u + 1]
                    if a > 0.0 and b > 0.0:
                        fly = (a - d > t and d - b > t) or (b - d > t and d - a > t)
                if not fly and 0 < v < rows - 1:
                    a, b = raw[v - 1, u], raw[v + 1, u]
                    if a > 0.0 and b > 0.0:
                        fly = (a - d > t and d - b > t) or (b - d > t and d - a > t)
                if fly:
                    out[v, u] = 0.0
                    flying += 1
            elif d < 0.0:
                far += 1
    return measured, far, flying


NOISE_BINS, NOISE_BIN_PX = 512, 0.05
"""Resolution of the histogram of second differences; its median is interpolated within a bin."""


@njit(cache=True, nogil=True)
def tile_roughness(inverse, focal_px, bin_px, max_inverse, step, row_step, min_samples, hist, out):
    """Median |second difference| of disparity in each tile of the image, px; -1 where too few pixels are measured.

    inverse: (H, W) float32. step: px of the difference; every row_step-th row is looked at. hist: (bins,) int32 scratch
    of bin_px. out: (tiles down, tiles across) float32. On a flat surface disparity is linear in the image, so its second
    difference along a row is noise alone: sigma * sqrt(6). What a matcher smears over neighbouring pixels hides from a
    short step (a real D435 shows 0.4 px at 2 px, 1.1 px at 8 px)."""
    rows, cols = inverse.shape
    down, across = out.shape
    bins = len(hist)
    for tv in range(down):
        for tu in range(across):
            hist[:] = 0
            n = 0
            for v in range(tv * rows // down, (tv + 1) * rows // down, row_step):
                for u in range(tu * cols // across + step, (tu + 1) * cols // across - step):
                    a, b, c = inverse[v, u - step], inverse[v, u], inverse[v, u + step]
                    if a > 0.0 and b > 0.0 and c > 0.0 and b < max_inverse:
                        n += 1
                        hist[min(bins - 1, int(abs(a - 2.0 * b + c) * focal_px / bin_px))] += 1
            out[tv, tu] = -1.0
            if n >= min_samples:
                below = 0
                for i in range(bins):
                    if 2 * (below + hist[i]) >= n:
                        out[tv, tu] = bin_px * (i + (0.5 * n - below) / hist[i])
                        break
                    below += hist[i]


def noise_tiles(inverse: NDArray[np.float32], focal_px: float, params: Params) -> NDArray[np.float32]:
    """(noise_tiles_down, noise_tiles_across) float32 disparity noise of each tile, px; negative: not known."""
    p = params
    tiles = np.empty((p.noise_tiles_down, p.noise_tiles_across), np.float32)
    max_inverse = 1.0 / p.noise_min_depth_m if p.noise_min_depth_m > 0.0 else math.inf
    tile_roughness(
        inverse, focal_px, NOISE_BIN_PX, max_inverse, p.noise_step_px, p.noise_row_step, p.noise_min_samples,
        np.zeros(NOISE_BINS, np.int32), tiles,
    )  # fmt: skip
    # the median magnitude of a normal deviate, and the second difference of three of them
    return tiles / np.float32(0.6745 * math.sqrt(6.0))


def estimate_ke(inverse: NDArray[np.float32], focal_px: float, prior: float, last: float, params: Params) -> float:
    """Noise constant ke (1/m, sigma_Z = ke Z^2) measured from one frame, blended with the last estimate.

    The lower quartile of the tiles is taken: the smoothest parts of the picture, since leaves and edges only add. Stays
    within prior/span..prior*span and moves in steps of `noise_grid`, so that tables need not be rebuilt each frame. Ours: the paper takes ke as known; a wrong one is costly."""
    if not params.estimate_noise or params.paper:
        return prior
    tiles = noise_tiles(inverse, focal_px, params)
    good = tiles[tiles >= 0.0]
    seed = last if math.isfinite(last) else prior
    if good.size < params.noise_min_tiles:
        return seed
    measured = max(float(np.quantile(good, params.noise_quantile)), params.min_sigma_px) / focal_px
    measured = min(max(measured, prior / params.noise_prior_span), prior * params.noise_prior_span)
    memory = params.noise_memory if math.isfinite(last) else 0.0
    blended = math.exp(memory * math.log(seed) + (1.0 - memory) * math.log(measured))
    step = math.log(1.0 + params.noise_grid)
    if math.isfinite(last) and abs(math.log(blended / last)) < params.noise_hold * step:
        return last
    return math.exp(step * round(math.log(blended) / step))

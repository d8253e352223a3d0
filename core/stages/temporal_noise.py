"""Noise of disparity over time: differences between two frames of a camera that stands still.

Input: sampled pixels of this frame and of an earlier one, in `ExtractorState`. Output: ke in 1/m and the next state.

Noise of stereo matching is correlated between neighbouring pixels, so that differences within one image underestimate
it. It is not correlated from frame to frame: the difference of two frames of a static scene has a standard deviation
of sqrt(2) sigma, whatever the correlation within the image. The paper takes ke as known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from ..params import Params
from ..types import GREATEST_MARK_MM, UNKNOWN_MM, CameraInfo, ExtractorState
from .classify import PixelLimits
from .spatial_noise import MEMORY, MIN_TILES, estimate_ke, noise_tiles, quantile_of_tiles

SAMPLE_ROWS, SAMPLE_COLS = 24, 32
"""Size of the grid of sampled pixels. At 640 x 480 they are 20 px apart, farther than the noise of a D435 is
correlated."""
TILE_ROWS, TILE_COLS = 3, 4
"""Number of tiles of the grid, each with 8 x 8 samples. The median difference of a tile is attributed to motion and
subtracted."""
_KEPT_SHARE = 0.8
"""Share of the deviations, in ascending order, that enter the mean. The others may come from edges of objects and
mismatches."""
_MEAN_OF_KEPT = 0.5587
"""Mean magnitude of a normal deviate (sigma = 1) below the 0.8 quantile of its magnitude: sqrt(2/pi) (1 -
exp(-1.2816^2 / 2)) / 0.8. The mean is used instead of the median because the differences of a real sensor are
whole numbers of disparity steps."""
_MEDIAN_ERROR = 1.2533
"""Standard error of the median of n normal deviates, times sqrt(n) / sigma."""
_MIN_SAMPLES = 24
"""Least number of samples, of 64, for the noise of a tile."""
_QUANTILE = 0.5
"""Quantile of the tiles that is the noise over time."""
_STILL_ERRORS, _STILL_SHARE = 4.0, 0.75
"""A tile is still when its median difference is at most this many standard errors; the camera, when so many tiles are."""
_STILL_RATIO = 2.0
"""A noise over time above this multiple of the noise in the image is motion."""
_SHORT_STEP_PX = 8
"""Step of the second difference in that comparison, at an image width of 640."""


def depth_samples(depth_mm: NDArray[np.uint16]) -> bytes:
    """Returns the sampled pixels of a depth image as bytes: SAMPLE_ROWS x SAMPLE_COLS little-endian uint16
    millimetres.

    depth_mm: (H, W) uint16. Values that are marks become UNKNOWN_MM."""
    samples = np.empty((SAMPLE_ROWS, SAMPLE_COLS), np.uint16)
    sample_pixels(depth_mm, samples)
    return samples.astype("<u2", copy=False).tobytes()


@inner
def sample_pixels(depth_mm, samples):
    """Fills `samples` (N, M) uint16 with the pixels in the middle of N x M equal parts of the image."""
    (rows, cols), (down, across) = depth_mm.shape, samples.shape
    for i in range(down):
        for j in range(across):
            z = depth_mm[(2 * i + 1) * rows // (2 * down), (2 * j + 1) * cols // (2 * across)]
            samples[i, j] = z if z > GREATEST_MARK_MM else UNKNOWN_MM


@kernel
def tile_differences(before, now, least_mm, greatest_mm):
    """Compares the tiles of two sets of samples. Returns the number of tiles with a result, the number of those without motion,
    and the noise over time, sigma of 1/Z of one frame in 1/m.

    Tiles with too few samples are left out, and so are those in which nothing differs (a frame that was delivered
    twice).

    Args:
        before, now: (SAMPLE_ROWS, SAMPLE_COLS) uint16 mm, samples of the earlier frame and of this one.
        least_mm, greatest_mm: least and greatest depth that counts as measured."""
    count, still = 0, 0
    high, wide = before.shape[0] // TILE_ROWS, before.shape[1] // TILE_COLS
    differences, sigmas = np.empty(high * wide), np.empty(TILE_ROWS * TILE_COLS)
    for tv in range(TILE_ROWS):
        for tu in range(TILE_COLS):
            n = 0
            for v in range(tv * high, tv * high + high):
                for u in range(tu * wide, tu * wide + wide):
                    a, b = before[v, u], now[v, u]
                    if least_mm <= a <= greatest_mm and least_mm <= b <= greatest_mm:
                        differences[n] = 1000.0 / b - 1000.0 / a
                        n += 1
            if n < _MIN_SAMPLES:
                continue
            middle = np.median(differences[:n])
            deviations = np.sort(np.abs(differences[:n] - middle))
            kept = max(int(_KEPT_SHARE * n), 1)
            sigma = deviations[:kept].mean() / _MEAN_OF_KEPT
            if sigma > 0.0:
                still += abs(middle) * math.sqrt(n) / (_MEDIAN_ERROR * sigma) <= _STILL_ERRORS
                sigmas[count] = sigma / math.sqrt(2.0)
                count += 1
    return count, still, quantile_of_tiles(sigmas[:count], _QUANTILE, 1)


def still_sigma(before: NDArray[np.uint16], now: NDArray[np.uint16], limits: PixelLimits, params: Params) -> float:
    """Returns the noise of 1/Z in 1/m from two sets of samples; nan if the camera moved or too few tiles are
    measured.

    The camera stood still if the median difference of most tiles is explained by their noise.
    before: (SAMPLE_ROWS, SAMPLE_COLS) uint16 mm, samples of the earlier frame; now: the same of this frame."""
    p = params
    least = max(int(limits.least_mm), math.ceil(1000.0 * p.noise_min_depth_m))
    count, still, sigma = tile_differences(before, now, least, int(limits.greatest_mm))
    return sigma if count >= MIN_TILES and still >= _STILL_SHARE * count else math.nan


def observe(
    state: ExtractorState,
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    focal_px: float,
    limits: PixelLimits,
    params: Params,
) -> ExtractorState:
    """Returns the state after a frame, with `still_ke_per_m` and the samples that a later frame is compared with.

    The samples are compared when they are `noise_time_frames` old, because filters in a camera may mix successive
    frames. A result that exceeds the noise within the image by more than _STILL_RATIO is discarded: motion
    adds more to the differences over time than correlation hides within the image."""
    p = params
    if not p.estimate_noise:
        return state
    if state.samples_mm and state.samples_age + 1 < p.noise_time_frames:
        return replace(state, samples_age=state.samples_age + 1)
    samples = depth_samples(depth_mm)
    ke = state.still_ke_per_m
    if state.samples_mm:
        shape = SAMPLE_ROWS, SAMPLE_COLS
        before, now = (np.frombuffer(s, "<u2").astype(np.uint16).reshape(shape) for s in (state.samples_mm, samples))
        sigma = still_sigma(before, now, limits, p)
        if 0.0 < sigma * focal_px <= _STILL_RATIO * noise_tiles(marks, focal_px, p, _SHORT_STEP_PX)[1]:
            memory = MEMORY if math.isfinite(ke) else 0.0
            ke = sigma if memory == 0.0 else math.exp(memory * math.log(ke) + (1.0 - memory) * math.log(sigma))
    return replace(state, still_ke_per_m=ke, samples_mm=samples, samples_age=0)


def estimate_noise(
    state: ExtractorState,
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    info: CameraInfo,
    limits: PixelLimits,
    params: Params,
) -> tuple[float, ExtractorState]:
    """Returns the noise coefficient ke of this frame in 1/m and the state after it, by `observe` and `estimate_ke`.

    limits: limits of `classify`, by the noise coefficient in use so far."""
    focal_px = info.intrinsics.fx
    after = observe(state, depth_mm, marks, focal_px, limits, params)
    # the first measurement over time replaces all estimates before it
    first = math.isfinite(after.still_ke_per_m) and not math.isfinite(state.still_ke_per_m)
    last = math.nan if first else state.ke_per_m
    ke = estimate_ke(marks, focal_px, info.ke_per_m, last, after.still_ke_per_m, params)
    return ke, replace(after, ke_per_m=ke)

"""Disparity noise measured over time: how depth samples of a camera that stands still differ between two frames.

Noise of stereo is correlated over neighbouring pixels, so that differences within one image underestimate it. It is not
correlated from frame to frame: the difference of two frames of one scene has a standard deviation of sqrt(2) sigma,
whatever the correlation in space.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..params import Params
from ..types import GREATEST_MARK_MM, UNKNOWN_MM, CameraInfo, ExtractorState
from .classify import estimate_ke, measured_mm, noise_tiles

SAMPLE_ROWS, SAMPLE_COLS = 24, 32
"""Grid of the sampled pixels: 20 px apart at 640x480, farther than the noise of a D435 is correlated."""
TILE_ROWS, TILE_COLS = 3, 4
"""Tiles of 8 x 8 samples. In each of them the median difference, which is motion, is taken off."""
_KEPT_SHARE = 0.8
"""Share of the deviations, from the least, whose mean is taken: edges of things and mismatches are among the rest."""
_MEAN_OF_KEPT = 0.5587
"""Mean magnitude of a normal deviate below the 0.8 quantile of its magnitude: sqrt(2/pi) (1 - exp(-1.2816^2 / 2)) / 0.8.
A mean and not a median, because the differences of a real sensor are whole numbers of disparity steps."""
_MEDIAN_ERROR = 1.2533
"""Standard error of a median of n normal deviates, times sqrt(n) / sigma."""


def depth_samples(depth_mm: NDArray[np.uint16]) -> bytes:
    """SAMPLE_ROWS x SAMPLE_COLS pixels of a depth image (H, W), little-endian uint16 millimetres; marks are UNKNOWN_MM."""
    rows, cols = depth_mm.shape
    v = (2 * np.arange(SAMPLE_ROWS) + 1) * rows // (2 * SAMPLE_ROWS)
    u = (2 * np.arange(SAMPLE_COLS) + 1) * cols // (2 * SAMPLE_COLS)
    samples = depth_mm[v[:, None], u].astype("<u2")
    samples[samples <= GREATEST_MARK_MM] = UNKNOWN_MM
    return samples.tobytes()


@kernel
def tile_differences(before, now, least_mm, greatest_mm, min_samples, differences, tiles):
    """Difference over time of 1/Z in each tile; returns how many tiles have one.

    before, now: (SAMPLE_ROWS, SAMPLE_COLS) uint16 mm, of which least_mm..greatest_mm are measured. differences: (samples of
    a tile,) float64 scratch. tiles: (n, 2) float64 out: median difference over its standard error, and sigma of 1/Z of one frame,
    1/m. Tiles with fewer than min_samples, or in which nothing differs (a frame delivered twice), are left out."""
    count = 0
    high, wide = before.shape[0] // TILE_ROWS, before.shape[1] // TILE_COLS
    for tv in range(TILE_ROWS):
        for tu in range(TILE_COLS):
            n = 0
            for v in range(tv * high, tv * high + high):
                for u in range(tu * wide, tu * wide + wide):
                    a, b = before[v, u], now[v, u]
                    if least_mm <= a <= greatest_mm and least_mm <= b <= greatest_mm:
                        differences[n] = 1000.0 / b - 1000.0 / a
                        n += 1
            if n < max(min_samples, 2):
                continue
            middle = np.median(differences[:n])
            deviations = np.sort(np.abs(differences[:n] - middle))
            kept = max(int(_KEPT_SHARE * n), 1)
            sigma = deviations[:kept].mean() / _MEAN_OF_KEPT
            if sigma > 0.0:
                tiles[count, 0] = abs(middle) * math.sqrt(n) / (_MEDIAN_ERROR * sigma)
                tiles[count, 1] = sigma / math.sqrt(2.0)
                count += 1
    return count


def still_sigma(
    before: NDArray[np.uint16], now: NDArray[np.uint16], measured_mm: tuple[int, int], params: Params
) -> float:
    """Noise of 1/Z (1/m) by two sets of samples (SAMPLE_ROWS, SAMPLE_COLS); nan where the camera moved between them, or too
    few tiles are measured.

    It stood still where most tiles differ, in the median, by no more than their noise explains."""
    p = params
    tiles = np.empty((TILE_ROWS * TILE_COLS, 2))
    scratch = np.empty(before.size // len(tiles))
    least, greatest = max(measured_mm[0], math.ceil(1000.0 * p.noise_min_depth_m)), measured_mm[1]
    known = tiles[: tile_differences(before, now, least, greatest, p.noise_time_min_samples, scratch, tiles)]
    if len(known) < p.noise_min_tiles:
        return math.nan
    still = np.count_nonzero(known[:, 0] <= p.noise_still_errors)
    return (
        float(np.quantile(known[:, 1], p.noise_time_quantile))
        if still >= p.noise_still_share * len(known)
        else math.nan
    )


def observe(
    state: ExtractorState,
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    focal_px: float,
    measured_mm: tuple[int, int],
    params: Params,
) -> ExtractorState:
    """The state after a frame: `still_ke_per_m` updated by this frame, and the samples that a later one is compared with.

    depth_mm, marks: (H, W) uint16, as measured and of `classify`. measured_mm: (least, greatest) that count as measured. Motion
    adds more to differences over time than noise hides from a short step within the image. The samples are `noise_time_frames` old when they are
    compared, because filters in a camera may mix successive frames."""
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
        sigma = still_sigma(before, now, measured_mm, p)
        if 0.0 < sigma * focal_px <= p.noise_still_ratio * noise_tiles(marks, focal_px, p, p.noise_short_step_px)[1]:
            memory = p.noise_memory if math.isfinite(ke) else 0.0
            ke = sigma if memory == 0.0 else math.exp(memory * math.log(ke) + (1.0 - memory) * math.log(sigma))
    return replace(state, still_ke_per_m=ke, samples_mm=samples, samples_age=0)


def estimate_noise(
    state: ExtractorState,
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    info: CameraInfo,
    ke_per_m: float,
    params: Params,
) -> tuple[float, ExtractorState]:
    """(noise constant ke of this frame, 1/m; the state after it) by `observe` and `estimate_ke`. ke_per_m: used so far."""
    focal_px = info.intrinsics.fx
    after = observe(state, depth_mm, marks, focal_px, measured_mm(info, ke_per_m, params), params)
    # the first measurement over time replaces all estimates before it
    first = math.isfinite(after.still_ke_per_m) and not math.isfinite(state.still_ke_per_m)
    last = math.nan if first else state.ke_per_m
    ke = estimate_ke(marks, focal_px, info.ke_per_m, last, after.still_ke_per_m, params)
    return ke, replace(after, ke_per_m=ke)

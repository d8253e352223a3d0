"""Noise of disparity within one depth image, and the noise coefficient ke that a frame uses.

Input: `marks` of `classify` and the estimates so far. Output: ke in 1/m, where the standard deviation of depth is
sigma_Z = ke Z^2 (the noise model of the paper's Eq. 8).

The paper takes ke as a known constant. A value that is too small turns noise into false planes, so ke is estimated
here from the second difference of disparity along image rows, in tiles. On a flat surface disparity is a linear
function of the pixel coordinates, and the second difference is noise alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner_ieee, kernel, kernel_ieee
from ..params import Params
from ..types import FAR_MM
from .classify import inverse_of_row

_NOISE_BINS, _NOISE_BIN_PX = 512, 0.05
"""Number and width of the bins of the histogram of second differences. The median is interpolated within a bin."""
MEMORY = 0.7
"""Share of the previous noise estimate that is kept at each frame."""
MIN_TILES = 3
"""Least number of tiles for the noise of a frame."""
_STEP_PX = 16
"""Step of the second difference whose median is the noise of a tile, at an image width of 640."""
_AGREE_SHARE, _AGREE_RATIO = 0.2, 1.25
"""Least share of all tiles that must agree with a higher noise before it is used: surfaces reach it, leaves do not. A
tile agrees when it differs by at most the ratio."""
_PRIOR_SHARE = 0.6
"""Least share of the configured ke that is used before the noise was measured over time."""
_GRID, _HOLD = 0.05, 0.75
"""Relative step in which the noise in use changes. It stays while the estimate is within so many steps of it."""
_ROUGHNESS_OF_NOISE = np.float32(0.6745 * math.sqrt(6.0))
"""Median magnitude of the second difference of three normal deviates with sigma = 1: 0.6745 is the median magnitude
of one normal deviate, sqrt(1 + 4 + 1) the growth of sigma."""


class TileRules(NamedTuple):
    """How the noise of tiles is measured."""

    focal_px: float  # focal length, which converts 1/Z to disparity
    least_mm: float  # pixels whose middle sample is closer are not used
    # distance in pixels between the samples of a difference. It must be longer than the correlation length of the
    # noise: a matcher smooths over neighbouring pixels, so that a short step underestimates the noise (a D435 shows 0.4
    # px with a step of 2 px and 1.1 px with one of 8 px).
    step: int
    row_step: int = 6  # every row_step-th row is used
    min_samples: int = 120  # least number of differences for the noise of a tile


@inner_ieee
def histogram_median(counts, total):
    """Returns the median of `total` >= 1 samples in px, interpolated within a bin. counts: samples of each bin."""
    below, i = 0, 0
    while 2 * (below + counts[i]) < total:
        below += counts[i]
        i += 1
    return _NOISE_BIN_PX * (i + (0.5 * total - below) / counts[i])


@kernel_ieee
def tile_roughness(marks, rules, out):
    """Computes the median magnitude of the second difference of disparity in each tile of the image, in pixels.

    out: (tiles down, tiles across) float32, -1 where a tile has too few samples."""
    rows, cols = marks.shape
    down, across = out.shape
    out[:] = -1.0
    step = rules.step
    n = cols - 2 * step
    if n <= 0:
        return
    inverse, bin_of = np.empty(cols, np.float32), np.empty(n, np.uint16)
    hist = np.empty((across, _NOISE_BINS + 1), np.int32)  # the last bin holds the samples that are not used
    zero, scale, last = np.float32(0.0), np.float32(rules.focal_px / _NOISE_BIN_PX), np.float32(_NOISE_BINS - 1)
    nearest = np.float32(1000.0 / rules.least_mm) if rules.least_mm > 0.0 else np.float32(np.inf)
    for tv in range(down):
        hist[:] = 0
        for v in range(tv * rows // down, (tv + 1) * rows // down, rules.row_step):
            inverse_of_row(marks[v], np.uint16(1), np.uint16(FAR_MM - 1), inverse)
            a, b, c = inverse[:n], inverse[step : n + step], inverse[2 * step :]
            for u in range(n):
                bend = np.uint16(min(abs(a[u] - np.float32(2.0) * b[u] + c[u]) * scale, last))
                good = (min(a[u], c[u]) > zero) & (b[u] > zero) & (b[u] < nearest)
                bin_of[u] = bend if good else np.uint16(_NOISE_BINS)
            for tu in range(across):
                counts = hist[tu]
                for u in range(tu * cols // across, (tu + 1) * cols // across - 2 * step):
                    counts[bin_of[u]] += 1
        for tu in range(across):
            total = hist[tu, :_NOISE_BINS].sum()
            if total >= rules.min_samples:
                out[tv, tu] = histogram_median(hist[tu], total)


@kernel
def quantile_of_tiles(tiles, share, least):
    """Returns a quantile of the tiles that are not negative, linearly interpolated; -1 if fewer than `least` tiles
    are."""
    known = np.sort(tiles.ravel()[tiles.ravel() >= 0.0])
    if len(known) < max(least, 1):
        return -1.0
    at = share * (len(known) - 1)
    below = int(at)
    above = min(below + 1, len(known) - 1)
    return known[below] + (at - below) * (known[above] - known[below])


@kernel
def agreeing_tiles(tiles, value, within):
    """Returns the number of tiles that differ from `value` by a factor of at most `within`."""
    return ((tiles >= value / within) & (tiles <= value * within)).sum()


@kernel
def noise_of_tiles(marks, rules, quantile, tiles):
    """Computes the noise of disparity of each tile and of the image.

    Args:
        quantile: the quantile of the tiles that is the noise of the image.
        tiles: (tiles down, tiles across) float32 out, sigma in px; negative where it is not known.

    Returns:
        The noise of the image in px, -1 if fewer than MIN_TILES tiles have one, and the number of tiles that agree with
            it."""
    tile_roughness(marks, rules, tiles)
    for tv in range(tiles.shape[0]):
        for tu in range(tiles.shape[1]):
            tiles[tv, tu] /= _ROUGHNESS_OF_NOISE
    sigma_px = quantile_of_tiles(tiles, quantile, MIN_TILES)
    return sigma_px, agreeing_tiles(tiles, sigma_px, _AGREE_RATIO)


def noise_tiles(
    marks: NDArray[np.uint16], focal_px: float, params: Params, step_px: int = _STEP_PX
) -> tuple[NDArray[np.float32], float, int]:
    """Returns the noise of disparity of each tile, that of the image, and the number of tiles that agree with it.

    Args:
        step_px: step of the differences for an image of 640 columns.

    Returns:
        (noise_tiles_down, noise_tiles_across) float32 sigma in px, negative where it is not known; the noise of the
            image in px, -1 if it is not known; the number of agreeing tiles."""
    p = params
    tiles = np.empty((p.noise_tiles_down, p.noise_tiles_across), np.float32)
    step = max(round(step_px * marks.shape[1] / 640), 1)
    rules = TileRules(focal_px, 1000.0 * p.noise_min_depth_m, step)
    sigma_px, agree = noise_of_tiles(marks, rules, p.noise_quantile, tiles)
    return tiles, sigma_px, agree


def measured_ke(
    marks: NDArray[np.uint16], focal_px: float, prior: float, seed: float, still: float, params: Params
) -> float:
    """Returns the noise coefficient of one frame in 1/m, limited to prior / noise_prior_span .. prior *
    noise_prior_span.

    If the noise was measured over time, that value is used, or the value of the image where it is greater and the
    tiles agree. Without a measurement over time the image alone may lower ke to _PRIOR_SHARE of the prior at
    most, because noise that is correlated over more pixels than the step does not show in the image.

    Args:
        prior: ke of the camera's description, 1/m.
        seed: ke in use before this frame, 1/m.
        still: ke measured over time, 1/m; nan if there is none."""
    p = params
    tiles, sigma_px, agree = noise_tiles(marks, focal_px, p)
    by_image = sigma_px / focal_px if sigma_px >= 0.0 else math.nan
    agreed = agree >= _AGREE_SHARE * tiles.size
    if math.isfinite(still):
        ke = max(still, by_image) if agreed and math.isfinite(by_image) else still
        least = prior / p.noise_prior_span
    else:
        ke = by_image if by_image <= seed or (agreed and math.isfinite(by_image)) else seed
        least = prior * max(_PRIOR_SHARE, 1.0 / p.noise_prior_span)
    return min(max(ke, p.min_sigma_px / focal_px, least), prior * p.noise_prior_span)


def estimate_ke(
    marks: NDArray[np.uint16], focal_px: float, prior: float, last: float, still: float, params: Params
) -> float:
    """Returns the noise coefficient ke of a frame in 1/m, blended with the last estimate.

    The noise of the image is the lower quartile of its tiles, those of the smoothest surfaces, since foliage and
    edges only add to it. It raises ke only where the tiles agree: tiles of smooth surfaces do, tiles of foliage do
    not. The result changes in steps of _GRID, so that tables that depend on it are seldom computed again.

    Args:
        prior: ke of the camera's description, 1/m.
        last: estimate of the last frame; nan before the first frame.
        still: `ExtractorState.still_ke_per_m`.
        params: parameters. With `estimate_noise` off the result is the prior."""
    if not params.estimate_noise:
        return prior
    seed = last if math.isfinite(last) else prior
    measured = measured_ke(marks, focal_px, prior, seed, still, params)
    if measured == seed:
        return seed
    memory = MEMORY if math.isfinite(last) else 0.0
    blended = math.exp(memory * math.log(seed) + (1.0 - memory) * math.log(measured))
    step = math.log(1.0 + _GRID)
    if math.isfinite(last) and abs(math.log(blended / last)) < _HOLD * step:
        return last
    return math.exp(step * round(math.log(blended) / step))

"""Pixels: measured, unknown or far; flying pixels; and how noisy this frame is.

The result is an image of marks: millimetres where a pixel is measured, UNKNOWN_MM or FAR_MM elsewhere. Disparity is
1000/mm in float32 wherever it is needed: a division costs less than a look-up table.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..jit import inline_ieee, inner, inner_ieee, kernel, kernel_ieee
from ..params import Params
from ..types import FAR_MM, SATURATED_MM, CameraInfo

_FAR, _SATURATED = np.uint16(FAR_MM), np.uint16(SATURATED_MM)
_LEAST_M, _MOST_M = np.float32(0.0005), np.float32(65.533)
"""What rounds to 1..65533 mm; the values above those are marks."""


@inner
def metres_to_mm(metres, out):
    """float32 metres (H, W) as uint16 millimetres; UNKNOWN_MM for what is no distance."""
    for v in range(metres.shape[0]):
        line, mm = metres[v], out[v]
        for u in range(len(line)):
            z = line[u]
            good = (z > _LEAST_M) & (z < _MOST_M)
            rounded = np.int32((z if good else np.float32(0.0)) * np.float32(1000.0) + np.float32(0.5))
            mm[u] = np.uint16(rounded if good else 0)


def depth_to_mm(depth: NDArray[np.uint16] | NDArray[np.float32], out: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The depth image as read-only, contiguous uint16 millimetres: itself, or `out` (H, W) where it must be converted.

    Of float32 metres, anything not finite, not positive or beyond 65.533 m becomes UNKNOWN_MM: infinity too, since most
    stereo nodes write it where they found no match. Raises ValueError on any other dtype or on a shape that is not
    that of `out`."""
    flags = depth.flags
    if depth.dtype is out.dtype and depth.shape == out.shape and flags.c_contiguous and not flags.writeable:
        return depth.view(np.uint16)
    if depth.shape != out.shape:
        raise ValueError(
            f"depth image is {depth.shape[1::-1]}, the camera's intrinsics say {out.shape[1::-1]} (width, height): "
            "use the intrinsics of this resolution"
        )
    if depth.dtype == np.float32:
        metres_to_mm(np.ascontiguousarray(depth), out)
    elif depth.dtype != np.uint16:
        raise ValueError(f"depth of dtype {depth.dtype}: expected uint16 millimetres or float32 metres")
    elif not depth.flags.c_contiguous:
        np.copyto(out, depth)
    view = depth.view(np.uint16) if depth.dtype == np.uint16 and depth.flags.c_contiguous else out.view()
    view.flags.writeable = False
    return view


def clear_range_m(info: CameraInfo, ke_per_m: float, params: Params) -> float:
    """Greatest depth that counts as measured, m: what lies beyond it is FAR, so that FAR is free up to here only.

    A surface closer to the clip than `clear_sigmas` would survive by its near noise tail alone and come out metres
    close."""
    return info.max_range_m / (1.0 + params.clear_sigmas * ke_per_m * info.max_range_m)


def measured_mm(info: CameraInfo, ke_per_m: float, params: Params) -> tuple[int, int]:
    """(least, greatest) millimetres that count as measured: closer is unknown, as the marks up to GREATEST_MARK_MM are;
    farther is far."""
    return info.least_mm, math.floor(1000.0 * clear_range_m(info, ke_per_m, params))


@inner_ieee
def inverse_of_row(mm, least, greatest, out):
    """1/Z in 1/m of one row, float32: 0 where unknown, -1 where far."""
    for u in range(len(mm)):
        z = mm[u]
        d = np.float32(1000.0) / np.float32(z)
        if z > greatest:
            d = np.float32(-1.0)
        if (z < least) | (z == _SATURATED):
            d = np.float32(0.0)
        out[u] = d


@inline_ieee
def read_ahead(depth_mm, v, least, greatest, inverse):
    """Writes row v of the picture, unknown where there is none, into its place among three: inverse (3, W + 2) float32."""
    line = inverse[v % 3, 1:-1]
    if v < len(depth_mm):
        inverse_of_row(depth_mm[v], least, greatest, line)
    else:
        for u in range(len(line)):
            line[u] = np.float32(0.0)


@kernel
def classify(depth_mm, least_mm, greatest_mm, relative, absolute, out):
    """Marks every pixel, flying pixels as unknown; returns counts (measured, far, flying).

    depth_mm: (H, W) uint16. least_mm..greatest_mm are measured. relative: share of the disparity; absolute: 1/m. out:
    (H, W) uint16 marks. A flying pixel lies strictly between its left and right (or upper and lower) neighbours in
    disparity and far from both; what stands in front of both is a thin thing, and is kept. No branch in the inner loop,
    three rows of disparity at a time."""
    rows, cols = depth_mm.shape
    least, greatest = np.uint16(least_mm), np.uint16(greatest_mm)
    relative, absolute, zero = np.float32(relative), np.float32(absolute), np.float32(0.0)
    inverse = np.zeros((3, cols + 2), np.float32)  # of the row before, this and the next; unknown beyond the border
    read_ahead(depth_mm, 0, least, greatest, inverse)
    measured, far, flying = np.int64(0), np.int64(0), np.int64(0)
    for v in range(rows):
        read_ahead(depth_mm, v + 1, least, greatest, inverse)
        here, after = inverse[v % 3], inverse[(v + 1) % 3, 1 : cols + 1]
        left, middle, right, before = here[:cols], here[1 : cols + 1], here[2:], inverse[(v + 2) % 3, 1 : cols + 1]
        mm, marks = depth_mm[v], out[v]
        # sums of 32 bits as the disparities have: wider ones would halve how many pixels are done at a time
        row_measured, row_far, row_flying = np.int32(0), np.int32(0), np.int32(0)
        for u in range(cols):
            d = middle[u]
            step = absolute + relative * d
            low, high = min(left[u], right[u]), max(left[u], right[u])
            fly = (low > zero) & (d - low > step) & (high - d > step)
            low, high = min(before[u], after[u]), max(before[u], after[u])
            fly |= (low > zero) & (d - low > step) & (high - d > step)
            mark = mm[u]
            if d < zero:
                mark = _FAR
            if (d == zero) | fly:
                mark = np.uint16(0)
            marks[u] = mark
            row_measured = np.int32(row_measured + np.int32(d > zero))
            row_far = np.int32(row_far + np.int32(d < zero))
            row_flying = np.int32(row_flying + np.int32(fly))
        measured += row_measured
        far += row_far
        flying += row_flying
    return measured, far, flying


_NOISE_BINS, _NOISE_BIN_PX = 512, 0.05
"""Resolution of the histogram of second differences; its median is interpolated within a bin."""
_ROUGHNESS_OF_NOISE = np.float32(0.6745 * math.sqrt(6.0))
"""The median magnitude of a normal deviate, and the second difference of three of them."""


@kernel_ieee
def tile_roughness(marks, focal_px, least_mm, step, row_step, min_samples, out):
    """Median |second difference| of disparity in each tile of the image, px; -1 where too few pixels are measured.

    marks: (H, W) uint16 of `classify`. step: px of the difference, its middle farther than least_mm; every row_step-th
    row is looked at. out: (tiles down, tiles across) float32. On a flat surface disparity is linear in the image, so
    its second difference along a row is noise alone: sigma * sqrt(6). What a matcher smears over neighbouring pixels
    hides from a short step (a real D435 shows 0.4 px at 2 px, 1.1 px at 8 px): it is to be longer than noise is correlated."""
    rows, cols = marks.shape
    down, across = out.shape
    out[:] = -1.0
    n = cols - 2 * step
    if n <= 0:
        return
    inverse, bin_of = np.empty(cols, np.float32), np.empty(n, np.uint16)
    hist = np.empty((across, _NOISE_BINS + 1), np.int32)  # the last bin holds what does not count
    zero, scale, last = np.float32(0.0), np.float32(focal_px / _NOISE_BIN_PX), np.float32(_NOISE_BINS - 1)
    nearest = np.float32(1000.0 / least_mm) if least_mm > 0.0 else np.float32(np.inf)
    for tv in range(down):
        hist[:] = 0
        for v in range(tv * rows // down, (tv + 1) * rows // down, row_step):
            inverse_of_row(marks[v], np.uint16(1), np.uint16(_FAR - 1), inverse)
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
            if total >= min_samples:
                below = 0
                for i in range(_NOISE_BINS):
                    if 2 * (below + hist[tu, i]) >= total:
                        out[tv, tu] = _NOISE_BIN_PX * (i + (0.5 * total - below) / hist[tu, i])
                        break
                    below += hist[tu, i]


@kernel
def quantile_of_tiles(tiles, share, least):
    """The quantile of the tiles that are not negative, linear between two of them; -1 where they are fewer than least."""
    known = np.sort(tiles.ravel()[tiles.ravel() >= 0.0])
    if len(known) < max(least, 1):
        return -1.0
    at = share * (len(known) - 1)
    below = int(at)
    above = min(below + 1, len(known) - 1)
    return known[below] + (at - below) * (known[above] - known[below])


@kernel
def agreeing_tiles(tiles, value, within):
    """How many tiles are known and at most `within` times greater or less than value."""
    return ((tiles >= value / within) & (tiles <= value * within)).sum()


@kernel
def noise_of_tiles(marks, focal_px, least_mm, step, row_step, min_samples, share, min_tiles, within, tiles):
    """(`quantile_of_tiles`, `agreeing_tiles` with it) of the noise of disparity in each tile. tiles: (tiles down, tiles across)
    float32 out, `tile_roughness` as noise, px; negative: not known."""
    tile_roughness(marks, focal_px, least_mm, step, row_step, min_samples, tiles)
    for tv in range(tiles.shape[0]):
        for tu in range(tiles.shape[1]):
            tiles[tv, tu] /= _ROUGHNESS_OF_NOISE
    sigma_px = quantile_of_tiles(tiles, share, min_tiles)
    return sigma_px, agreeing_tiles(tiles, sigma_px, within)


def noise_tiles(
    marks: NDArray[np.uint16], focal_px: float, params: Params, step_px: int | None = None
) -> tuple[NDArray[np.float32], float, int]:
    """((noise_tiles_down, noise_tiles_across) float32 disparity noise of each tile, px, negative: not known; the noise of the
    picture, px, -1 where too few tiles are known; how many of them agree with it). step_px: at 640 columns, default
    noise_step_px."""
    p = params
    tiles = np.empty((p.noise_tiles_down, p.noise_tiles_across), np.float32)
    step = max(round((step_px or p.noise_step_px) * marks.shape[1] / 640), 1)
    sigma_px, agree = noise_of_tiles(
        marks,
        focal_px,
        1000.0 * p.noise_min_depth_m,
        step,
        p.noise_row_step,
        p.noise_min_samples,
        p.noise_quantile,
        p.noise_min_tiles,
        p.noise_agree_ratio,
        tiles,
    )
    return tiles, sigma_px, agree


def measured_ke(
    marks: NDArray[np.uint16], focal_px: float, prior: float, seed: float, still: float, params: Params
) -> float:
    """Noise constant (1/m) of one frame, within prior/span..prior*span. seed: in use before; still: measured over time,
    nan: not yet.

    A measurement over time is used, or more where the image shows more and its tiles agree. Without one the
    image alone may lower the noise to noise_prior_share of the prior: what is correlated over more pixels than the
    differences span does not show in it."""
    p = params
    tiles, sigma_px, agree = noise_tiles(marks, focal_px, p)
    by_image = sigma_px / focal_px if sigma_px >= 0.0 else math.nan
    agreed = agree >= p.noise_agree_share * tiles.size
    if math.isfinite(still):
        ke = max(still, by_image) if agreed and math.isfinite(by_image) else still
        least = prior / p.noise_prior_span
    else:
        ke = by_image if by_image <= seed or (agreed and math.isfinite(by_image)) else seed
        least = prior * max(p.noise_prior_share, 1.0 / p.noise_prior_span)
    return min(max(ke, p.min_sigma_px / focal_px, least), prior * p.noise_prior_span)


def estimate_ke(
    marks: NDArray[np.uint16], focal_px: float, prior: float, last: float, still: float, params: Params
) -> float:
    """Noise constant ke (1/m, sigma_Z = ke Z^2) from one frame and what is known over time, blended with the last estimate.

    marks: (H, W) uint16 of `classify`. last: nan before the first frame. still: `ExtractorState.still_ke_per_m`. Of the image the lower
    quartile of the tiles is taken: the smoothest parts, since leaves and edges only add. It raises the noise only where tiles
    agree, as those of smooth surfaces do and those of leaves do not. The result stays within prior/span..prior*span and moves in
    steps of `noise_grid`, so that tables need not be rebuilt each frame. The paper takes ke as known; a wrong value adds false planes."""
    if not params.estimate_noise:
        return prior
    seed = last if math.isfinite(last) else prior
    measured = measured_ke(marks, focal_px, prior, seed, still, params)
    if measured == seed:
        return seed
    memory = params.noise_memory if math.isfinite(last) else 0.0
    blended = math.exp(memory * math.log(seed) + (1.0 - memory) * math.log(measured))
    step = math.log(1.0 + params.noise_grid)
    if math.isfinite(last) and abs(math.log(blended / last)) < params.noise_hold * step:
        return last
    return math.exp(step * round(math.log(blended) / step))

"""Refuses a frame whose image, or a part of it, is noise.

Input: the depth image and the counts of `classify`. Output: True if the frame must be reported as NO_MEASUREMENT.

A pixel on a surface, however small, has a neighbour at a similar depth. Pixels of noise have one by chance only. The
share of pixels without a similar neighbour therefore distinguishes noise from foliage, whose outlines are flying
pixels but whose stems continue. The paper has no such check."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..params import Params
from .classify import PixelLimits, inverse_image, is_between

_FEWEST_NEIGHBOURS = 3
"""Least number of measured neighbours, of four, for a pixel to be judged."""
_LOOK_SHARE = 0.003
"""Share of flying pixels above which single tiles are checked."""
_JUDGED_SHARE = 0.25
"""Least share of the pixels of a tile that can be judged for the tile to be."""
_ALONE_SHARE = 0.25
"""A tile is noise when more than this share of those pixels differ from all their neighbours."""


@kernel
def count_alone(depth_mm, limits, judged, alone):
    """Counts in each tile the pixels that can be judged and those that have no similar neighbour.

    Two pixels are similar if their 1/Z differ by at most a step, see PixelLimits.

    Args:
        judged: (N, M) int32 out, measured pixels of each tile with at least _FEWEST_NEIGHBOURS measured neighbours. The
            tiles divide rows and columns evenly.
        alone: (N, M) int32 out, those of them that are similar to no neighbour."""
    rows, cols = depth_mm.shape
    down, across = judged.shape
    judged[:] = 0
    alone[:] = 0
    zero = np.float32(0.0)
    inverse = inverse_image(depth_mm, limits)
    is_judged, is_alone = np.empty(cols, np.bool_), np.empty(cols, np.bool_)
    for v in range(rows):
        here, before, after = inverse[v + 1], inverse[v, 1 : cols + 1], inverse[v + 2, 1 : cols + 1]
        left, middle, right = here[:cols], here[1 : cols + 1], here[2:]
        for u in range(cols):
            d, a, b, c, e = middle[u], left[u], right[u], before[u], after[u]
            step = limits.absolute + limits.relative * d
            # no branch, so that the loop is vectorised
            known = np.int32(a > zero) + np.int32(b > zero) + np.int32(c > zero) + np.int32(e > zero)
            alike = (a > zero) & (abs(a - d) <= step)
            alike |= (b > zero) & (abs(b - d) <= step)
            alike |= (c > zero) & (abs(c - d) <= step)
            alike |= (e > zero) & (abs(e - d) <= step)
            is_judged[u] = (d > zero) & (known >= np.int32(_FEWEST_NEIGHBOURS))
            is_alone[u] = is_judged[u] & (not alike)
        tv = v * down // rows
        for tu in range(across):
            first, end = tu * cols // across, (tu + 1) * cols // across
            judged[tv, tu] += is_judged[first:end].sum()
            alone[tv, tu] += is_alone[first:end].sum()


@kernel
def flying_off_ramps(depth_mm, limits):
    """Returns the number of flying pixels that do not lie on a ramp.

    A flying pixel is defined as in `classify`. It lies on a ramp if 1/Z is linear along its row and its column,
    within the same step, as on a plane: ground seen from a height of 0.1 m changes by more than a step from row to
    row. An axis along which a neighbour is not measured does not count."""
    rows, cols = depth_mm.shape
    zero = np.float32(0.0)
    inverse = inverse_image(depth_mm, limits)
    count = 0
    for v in range(rows):
        here, before, after = inverse[v + 1], inverse[v, 1 : cols + 1], inverse[v + 2, 1 : cols + 1]
        left, middle, right = here[:cols], here[1 : cols + 1], here[2:]
        for u in range(cols):
            d, a, b, c, e = middle[u], left[u], right[u], before[u], after[u]
            step = limits.absolute + limits.relative * d
            bent = (min(a, b) > zero) & (abs(a + b - d - d) > step)
            bent |= (min(c, e) > zero) & (abs(c + e - d - d) > step)
            count += (is_between(d, a, b, step) | is_between(d, c, e, step)) & bent
    return count


def noisy_share(depth_mm: NDArray[np.uint16], limits: PixelLimits, params: Params) -> float:
    """Returns the share of the tiles of an image (H, W) whose pixels are noise."""
    p = params
    shape = (min(p.noisy_tiles, depth_mm.shape[0]), min(p.noisy_tiles, depth_mm.shape[1]))
    judged, alone = np.empty(shape, np.int32), np.empty(shape, np.int32)
    count_alone(depth_mm, limits, judged, alone)
    enough = judged >= max(1.0, _JUDGED_SHARE * depth_mm.size / judged.size)
    return float(np.count_nonzero(enough & (alone > _ALONE_SHARE * judged)) / judged.size)


def is_no_measurement(
    depth_mm: NDArray[np.uint16], limits: PixelLimits, counts: tuple[int, int, int], params: Params
) -> bool:
    """True if too few pixels are measured or far, or so many are flying that the others cannot be used either.

    An image of pure noise has 27 % flying pixels, foliage has 0.2 %. Flying pixels on ramps are not counted: they
    belong to the ground close below the camera. Without this check the plane merge of an image of noise would take
    minutes.
    counts: numbers of measured, far and flying pixels of `classify`."""
    p, (measured, far, flying) = params, counts
    if (measured - flying) / depth_mm.size + far / depth_mm.size <= p.min_measured_share:
        return True
    if flying <= min(p.max_flying_share, _LOOK_SHARE) * measured:
        return False
    if flying > p.max_flying_share * measured:
        scattered = flying_off_ramps(depth_mm, limits)
        if scattered > p.max_flying_share * measured:
            return True
    return noisy_share(depth_mm, limits, p) > p.max_noisy_share

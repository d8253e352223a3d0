"""Noise in a part of the picture: where the pixels of many tiles have nothing to do with their neighbours.

A pixel that measures a surface, however small, has a neighbour on the same surface; pixels of noise agree by chance only. So
the share of pixels that are alone distinguishes noise from leaves and reeds, whose outlines are flying pixels but whose
stems continue.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel
from ..params import Params
from ..types import CameraInfo
from .classify import measured_mm, read_ahead

_FEWEST_NEIGHBOURS = 3
"""Not tuning: of the four neighbours of a pixel so many must be measured before it is called alone."""


@kernel
def count_alone(depth_mm, least_mm, greatest_mm, relative, absolute, judged, alone):
    """judged, alone (N, M) int32 out: pixels of each tile with at least three measured neighbours, and those like none.

    depth_mm: (H, W) uint16; least_mm..greatest_mm are measured. Alike: 1/Z within relative of the pixel's own and
    absolute (1/m). Tiles divide rows and columns evenly."""
    rows, cols = depth_mm.shape
    down, across = judged.shape
    judged[:] = 0
    alone[:] = 0
    least, greatest = np.uint16(least_mm), np.uint16(greatest_mm)
    relative, absolute, zero = np.float32(relative), np.float32(absolute), np.float32(0.0)
    inverse = np.zeros((3, cols + 2), np.float32)  # of the row before, this and the next; unknown beyond the border
    read_ahead(depth_mm, 0, least, greatest, inverse)
    kind = np.empty(cols, np.int32)  # 1 where judged, and 2**16 where alone as well
    for v in range(rows):
        read_ahead(depth_mm, v + 1, least, greatest, inverse)
        here, after = inverse[v % 3], inverse[(v + 1) % 3, 1 : cols + 1]
        left, middle, right, before = here[:cols], here[1 : cols + 1], here[2:], inverse[(v + 2) % 3, 1 : cols + 1]
        for u in range(cols):
            d = middle[u]
            step = absolute + relative * d
            a, b, c, e = left[u], right[u], before[u], after[u]
            # without a branch, so that many pixels are looked at side by side
            known = np.int32(a > zero) + np.int32(b > zero) + np.int32(c > zero) + np.int32(e > zero)
            alike = (a > zero) & (abs(a - d) <= step)
            alike |= (b > zero) & (abs(b - d) <= step)
            alike |= (c > zero) & (abs(c - d) <= step)
            alike |= (e > zero) & (abs(e - d) <= step)
            looked = (d > zero) & (known >= np.int32(_FEWEST_NEIGHBOURS))
            kind[u] = np.int32(looked) + (np.int32(looked & (not alike)) << np.int32(16))
        tv = v * down // rows
        for tu in range(across):
            both = np.int32(0)
            for u in range(tu * cols // across, (tu + 1) * cols // across):
                both += kind[u]
            judged[tv, tu] += both & np.int32(0xFFFF)
            alone[tv, tu] += both >> np.int32(16)


@kernel
def flying_off_ramps(depth_mm, least_mm, greatest_mm, relative, absolute):
    """Number of flying pixels that lie on no ramp.

    depth_mm: (H, W) uint16; least_mm..greatest_mm are measured. A pixel flies as in `classify`, with a step of relative
    of its own 1/Z and absolute (1/m). It lies on a ramp where 1/Z is linear within that step along the row and along the
    column, as on a plane: ground seen from 0.1 m above changes by more than a step from row to row. Where a neighbour
    is not measured its axis is no objection."""
    rows, cols = depth_mm.shape
    least, greatest = np.uint16(least_mm), np.uint16(greatest_mm)
    relative, absolute, zero = np.float32(relative), np.float32(absolute), np.float32(0.0)
    inverse = np.zeros((3, cols + 2), np.float32)  # of the row before, this and the next; unknown beyond the border
    read_ahead(depth_mm, 0, least, greatest, inverse)
    count = np.int64(0)
    for v in range(rows):
        read_ahead(depth_mm, v + 1, least, greatest, inverse)
        here, after = inverse[v % 3], inverse[(v + 1) % 3, 1 : cols + 1]
        left, middle, right, before = here[:cols], here[1 : cols + 1], here[2:], inverse[(v + 2) % 3, 1 : cols + 1]
        for u in range(cols):
            d, a, b, c, e = middle[u], left[u], right[u], before[u], after[u]
            step = absolute + relative * d
            row_known, column_known = min(a, b) > zero, min(c, e) > zero
            fly = row_known & (d - min(a, b) > step) & (max(a, b) - d > step)
            fly |= column_known & (d - min(c, e) > step) & (max(c, e) - d > step)
            bent = row_known & (abs(a + b - d - d) > step)
            bent |= column_known & (abs(c + e - d - d) > step)
            count += np.int64(fly & bent)
    return count


def noisy_share(depth_mm: NDArray[np.uint16], least_mm: int, greatest_mm: int, ke: float, params: Params) -> float:
    """Share of the picture's tiles whose pixels are noise; depth_mm: (H, W), least_mm..greatest_mm are measured."""
    p = params
    shape = (min(p.noisy_tiles, depth_mm.shape[0]), min(p.noisy_tiles, depth_mm.shape[1]))
    judged, alone = np.empty(shape, np.int32), np.empty(shape, np.int32)
    count_alone(depth_mm, least_mm, greatest_mm, p.flying_relative, p.flying_sigmas * ke, judged, alone)
    enough = judged >= max(1.0, p.noisy_judged_share * depth_mm.size / judged.size)
    return float(np.count_nonzero(enough & (alone > p.noisy_alone_share * judged)) / judged.size)


def is_no_measurement(
    depth_mm: NDArray[np.uint16], info: CameraInfo, ke_per_m: float, counts: tuple[int, int, int], params: Params
) -> bool:
    """Whether too few pixels are measured or far, or so many are flying that the rest is no measurement either.

    depth_mm: (H, W); counts: (measured, far, flying) of `classify`. Pure noise has 27 % flying pixels, foliage 0.2 %; flying
    pixels on ramps are ground close below the camera and do not count. Without this check the merge of such an image would
    take minutes."""
    p, (measured, far, flying) = params, counts
    if (measured - flying) / depth_mm.size + far / depth_mm.size < p.min_measured_share:
        return True
    if flying <= min(p.max_flying_share, p.noisy_look_share) * measured:
        return False
    limits = measured_mm(info, ke_per_m, p)
    if flying > p.max_flying_share * measured:
        scattered = flying_off_ramps(depth_mm, *limits, p.flying_relative, p.flying_sigmas * ke_per_m)
        if scattered > p.max_flying_share * measured:
            return True
    return noisy_share(depth_mm, *limits, ke_per_m, p) > p.max_noisy_share

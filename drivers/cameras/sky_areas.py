"""Smooth areas that cannot all be the sky. See docs/explanation/open-space.md.

Sky and a blank thing that the upper border of the image cuts, as a slab or a balloon, both are smooth areas that reach that border, and
both may end at the horizon. Where a near outline with a step of brightness separates two such areas, one of them is the thing. The images
do not show which one, so that neither is taken for the sky."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Gray = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_BORDER_ROWS = 8
"""An area that begins within so many rows of the upper border reaches it."""
_LEAST_AREA_PX, _LEAST_OUTLINE_PX = 400, 24
"""Pixels of an area that are as bright in the right image, and pixels of the outline between two areas."""
_MARKS_PX, _STEP_GREY = 8, 4.0
"""Pixels from what is near to the marks of an outline; and least step of brightness across it beyond the greatest slope of a sky."""
_HANGING = 0.25
"""Share of the columns of an area that may lie lower than its end."""
_SAME_END, _BESIDE = 24, 4
"""Two areas end at the same height where their lower ends differ by at most the width of the image over the first number, looked for
within its width over the second one."""


def ambiguous_sky(even: Mask, smooth_left: Mask, near: Mask, left: Gray, slope_grey: float) -> Mask:
    """(H, W) smooth pixels of areas that reach the upper border, of which one at least is no sky. even: (H, W) whether a pixel is smooth;
    smooth_left: the same, whatever the right image shows; near: whether a pixel shows that something is near; left: (H, W) uint8;
    slope_grey: greatest change of grey per pixel of a sky."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(smooth_left.view(np.uint8), connectivity=4)
    area_px = np.bincount(labels[even], minlength=len(stats))
    reaches = (stats[:, cv2.CC_STAT_TOP] < _BORDER_ROWS) & (area_px >= _LEAST_AREA_PX)
    reaches[0] = False
    if not reaches.any():
        return np.zeros_like(even)
    end = int((stats[reaches, cv2.CC_STAT_TOP] + stats[reaches, cv2.CC_STAT_HEIGHT]).max())
    pairs, counts = _separated(labels[:end], reaches, near[:end], left[:end], slope_grey)
    taken = np.zeros(len(stats), np.bool_)
    for (a, b), count in zip(pairs, counts, strict=True):
        if count >= _LEAST_OUTLINE_PX and (_ends_beside(labels, a, b) or _ends_beside(labels, b, a)):
            taken[[a, b]] = True
    return np.asarray(taken[labels])


def _separated(
    labels: NDArray[np.int32], reaches: Mask, near: Mask, left: Gray, slope_grey: float
) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """(pairs of areas (N, 2), pixels of the near outline with a step of brightness between both (N,)). reaches: of each area."""
    width = labels.shape[1]
    columns = np.arange(width, dtype=np.int16)[None, :]
    inside = reaches[labels]
    before = np.maximum.accumulate(np.where(inside, columns, np.int16(-1)), axis=1)
    after = np.minimum.accumulate(np.where(inside, columns, np.int16(2 * width))[:, ::-1], axis=1)[:, ::-1]
    beside = cv2.dilate(near.view(np.uint8), np.ones((1, 2 * _MARKS_PX + 1), np.uint8)).view(np.bool_)
    v, u = np.nonzero(beside & ~inside & (before >= 0) & (after < width))
    one, other = before[v, u].astype(np.intp), after[v, u].astype(np.intp)
    mean = cv2.boxFilter(left, cv2.CV_32F, (5, 5))
    step = np.abs(mean[v, one] - mean[v, other]) > _STEP_GREY + slope_grey * (other - one)
    found = np.sort(np.stack([labels[v, one], labels[v, other]])[:, step].astype(np.int64), axis=0)
    keys, counts = np.unique(found[0] * len(reaches) + found[1], return_counts=True)
    return np.stack(np.divmod(keys, len(reaches)), axis=1), counts


def _ends_beside(labels: NDArray[np.int32], a: int, b: int) -> bool:
    """Whether area a ends at the same height as area b beside it."""
    width = labels.shape[1]
    reach, most = width // _BESIDE, width // _SAME_END
    for row, u in _ends(labels == a):
        first = max(0, u - reach)
        if any(abs(row - other) <= most for other, _ in _ends(labels[:, first : u + reach + 1] == b)):
            return True
    return False


def _ends(area: Mask) -> list[tuple[int, int]]:
    """(row, column) where an area (H, W) ends: its lowest place, and the one that as many columns as _HANGING pass, since a leaf, a chain
    or a pier may belong to it. Empty for an area without pixels."""
    columns = np.flatnonzero(area.any(axis=0))
    lowest = len(area) - 1 - np.argmax(area[::-1, columns], axis=0)
    order = np.argsort(-lowest, kind="stable")
    return [(int(lowest[k]), int(columns[k])) for k in order[[0, int(_HANGING * len(order))]]] if len(order) else []

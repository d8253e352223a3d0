"""An index of intervals on a line: which of them reach a place, without a look at the others."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, kernel

PARTS = 64
"""Equal parts into which the index divides the line."""
_LEAST_WIDTH = 1e-6


class IntervalIndex(NamedTuple):
    """Part k begins at origin + k * width; the intervals that reach it are items[first[k]:first[k + 1]], ascending. first:
    (PARTS + 1,) int64; items: int64."""

    origin: Any
    width: Any
    first: Any
    items: Any


@kernel
def index_intervals(low, high):
    """The index of the intervals low..high, (N,) float64 each, finite."""
    origin, end = 0.0, 0.0
    for n in range(low.shape[0]):
        origin, end = (low[n], high[n]) if n == 0 else (min(origin, low[n]), max(end, high[n]))
    width = max((end - origin) / PARTS, _LEAST_WIDTH)
    first = np.zeros(PARTS + 1, np.int64)
    for n in range(low.shape[0]):
        for k in range(part_of(origin, width, low[n]), part_of(origin, width, high[n]) + 1):
            first[k + 1] += 1
    for k in range(PARTS):
        first[k + 1] += first[k]
    items, used = np.empty(first[PARTS], np.int64), np.zeros(PARTS, np.int64)
    for n in range(low.shape[0]):
        for k in range(part_of(origin, width, low[n]), part_of(origin, width, high[n]) + 1):
            items[first[k] + used[k]] = n
            used[k] += 1
    return IntervalIndex(origin, width, first, items)


@inner
def part_of(origin, width, value):
    """The part that holds a value; the first or last one where it lies outside, the first where it is no number."""
    share = (value - origin) / width
    if not share > 0.0:
        return 0
    return int(share) if share < PARTS else PARTS - 1


@inner
def at_value(index, value):
    """(first, end) in the items of the intervals that may hold a value."""
    k = part_of(index.origin, index.width, value)
    return index.first[k], index.first[k + 1]

"""Common parts of queries about free space: checks of the input, and long segments divided into balls.

A segment is free where each ball of a chain that covers it is. The chain is limited to the box of all known space, and a
bounded number of balls is processed at a time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model import MOST_M

Floats = NDArray[np.float64]
MOST_BALLS = 1 << 18
"""Balls looked at together: about 30 MB of scratch memory."""
MOST_WAY_M = 1e5
"""A longer way is never called free: no sensor sees so far, and its chain of balls would take minutes."""


def checked_radius(radius_m: float) -> float:
    """The radius of a ball, metres. Raises ValueError where it is negative, infinite or not a number."""
    radius = float(radius_m)
    if not 0.0 <= radius < math.inf:
        raise ValueError(f"radius_m = {radius:g}; expected a finite number of metres, 0 or more")
    return radius


def positions(points_m: ArrayLike) -> Floats:
    """(M, 3) float64 of points (M, 3) or one point (3,), metres. What is beyond MOST_M is NaN. Raises ValueError for
    another shape."""
    rows = np.asarray(points_m, np.float64)
    rows = rows[None] if rows.ndim == 1 else rows
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"points of shape {rows.shape}; expected (M, 3): x, y, z in metres")
    return np.where(np.abs(rows) <= MOST_M, rows, np.nan)


def within_box(a: Floats, b: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """(begin (M,), end (M,)): the shares of each way a -> b, each (M, N), that lie in the box low..high, (N,); begin > end:
    none of it does. What is no number lies nowhere."""
    begin, end = np.zeros(len(a)), np.ones(len(a))
    for axis in range(a.shape[1]):
        start, step = a[:, axis], b[:, axis] - a[:, axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = (low[axis] - start) / step, (high[axis] - start) / step
        inside = (start >= low[axis]) & (start <= high[axis])
        still = step == 0.0
        first, last = np.where(still, 0.0, np.minimum(first, last)), np.where(still, 1.0, np.maximum(first, last))
        begin = np.where(still & ~inside, 2.0, np.maximum(begin, first))
        end = np.minimum(end, last)
    return begin, np.where(np.isnan(begin) | np.isnan(end), -1.0, end)


def ways_free(
    a: Floats, b: Floats, low: Floats, high: Floats, step_m: float, free: Callable[[Floats, Floats], NDArray[np.bool_]]
) -> NDArray[np.bool_]:
    """(M,) whether all balls along each way a -> b, each (M, 3), are free.

    low, high: (3,) the box of all that is known; a way that leaves it, or is longer than MOST_WAY_M, is not free. step_m: most between two middles.
    free(middles, step): (K,) answers for middles (K, 3), which are step (K,) apart on their way."""
    known = ((a >= low) & (a <= high) & (b >= low) & (b <= high)).all(axis=1)
    known &= np.linalg.norm(b - a, axis=1) <= MOST_WAY_M
    out = np.zeros(len(a), bool)
    rows = np.flatnonzero(known)
    length = np.linalg.norm(b[rows] - a[rows], axis=1)
    count = np.maximum(1, np.ceil(length / step_m).astype(np.int64))
    ends = np.cumsum(count)
    bad = np.zeros(len(rows), bool)
    total = int(ends[-1]) if len(rows) else 0
    for begin in range(0, total, MOST_BALLS):
        ball = np.arange(begin, min(total, begin + MOST_BALLS))
        way = np.searchsorted(ends, ball, side="right")
        share = (ball - (ends - count)[way] + 0.5) / count[way]
        start, end = a[rows[way]], b[rows[way]]
        answers = free(start + share[:, None] * (end - start), (length / count)[way])
        bad[way[~answers]] = True
    out[rows] = ~bad
    return out

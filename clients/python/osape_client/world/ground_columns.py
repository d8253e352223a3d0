"""The ground of a snapshot: whether a ball touches it, or lies below it.

Each column of cells is solid from its ground's highest point, less its noise, downwards. Where free space was seen below
a ground (under a bridge that was flown over before), the caller lets that be free: a new measurement of the ground takes
away all free space below it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..model import MOST_M
from ..query.ways import within_box
from .snapshot import WorldSnapshot

Floats = NDArray[np.float64]
CELL_M = 0.5
_SIDE = 16
_BLOCK_M = CELL_M * _SIDE
STEP_M = 0.25
"""Not tuning: distance between the samples of a way that are tested."""
_MOST_RADIUS_M = 4.0
"""Not tuning: larger balls touch whatever ground lies in the blocks around them."""
_MOST_SAMPLES = 1 << 16
"""Not tuning: samples looked at together. A longer way among the ground, of 16 km, counts as one that touches it."""
_NEAR = 3
"""Columns to each side of a point among which the nearest ground is looked for."""


class GroundColumns:
    """tops (T, 256): z of the solid in each column of the blocks, of several surfaces above each other the highest; inf:
    none. keys: (T,) sorted codes of the blocks."""

    def __init__(self, snapshot: WorldSnapshot) -> None:
        known = np.zeros(0, np.intp)
        if snapshot.ground is not None:
            known = np.flatnonzero(~np.isnan(snapshot.ground[:, :, 0]).all(axis=1))
        self._keys, row = np.unique(_key(snapshot.blocks[known, :2].astype(np.int64)), return_inverse=True)
        self._tops = np.full((len(self._keys), _SIDE * _SIDE), np.inf)
        if snapshot.ground is not None and len(known):
            ground = snapshot.ground[known].astype(np.float64)
            np.fmin.at(self._tops, row.ravel(), ground[:, :, 0] - ground[:, :, 1])
        self._highest = self._tops.min(axis=1) if len(known) else np.zeros(0)
        # the box of all solid columns, which reach down without end
        self._low, self._high = np.full(3, np.inf), np.array([-np.inf, -np.inf, np.inf])
        if len(known):
            blocks = snapshot.blocks[known, :2].astype(np.float64)
            self._low[:2], self._high[:2] = blocks.min(axis=0) * _BLOCK_M, (blocks.max(axis=0) + 1.0) * _BLOCK_M
            self._low[2] = self._highest.min()

    def balls(self, p: Floats, radius_m: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(below, touching), each (M,): whether any of a ball around points (M, 3) is below the top of a ground, and whether
        that top lies within the ball."""
        below, touching = np.zeros(len(p), bool), np.zeros(len(p), bool)
        rows = np.flatnonzero(self._near(p, p, radius_m))
        if radius_m > _MOST_RADIUS_M:
            below[rows] = touching[rows] = True
        elif len(rows):
            below[rows], touching[rows] = self._columns(p[rows], np.full(len(rows), radius_m))
        return below, touching

    def ways(self, a: Floats, b: Floats, radius_m: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """`balls`, for balls moved from a to b, (M, 3) each: sampled every STEP_M, by balls that cover the whole way."""
        below, touching = np.zeros(len(a), bool), np.zeros(len(a), bool)
        rows = np.flatnonzero(self._near(a, b, radius_m))
        if radius_m > _MOST_RADIUS_M or not len(rows):
            below[rows] = touching[rows] = True
            return below, touching
        begin, end = within_box(a[rows], b[rows], self._low - radius_m, self._high + radius_m)
        rows, begin, end = rows[begin <= end], begin[begin <= end, None], end[begin <= end, None]
        way_m = b[rows] - a[rows]
        starts, ends = a[rows] + begin * way_m, a[rows] + end * way_m
        count = 1 + np.ceil(np.linalg.norm(ends - starts, axis=1) / STEP_M)
        long = count > _MOST_SAMPLES
        below[rows[long]] = touching[rows[long]] = True
        rows, starts, ends, count = rows[~long], starts[~long], ends[~long], count[~long].astype(int)
        for part in np.array_split(np.arange(len(rows)), 1 + int(count.sum()) // _MOST_SAMPLES):
            found = self._sampled(starts[part], ends[part], count[part], radius_m)
            below[rows[part]], touching[rows[part]] = found
        return below, touching

    def _sampled(
        self, a: Floats, b: Floats, count: NDArray[np.int64], radius_m: float
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """`ways` by so many samples of each, larger balls that contain the ball at all places between two of them."""
        way = np.repeat(np.arange(len(a)), count)
        first = np.cumsum(count) - count
        gaps = np.maximum(1, count - 1)
        share = (np.arange(len(way)) - first[way]) / gaps[way]
        grown_m = np.hypot(radius_m, 0.5 * np.linalg.norm(b - a, axis=1) / gaps)
        found = self._columns(a[way] + share[:, None] * (b - a)[way], grown_m[way])
        below, touching = (np.bincount(way, samples, len(a)) > 0 for samples in found)
        return below, touching

    def nearest(self, p: Floats) -> tuple[Floats, Floats]:
        """(distance_m (M,), unit vectors (M, 3)) from points to the nearest ground among the columns within 1.5 m seen from
        above; inf and 0 where there is none."""
        distance_m, towards = np.full(len(p), np.inf), np.zeros((len(p), 3))
        if not len(self._keys):
            return distance_m, towards
        finite = np.asarray(np.isfinite(p).all(axis=1))
        p = np.where(finite[:, None], p, 0.0)
        for dx in range(-_NEAR, _NEAR + 1):
            for dy in range(-_NEAR, _NEAR + 1):
                column = np.floor(p[:, :2] / CELL_M) + np.array([dx, dy])
                step = np.column_stack([_aside(p[:, :2], column), np.maximum(0.0, self._top(column) - p[:, 2])])
                away = np.linalg.norm(step, axis=1)
                nearer = finite & (away < distance_m)
                distance_m[nearer] = away[nearer]
                towards[nearer] = step[nearer] / np.maximum(away[nearer], 1e-12)[:, None]
        return distance_m, towards

    def _near(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether ways may touch a ground: by the highest of the blocks around them."""
        out = np.zeros(len(a), bool)
        if not len(self._keys):
            return out
        finite = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        # no position is farther than MOST_M, and a larger radius reaches no other block
        radius_m = min(radius_m, 3.0 * MOST_M)
        low, high = np.minimum(a, b) - radius_m, np.maximum(a, b) + radius_m
        rows = np.flatnonzero(finite & (high[:, 2] > self._highest.min()))
        first = np.floor(low[rows, :2] / _BLOCK_M).astype(np.int64)
        count = np.floor(high[rows, :2] / _BLOCK_M).astype(np.int64) - first + 1
        long = count.max(axis=1, initial=0) > 8
        out[rows[long]] = True
        for dx in range(int(count[~long, 0].max(initial=0))):
            for dy in range(int(count[~long, 1].max(initial=0))):
                step = np.minimum([dx, dy], count - 1)
                at, there = self._block(first + step)
                out[rows] |= there & (high[rows, 2] > self._highest[at])
        return out

    def _columns(self, p: Floats, radius_m: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """`balls` of radii (M,)."""
        below, touching = np.zeros(len(p), bool), np.zeros(len(p), bool)
        first = np.floor((p[:, :2] - radius_m[:, None]) / CELL_M)
        most = int(2.0 * radius_m.max(initial=0.0) / CELL_M) + 2
        for dx in range(most):
            for dy in range(most):
                column = first + np.array([dx, dy])
                aside2 = (_aside(p[:, :2], column) ** 2).sum(axis=1)
                reach = np.sqrt(np.maximum(0.0, radius_m**2 - aside2))
                top = self._top(column)
                here = (aside2 <= radius_m**2) & (top < p[:, 2] + reach)
                below |= here
                touching |= here & (top > p[:, 2] - reach)
        return below, touching

    def _top(self, column: Floats) -> Floats:
        """(M,) the tops of columns (M, 2) of these indices; inf: none."""
        index = column.astype(np.int64)
        at, there = self._block(index >> 4)
        out = np.full(len(column), np.inf)
        inside = index[there] & 15
        out[there] = self._tops[at[there], inside[:, 0] * _SIDE + inside[:, 1]]
        return out

    def _block(self, block: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """(row, whether there is one) of blocks (M, 2)."""
        key = _key(block)
        at = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
        return at, self._keys[at] == key


def _key(block: NDArray[np.int64]) -> NDArray[np.int64]:
    return (block[:, 0] << 32) + block[:, 1]


def _aside(xy: Floats, column: Floats) -> Floats:
    """(M, 2) the horizontal way from points to the nearest place of their columns."""
    out: Floats = np.clip(xy, column * CELL_M, (column + 1.0) * CELL_M) - xy
    return out

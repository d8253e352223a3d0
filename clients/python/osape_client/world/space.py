"""Three-valued queries of the merged world: free, occupied or unknown, for points, segments and the nearest obstacle.

The answers mean the same as those of query/space.py. Planes are queried exactly; free space by cells: all cells that a ball
reaches into must be free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..query.rectangles import Rectangles, rectangles
from ..query.space import Floats, Occupancies, Occupancy
from ..query.ways import checked_radius, positions, ways_free
from .ground_columns import GroundColumns
from .prisms import way_inside, world_prisms
from .snapshot import WorldSnapshot

CELL_M = 0.5
_SIDE, _TALL = 16, 64
_GROUP = 512
"""Queries beside each other that are held against the planes near all of them."""
_SQUARE_M = 4.0
"""Not tuning: queries are grouped by squares of this side."""
_MOST_CELLS = 1_000_000
"""Columns of a window of free space: beyond it the queries are asked in two halves."""
_MOST_WINDOWS = 16
"""Windows kept for the next queries: at most 128 MB."""
_BLOCK = np.array([_SIDE, _SIDE, _TALL])
_STEP_M = 0.25
"""Middles of the balls along a way are this far apart, or half a radius: half of it is added to the radius."""


class WorldSpace:
    """Queries of a snapshot of the world. radius_m: of balls that contain the vehicle."""

    def __init__(self, snapshot: WorldSnapshot) -> None:
        self.snapshot = snapshot
        self._rectangles: Rectangles = rectangles(
            snapshot.planes.astype(np.float64), snapshot.margin_m.astype(np.float64)
        )
        self.prisms = world_prisms(snapshot.planes, snapshot.margin_m, snapshot.hits)
        self._solids = [prism for prism in self.prisms if prism.closed]
        self._ground = GroundColumns(snapshot)
        self._windows: dict[tuple[int, ...], NDArray[np.uint64]] = {}

    def points(self, points_m: ArrayLike, radius_m: float = 0.0) -> Occupancies:
        """(M,) Occupancy of balls of a radius around points (M, 3) in ned.

        Occupied: a plane is nearer than the radius and its margin, or it lies in a closed prism, or it touches the ground, or
        lies below it where nothing was seen free since. Free: every cell that the ball may reach into was seen free. Raises ValueError for a radius that
        is negative or not finite."""
        radius_m, p = checked_radius(radius_m), positions(points_m)
        out = np.full(len(p), Occupancy.UNKNOWN, np.uint8)
        free = self._free(p, radius_m)
        below, touching = self._ground.balls(p, radius_m)
        out[free] = Occupancy.FREE
        out[touching | (below & ~free) | self._touch(p, p, radius_m)] = Occupancy.OCCUPIED
        return out

    def segments(self, from_m: ArrayLike, to_m: ArrayLike, radius_m: float = 0.0) -> Occupancies:
        """(M,) Occupancy of balls of a radius moved from points (M, 3) to points (M, 3) along straight lines.

        Free: every ball of a chain that covers the way is. A way longer than MOST_WAY_M (query/ways.py) is never free.
        Raises ValueError for a radius that is negative or not finite."""
        radius_m, a, b = checked_radius(radius_m), positions(from_m), positions(to_m)
        if a.shape != b.shape:
            raise ValueError(f"segments: {len(a)} starts and {len(b)} ends; expected as many of each")
        out = np.full(len(a), Occupancy.UNKNOWN, np.uint8)
        below, touching = self._ground.ways(a, b, radius_m)
        touched = touching | self._touch(a, b, radius_m)
        out[touched | below] = Occupancy.OCCUPIED
        rest = np.flatnonzero(~touched)
        if len(rest) and len(self.snapshot.blocks):
            out[rest[self._ways_free(a[rest], b[rest], radius_m)]] = Occupancy.FREE
        return out

    def nearest(self, points_m: ArrayLike) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """(distance_m, direction, plane) of the nearest plane or ground to each point (M, 3): its margin taken off the
        distance, the unit vector (M, 3) towards it, the plane's row in the snapshot. -1: no plane but the ground, or nothing
        at all, with a distance of inf and a direction of 0. The distance of what is no position is 0."""
        p = positions(points_m)
        distance_m, towards, plane = self._rectangles.nearest(p)
        below_m, down = self._ground.nearest(p)
        nearer = below_m < distance_m
        distance_m[nearer], towards[nearer], plane[nearer] = below_m[nearer], down[nearer], -1
        return distance_m, towards, plane

    # ---- planes ---------------------------------------------------------------------------------------------------------

    def _touch(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether each way comes as near to a plane as a radius and its margin, or into a closed prism; asked in
        groups that lie together."""
        out = np.asarray(~(np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)))
        if not len(self._rectangles.corner):
            return out
        good = np.flatnonzero(~out)
        for solid in self._solids:
            out[good] |= way_inside(solid, a[good], b[good], radius_m)
        good = good[~out[good]]
        order = good[np.argsort(_place(0.5 * (a[good] + b[good])), kind="stable")]
        for begin in range(0, len(order), _GROUP):
            rows = order[begin : begin + _GROUP]
            low = np.minimum(a[rows], b[rows]).min(axis=0) - radius_m
            high = np.maximum(a[rows], b[rows]).max(axis=0) + radius_m
            near = np.flatnonzero(
                (self._rectangles.low <= high).all(axis=1) & (self._rectangles.high >= low).all(axis=1)
            )
            if len(near):
                out[rows] = _part(self._rectangles, near).touch(a[rows], b[rows], radius_m)
        return out

    # ---- free space -----------------------------------------------------------------------------------------------------

    def _ways_free(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """Whether each way is covered by free balls, their middles at most a step apart, their radius grown by half."""
        step_m = max(_STEP_M, 0.5 * radius_m)
        low, high = (self.snapshot.blocks.min(axis=0) * _BLOCK), (self.snapshot.blocks.max(axis=0) + 1) * _BLOCK

        def free(middles: Floats, _: Floats) -> NDArray[np.bool_]:
            return self._free(middles, radius_m + 0.5 * step_m)

        return ways_free(a, b, CELL_M * low, CELL_M * high, step_m, free)

    def _free(self, p: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether all cells that the box around each ball reaches into are free."""
        out = np.zeros(len(p), bool)
        blocks = self.snapshot.blocks
        if not len(blocks):
            return out
        low, high = blocks.min(axis=0) * _BLOCK, (blocks.max(axis=0) + 1) * _BLOCK
        with np.errstate(invalid="ignore"):
            first, last = np.floor((p - radius_m) / CELL_M), np.floor((p + radius_m) / CELL_M)
            rows = np.flatnonzero(((first >= low) & (last < high)).all(axis=1))  # what is no number is nowhere
        lowest = first[rows].astype(np.int64)
        size = last[rows].astype(np.int64) - lowest + 1
        # boxes of one radius take n or n + 1 cells along each axis: eight kinds at the most
        kind = (size[:, 0] << 40) + (size[:, 1] << 20) + size[:, 2]
        for k in np.unique(kind):
            on = np.flatnonzero(kind == k)
            out[rows[on]] = self._boxes_free(lowest[on], size[on[0]])
        return out

    def _boxes_free(self, lowest: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(M,) whether all cells of boxes of one size are free; lowest: (M, 3) the least indices of each."""
        if size[2] >= _TALL:
            return np.zeros(len(lowest), bool)  # no view is so tall
        low, high = lowest.min(axis=0), lowest.max(axis=0) + 1
        if (high - low)[0] * (high - low)[1] > _MOST_CELLS:
            axis = int(np.argmax((high - low)[:2]))
            upper = lowest[:, axis] >= (low[axis] + high[axis]) // 2
            out = np.empty(len(lowest), bool)
            for half in (upper, ~upper):
                out[half] = self._boxes_free(lowest[half], size)
            return out
        out = np.zeros(len(lowest), bool)
        layer = lowest[:, 2] >> 6
        for iz in np.unique(layer):
            on = np.flatnonzero(layer == iz)
            window = self._window(low[:2], high[:2], int(iz), size)
            mask = window[lowest[on, 0] - low[0], lowest[on, 1] - low[1]]
            out[on] = (mask >> (lowest[on, 2] & 63).astype(np.uint64)) & np.uint64(1) != 0
        return out

    def _window(
        self, low: NDArray[np.int64], high: NDArray[np.int64], iz: int, size: NDArray[np.int64]
    ) -> NDArray[np.uint64]:
        """Columns low..high - 1 of one layer of blocks: a bit is set where the box from there up is all free."""
        key = (*low.tolist(), *high.tolist(), iz, *size.tolist())
        if key not in self._windows:
            if len(self._windows) >= _MOST_WINDOWS:
                self._windows.clear()
            here, above = (self._dense(low, high + size[:2] - 1, iz + k) for k in (0, 1))
            self._windows[key] = _all_along(
                _all_along(_all_up(here, above, int(size[2])), int(size[0])).T, int(size[1])
            ).T
        return self._windows[key]

    def _dense(self, low: NDArray[np.int64], high: NDArray[np.int64], iz: int) -> NDArray[np.uint64]:
        """Columns low..high - 1 of one layer of blocks as one array; what is not known is not free."""
        b0, b1 = low >> 4, (high - 1) >> 4
        size = (b1 - b0 + 1) * _SIDE
        dense = np.zeros((int(size[0]), int(size[1])), np.uint64)
        blocks = self.snapshot.blocks
        on = np.flatnonzero(
            (blocks[:, 2] == iz) & (blocks[:, :2] >= b0).all(axis=1) & (blocks[:, :2] <= b1).all(axis=1)
        )
        for k in on:
            x, y = ((blocks[k, :2] - b0) * _SIDE).tolist()
            dense[x : x + _SIDE, y : y + _SIDE] = self.snapshot.masks[k].reshape(_SIDE, _SIDE)
        x, y = (low - b0 * _SIDE).tolist()
        return dense[x : x + int(high[0] - low[0]), y : y + int(high[1] - low[1])]


def _all_up(here: NDArray[np.uint64], above: NDArray[np.uint64], cells: int) -> NDArray[np.uint64]:
    """Bits that are set with the cells - 1 after them, fewer than _TALL, across the border to the next layer of blocks."""
    out = here.copy()
    for k in range(1, cells):
        out &= (here >> np.uint64(k)) | (above << np.uint64(_TALL - k))
    return out


def _all_along(mask: NDArray[np.uint64], cells: int) -> NDArray[np.uint64]:
    """Bits that are set in a row and in the cells - 1 rows after it."""
    rows = len(mask) - cells + 1
    out = mask[:rows].copy()
    for k in range(1, cells):
        out &= mask[k : k + rows]
    return out


def _place(p: Floats) -> NDArray[np.int64]:
    """A number that is alike for points that lie together: rows of squares, there and back."""
    square = np.floor(np.clip(p[:, :2], -1e7, 1e7) / _SQUARE_M).astype(np.int64)
    return square[:, 0] * (1 << 24) + np.where(square[:, 0] & 1, -square[:, 1], square[:, 1])


def _part(r: Rectangles, rows: NDArray[np.intp]) -> Rectangles:
    return Rectangles(r.corner[rows], r.along[rows], r.height[rows], r.margin_m[rows], r.low[rows], r.high[rows])

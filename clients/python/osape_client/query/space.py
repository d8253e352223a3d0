"""Queries of the models of one moment: free, occupied or unknown, for points, segments and the nearest obstacle.

The sources are planes with their margins and, for each camera, the space that it observed to be free. Occupied outranks
free; everything else is unknown: behind a plane, outside the view, not measured. A caller that accepts presumptions can ask
for a fourth answer, open: not measured, presumed free on the evidence of the image. Without `allow_open` it is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model import CameraModel, FreeProfile
from .rectangles import Rectangles, rectangles
from .solid_ground import solid_ground
from .ways import checked_radius, positions, ways_free

Floats = NDArray[np.float64]
Occupancies = NDArray[np.uint8]
_CHUNK = 4096
"""Not tuning: queries processed together; few enough for the processor's cache."""


class Occupancy(IntEnum):
    """State of a place. UNKNOWN is 0, so that a zero-initialised array is unknown."""

    UNKNOWN = 0
    FREE = 1
    OCCUPIED = 2
    OPEN = 3
    """Presumed free without a measurement, in part at least. Returned only where the caller sets `allow_open`."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedModel:
    """The model of one camera, in the common frame. place_m: position of the camera, from which its ranges count."""

    model: CameraModel
    place_m: tuple[float, float, float]


class Space:
    """Queries of the models of several cameras at one moment. Models that are not valid are left out."""

    def __init__(self, parts: Sequence[PlacedModel]) -> None:
        valid = [p for p in parts if p.model.valid]
        self._parts = valid
        planes = np.concatenate([np.zeros((0, 6)), *(p.model.planes.astype(np.float64) for p in valid)])
        margins = np.concatenate([np.zeros(0), *(p.model.margin_m.astype(np.float64) for p in valid)])
        self._rectangles: Rectangles = rectangles(planes, margins)
        self._grounds = [solid_ground(p.model.ground, p.model.free, p.place_m) for p in valid]

    @property
    def knows(self) -> bool:
        """Whether at least one model is valid; otherwise everything is unknown."""
        return bool(self._parts)

    def points(self, points_m: ArrayLike, radius_m: float = 0.0, *, allow_open: bool = False) -> Occupancies:
        """(M,) Occupancy of balls of a radius around points (M, 3) of the common frame.

        Occupied: a plane is nearer than the radius and its margin, or the ball touches the ground, or is below it, where a
        camera measured the ground. Free: the whole ball lies within what one camera observed to be free, above that camera's
        ground. Open, with allow_open: the whole ball lies within what one camera observed to be free or presumes free. Raises ValueError for a radius that is negative or not finite."""
        radius_m, p = checked_radius(radius_m), positions(points_m)
        out = np.full(len(p), Occupancy.UNKNOWN, np.uint8)
        if allow_open:
            out[self._free(p, np.full(len(p), radius_m), allow_open=True)] = Occupancy.OPEN
        out[self._free(p, np.full(len(p), radius_m))] = Occupancy.FREE
        out[self._touch(p, p, radius_m)] = Occupancy.OCCUPIED
        return out

    def segments(
        self, from_m: ArrayLike, to_m: ArrayLike, radius_m: float = 0.0, *, allow_open: bool = False
    ) -> Occupancies:
        """(M,) Occupancy of balls of a radius moved from points (M, 3) to points (M, 3) along straight lines.

        Free: every ball of a chain that covers the way is. Open, with allow_open: every such ball is free or open. A way longer than MOST_WAY_M (ways.py) is never free.
        Raises ValueError for a radius that is negative or not finite."""
        radius_m, a, b = checked_radius(radius_m), positions(from_m), positions(to_m)
        if a.shape != b.shape:
            raise ValueError(f"segments: {len(a)} starts and {len(b)} ends; expected as many of each")
        out = np.full(len(a), Occupancy.UNKNOWN, np.uint8)
        touched = self._touch(a, b, radius_m)
        out[touched] = Occupancy.OCCUPIED
        rest = np.flatnonzero(~touched)
        if len(rest) and self._parts:
            if allow_open:
                out[rest[self._ways_free(a[rest], b[rest], radius_m, allow_open=True)]] = Occupancy.OPEN
            out[rest[self._ways_free(a[rest], b[rest], radius_m)]] = Occupancy.FREE
        return out

    def nearest(self, points_m: ArrayLike) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """(distance_m, direction, plane) of the nearest plane or measured ground to each point (M, 3): its margin taken off
        the distance, the unit vector (M, 3) towards it, the plane's number in the order of the parts. -1: the ground,
        or nothing, with a distance of inf and a direction of 0. The distance of what is no position is 0."""
        p = positions(points_m)
        distance_m, towards, plane = self._rectangles.nearest(p)
        for ground in self._grounds:
            below_m, down = ground.nearest(p)
            nearer = below_m < distance_m
            distance_m[nearer], towards[nearer], plane[nearer] = below_m[nearer], down[nearer], -1
        return distance_m, towards, plane

    def _touch(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether each way comes as near to a plane as a radius and its margin, or touches a measured ground."""
        out = self._rectangles.touch(a, b, radius_m)
        for ground in self._grounds:
            rest = np.flatnonzero(~out)
            out[rest] = ground.touch(a[rest], b[rest], radius_m)
        return out

    def _ways_free(self, a: Floats, b: Floats, radius_m: float, allow_open: bool = False) -> NDArray[np.bool_]:
        """Whether each way is covered by free balls: their middles a step apart, their radius grown by half of one."""
        reach = np.array([p.model.free.free_to_m.max(initial=0.0) for p in self._parts], np.float64)
        if allow_open:
            opened = [p.model.free.open_to_m.max(initial=0.0) for p in self._parts]
            reach = np.maximum(reach, np.array(opened, np.float64))
        place = np.array([p.place_m for p in self._parts])
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        low[:2], high[:2] = (place[:, :2] - reach[:, None]).min(axis=0), (place[:, :2] + reach[:, None]).max(axis=0)

        def free(middles: Floats, step: Floats) -> NDArray[np.bool_]:
            return self._free(middles, radius_m + 0.5 * step, allow_open)

        return ways_free(a, b, low, high, max(0.1, radius_m), free)

    def _free(self, p: Floats, radius_m: Floats, allow_open: bool = False) -> NDArray[np.bool_]:
        out = np.zeros(len(p), bool)
        for part, ground in zip(self._parts, self._grounds, strict=True):
            for begin in range(0, len(p), _CHUNK):
                rows = slice(begin, begin + _CHUNK)
                out[rows] |= ground.clear(p[rows], radius_m[rows]) & balls_free(
                    part.model.free, part.place_m, p[rows], radius_m[rows], allow_open
                )
        return out


def balls_free(
    free: FreeProfile, place_m: tuple[float, float, float], p: Floats, radius_m: Floats, allow_open: bool = False
) -> NDArray[np.bool_]:
    """(M,) whether each whole ball is free in a profile, or with allow_open free or open: every direction and layer that it
    reaches into, over the ranges that it takes there. A ball around the camera's axis reaches into every direction, and is not."""
    edges, layers = free.azimuth_edges_rad.astype(np.float64), free.layer_edges_m.astype(np.float64)
    x, y = p[:, 0] - place_m[0], p[:, 1] - place_m[1]
    range_m = np.hypot(x, y)
    finite = np.isfinite(p).all(axis=1) & np.isfinite(radius_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.arcsin(np.clip(radius_m / range_m, 0.0, 1.0))
    low = np.mod(np.arctan2(y, x) - half - edges[0], math.tau) + edges[0]  # edges are not wrapped to one turn
    d0 = np.searchsorted(edges, low, side="right") - 1
    d1 = np.searchsorted(edges, low + 2.0 * half, side="left") - 1
    l0 = np.searchsorted(layers, p[:, 2] - radius_m, side="right") - 1
    l1 = np.searchsorted(layers, p[:, 2] + radius_m, side="left") - 1
    d1, l1 = np.maximum(d1, d0), np.maximum(l1, l0)
    ok: NDArray[np.bool_] = (
        finite & (range_m > radius_m) & (d0 >= 0) & (d1 < len(edges) - 1) & (l0 >= 0) & (l1 < len(layers) - 1)
    )
    rows = np.flatnonzero(ok)
    if not len(rows):
        return ok
    near, far = (range_m - radius_m)[rows], (range_m + radius_m)[rows]
    good = np.ones(len(rows), bool)
    for dd in range(int((d1 - d0)[rows].max()) + 1):
        for ll in range(int((l1 - l0)[rows].max()) + 1):
            d, layer = np.minimum(d0[rows] + dd, d1[rows]), np.minimum(l0[rows] + ll, l1[rows])
            here = (near >= free.free_from_m[d, layer]) & (far <= free.free_to_m[d, layer])
            if allow_open and free.has_open:
                here |= (near >= free.open_from_m[d, layer]) & (far <= free.open_to_m[d, layer])
            good &= here
    ok[rows] = good
    return ok

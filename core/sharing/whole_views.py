"""Which own obstacles of the size of a vehicle were observed whole.

The border of the image cuts an object, which the model states, or a nearer obstacle hides a part of it, which it does
not. What is left of a person can have the size of a vehicle of the team. Such an object is marked, and then never taken
for a vehicle.

A vehicle is often observed as several planes at different distances, which hide each other. An object counts as whole if,
together with the outlines of all that may hide a part of it, it is not larger than a vehicle: what is hidden lies behind them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..types import PlaneFlags
from .bodies import MOST_HALF_HEIGHT_M, Body
from .records import PLANE_IDS, SharedMover, SharedPlanes

Floats = NDArray[np.float64]
FRESH_S = 0.5
"""An obstacle of this age was observed from the present place. An older one keeps what was found before."""
BESIDE_M = 0.4
"""A nearer obstacle whose outline comes this near to that of another, as the vehicle sees both, may hide a part of it."""
NEARER_M = 0.5
"""Sides of one object are not that much nearer than each other."""
MOST_NEARER = 300
"""Number of the obstacles that are compared, the first ones: planes are offered with the nearest first."""
_LEAST_M = 0.1


class WholeViews:
    """Marks planes and moving obstacles that may be larger than they were observed."""

    def __init__(self) -> None:
        self._partial = np.ones(PLANE_IDS, bool)
        self._partial_movers: dict[int, bool] = {}
        self._section = -1

    def planes(
        self, planes: SharedPlanes, eye_m: tuple[float, float, float], section: int, others: Sequence[Body] = ()
    ) -> SharedPlanes:
        """Returns the planes, nearest first, with CUT_BOTTOM for low ones that were not observed whole. eye_m: own place;
        section: number of the own frame, in which ids have a meaning; others: the other vehicles."""
        if section != self._section:
            self._section = section
            self._partial[:] = True
        gone = np.ones(PLANE_IDS, bool)
        gone[planes.ids] = False
        self._partial[gone] = True
        low = planes.box[:, 5] - planes.box[:, 4] <= 2.0 * MOST_HALF_HEIGHT_M
        fresh = np.flatnonzero(low & (planes.age_s <= FRESH_S))
        sizes_m = _vehicle_sizes_m(others, planes.margin_m[fresh])
        self._partial[planes.ids[fresh]] = partly_hidden(planes.box[fresh], planes.box[:MOST_NEARER], eye_m, sizes_m)
        partial = low & self._partial[planes.ids]
        flags = planes.flags | np.where(partial, int(PlaneFlags.CUT_BOTTOM), 0).astype(np.uint8)
        return replace(planes, flags=flags)

    def movers(
        self,
        movers: tuple[SharedMover, ...],
        box: Floats,
        eye_m: tuple[float, float, float],
        others: Sequence[Body] = (),
    ) -> tuple[SharedMover, ...]:
        """Returns the moving obstacles with `partial` of those that were not observed whole. box: (M, 6) the own planes,
        nearest first; others: the other vehicles."""
        sizes_m = _vehicle_sizes_m(others, np.array([2.0 * m.sigma_m for m in movers]))
        hidden = partly_hidden(_facing(movers, eye_m), box[:MOST_NEARER], eye_m, sizes_m)
        before, self._partial_movers = self._partial_movers, {}
        found = []
        for m, is_hidden in zip(movers, hidden.tolist(), strict=True):
            partial = m.partial or (is_hidden if m.age_s <= FRESH_S else before.get(m.id, True))
            self._partial_movers[m.id] = partial
            found.append(replace(m, partial=partial))
        return tuple(found)


def partly_hidden(
    box: Floats, others: Floats, eye_m: tuple[float, float, float], sizes_m: Floats | None = None
) -> NDArray[np.bool_]:
    """Returns (N,): which planes (N, 6) have the outline of a nearer one of others (M, 6) on or beside their own, as
    seen from a place.

    sizes_m: (N, 2) width and height up to which a plane counts as whole, together with all such outlines and those beside
    them; None: 0."""
    if not len(box) or not len(others):
        return np.zeros(len(box), bool)
    middle = 0.5 * (box[:, 0:2] + box[:, 2:4]) - eye_m[:2]
    range_m = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), _LEAST_M)
    forward = middle / range_m[:, None]
    most = np.zeros((len(box), 2)) if sizes_m is None else sizes_m / range_m[:, None]
    low, high = (o[:, 0] for o in _outlines(box[:, None], forward, eye_m))
    low[:, 1], high[:, 1] = ((box[:, k] - eye_m[2]) / range_m for k in (4, 5))
    hidden, rows = np.zeros(len(box), bool), np.arange(len(box))
    while len(rows):
        hides = _hides(others, low[rows], high[rows], forward[rows], range_m[rows], eye_m)
        hidden[rows] = hides.any(axis=1)
        small = hidden[rows] & (high[rows] - low[rows] <= most[rows]).all(axis=1)
        rows, hides = rows[small], hides[small, :, None]
        others_low, others_high = _outlines(others[None], forward[rows], eye_m)
        joint_low = np.minimum(low[rows], np.where(hides, others_low, np.inf).min(axis=1))
        joint_high = np.maximum(high[rows], np.where(hides, others_high, -np.inf).max(axis=1))
        fits = (joint_high - joint_low <= most[rows]).all(axis=1)
        grows = fits & ((joint_low != low[rows]) | (joint_high != high[rows])).any(axis=1)
        hidden[rows[fits & ~grows]] = False
        rows = rows[grows]
        low[rows], high[rows] = joint_low[grows], joint_high[grows]
    return hidden


def _vehicle_sizes_m(others: Sequence[Body], error_m: Floats) -> Floats:
    """Returns (N, 2) the width and height that reports of all other vehicles may have; 0 without vehicles. error_m: (N,) of
    each report."""
    sizes_m = [2.0 * body.most_half_size_m(error_m) for body in others]
    return np.min(sizes_m, axis=0) if sizes_m else np.zeros((len(error_m), 2))


def _hides(
    others: Floats, low: Floats, high: Floats, forward: Floats, range_m: Floats, eye_m: tuple[float, float, float]
) -> NDArray[np.bool_]:
    """Returns (N, M): which of others (M, 6) have a part nearer than range_m (N,) on or beside an outline, see `_outlines`."""
    grown = BESIDE_M / range_m
    depth_m = _depths_in_wedge(others, forward, low[:, 0] - grown, high[:, 0] + grown, eye_m)
    nearer = np.min(depth_m, axis=0) < (range_m - NEARER_M)[:, None]  # False for NaN
    top = (others[:, 4] - eye_m[2]) / depth_m
    bottom = (others[:, 5] - eye_m[2]) / depth_m
    beside = (np.min(top, axis=0) <= (high[:, 1] + grown)[:, None]) & (
        np.max(bottom, axis=0) >= (low[:, 1] - grown)[:, None]
    )
    return np.asarray(nearer & beside)


def _outlines(box: Floats, forward: Floats, eye_m: tuple[float, float, float]) -> tuple[Floats, Floats]:
    """Returns the tangents (left, top) and (right, bottom), each (N, M, 2), of planes (N or 1, M, 6) in N directions (N, 2)."""
    ends = np.stack([_in_view(box[..., k : k + 2], forward, eye_m) for k in (0, 2)])
    ahead_m = np.maximum(ends[..., 0], _LEAST_M)
    side, top, bottom = ends[..., 1] / ahead_m, (box[..., 4] - eye_m[2]) / ahead_m, (box[..., 5] - eye_m[2]) / ahead_m
    low = np.stack([side.min(axis=0), top.min(axis=0)], axis=-1)
    return low, np.stack([side.max(axis=0), bottom.max(axis=0)], axis=-1)


def _in_view(points: Floats, forward: Floats, eye_m: tuple[float, float, float]) -> Floats:
    """Returns (N, M, 2) distance forward and to the side of points (N or 1, M, 2) for N directions (N, 2)."""
    off = points - np.array(eye_m[:2])
    fx, fy = forward[:, 0, None], forward[:, 1, None]
    return np.stack([off[..., 0] * fx + off[..., 1] * fy, off[..., 1] * fx - off[..., 0] * fy], axis=-1)


def _depths_in_wedge(
    box: Floats, forward: Floats, low: Floats, high: Floats, eye_m: tuple[float, float, float]
) -> Floats:
    """Returns (2, N, M) distances forward of both ends of the part of each plane (M, 6) that lies in each of N wedges;
    NaN: none does.

    low, high: (N,) tangents of the sides of the wedges."""
    begin, end = (_in_view(box[None, :, k : k + 2], forward, eye_m) for k in (0, 2))
    first, last = np.zeros(begin.shape[:2]), np.ones(begin.shape[:2])
    for ahead, aside in ((low, -1.0), (high, 1.0)):
        # inside: aside * (tangent * forward - side) >= 0, linear along the plane
        inside = [aside * (ahead[:, None] * e[..., 0] - e[..., 1]) for e in (begin, end)]
        first, last = _clip(inside[0], inside[1], first, last)
    first, last = _clip(begin[..., 0] - _LEAST_M, end[..., 0] - _LEAST_M, first, last)
    depth_m = np.stack([begin[..., 0] + u * (end[..., 0] - begin[..., 0]) for u in (first, last)])
    return np.where(first <= last, depth_m, np.nan)


def _clip(at_begin: Floats, at_end: Floats, first: Floats, last: Floats) -> tuple[Floats, Floats]:
    """Returns the range of shares of each plane in which a value that is linear along it is not negative."""
    change = at_end - at_begin
    zero = -at_begin / np.where(change == 0.0, 1.0, change)
    first = np.where(change > 0.0, np.maximum(first, zero), first)
    last = np.where(change < 0.0, np.minimum(last, zero), last)
    return first, np.where((change == 0.0) & (at_begin < 0.0), -1.0, last)


def _facing(movers: tuple[SharedMover, ...], eye_m: tuple[float, float, float]) -> Floats:
    """Returns (N, 6) planes as wide and high as the boxes of moving obstacles, across the direction in which they are
    seen."""
    box = np.zeros((len(movers), 6))
    for k, m in enumerate(movers):
        x, y, z = m.centre_m
        half_m = math.hypot(m.half_size_m[0], m.half_size_m[1])
        away_m = max(math.hypot(x - eye_m[0], y - eye_m[1]), _LEAST_M)
        dx, dy = -half_m * (y - eye_m[1]) / away_m, half_m * (x - eye_m[0]) / away_m
        box[k] = x - dx, y - dy, x + dx, y + dy, z - m.half_size_m[2], z + m.half_size_m[2]
    return box

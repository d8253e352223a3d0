"""The ground of one camera as a solid: below it nothing is free, and what touches it where it was measured is occupied.

The service judges a layer of the free-range profile only down to a clearance above the ground, but the edges of layers are
fixed heights, so part of a free layer may lie inside the ground. Queries exclude that part here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model import FreeProfile, Ground
from .ways import within_box

Floats = NDArray[np.float64]
STEP_M = 0.2
"""Not tuning: distance between the samples of a way that are tested against the ground."""
_MOST_SAMPLES, _WAYS = 1024, 1024
"""Not tuning: samples of one way, and ways that are looked at together: about 100 MB of scratch memory at the most."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidGround:
    """The ground that one camera measured, in a common frame. place_m: of the camera; edges_rad: (D + 1,) azimuths of its
    free-range profile, from_m, to_m: (D,) horizontal ranges at which the ground was measured."""

    ground: Ground
    place_m: tuple[float, float, float]
    edges_rad: Floats
    from_m: Floats
    to_m: Floats

    def clear(self, p: Floats, radius_m: Floats | float) -> NDArray[np.bool_]:
        """(M,) whether balls around points (M, 3) lie above the ground by its tolerance and noise, the plane being extended
        to all sides: lower nothing is free. All, where no ground was found."""
        if not self.ground.seen:
            return np.ones(len(p), bool)
        margin_m = np.maximum(self.ground.tolerance_m, self.ground.noise_per_m * (self._range_m(p) + radius_m))
        return np.asarray(self._height_m(p) >= self._steep * radius_m + margin_m)

    def touch(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) whether balls moved from a (M, 3) to b (M, 3) touch the ground, or lie below it, where it was measured.

        Its noise belongs to the ground. Ways are sampled every STEP_M."""
        out = np.zeros(len(a), bool)
        if not (self.to_m > self.from_m).any():
            return out
        reach_m = float(self.to_m.max()) + radius_m
        place = np.array(self.place_m[:2])
        begin, end = within_box(a[:, :2], b[:, :2], place - reach_m, place + reach_m)
        # height above a plane is linear along a way: only what lies lower than this can touch
        most_m = self._steep * radius_m + self.ground.noise_per_m * (reach_m + radius_m)
        above = np.column_stack([self._height_m(a), self._height_m(b)])
        lower = within_box(above[:, :1], above[:, 1:], np.array([-np.inf]), np.array([most_m]))
        begin, end = np.maximum(begin, lower[0]), np.minimum(end, lower[1])
        low = np.flatnonzero(begin <= end)
        for first in range(0, len(low), _WAYS):
            rows = low[first : first + _WAYS]
            way = b[rows] - a[rows]
            starts, ends = a[rows] + begin[rows, None] * way, a[rows] + end[rows, None] * way
            out[rows] = self._way_touches(starts, ends, radius_m)
        return out

    def _way_touches(self, a: Floats, b: Floats, radius_m: float) -> NDArray[np.bool_]:
        """(M,) `touch` of ways near the ground. Where a way is too long for samples every STEP_M, its ball is as much larger."""
        length_m = np.linalg.norm(b - a, axis=1)
        gaps = np.minimum(np.ceil(length_m / STEP_M), _MOST_SAMPLES).astype(int)
        grown_m = radius_m + 0.5 * np.maximum(0.0, length_m / np.maximum(gaps, 1) - STEP_M)
        count = 1 + gaps
        way = np.repeat(np.arange(len(a)), count)
        first = np.cumsum(count) - count
        share = (np.arange(len(way)) - first[way]) / np.maximum(1, gaps)[way]
        points = a[way] + share[:, None] * (b - a)[way]
        return np.asarray(np.bincount(way, self._touched(points, grown_m[way]), len(a)) > 0)

    def nearest(self, p: Floats) -> tuple[Floats, Floats]:
        """(distance_m (M,) to the measured ground less its noise, unit vectors (M, 3) towards it); inf and 0 without one.

        Straight to the plane where it was measured there, else to the middle line of the nearest direction."""
        distance_m, towards = np.full(len(p), np.inf), np.zeros((len(p), 3))
        on = np.flatnonzero(self.to_m > self.from_m)
        if not len(on):
            return distance_m, towards
        middle = 0.5 * (self.edges_rad[on] + self.edges_rad[on + 1])
        ways = np.column_stack([np.cos(middle), np.sin(middle)])
        starts, ends = (self._on_plane(ways * reach[on, None]) for reach in (self.from_m, self.to_m))
        along = ends - starts
        length2 = np.maximum((along**2).sum(axis=1), 1e-12)
        for i in range(len(p)):
            share = np.clip(((p[i] - starts) * along).sum(axis=1) / length2, 0.0, 1.0)
            feet = starts + share[:, None] * along
            foot = p[i] + self._height_m(p[i : i + 1])[0] / self._steep * self._down
            if self._measured(foot[None], 0.0)[0]:
                feet = np.concatenate([feet, foot[None]])
            step = feet - p[i]
            away = np.linalg.norm(step, axis=1)
            k = int(np.argmin(away))
            noise_m = self.ground.noise_per_m * float(self._range_m(feet[k : k + 1])[0])
            distance_m[i] = max(0.0, away[k] - noise_m)
            if self._height_m(p[i : i + 1])[0] < noise_m and self._measured(p[i : i + 1], 0.0)[0]:
                distance_m[i] = 0.0  # inside of it
            towards[i] = step[k] / away[k] if away[k] > 0.0 else 0.0
        return distance_m, towards

    @property
    def _steep(self) -> float:
        """Metres straight down to the plane for each metre square to it."""
        return math.hypot(1.0, self.ground.slope_x, self.ground.slope_y)

    @property
    def _down(self) -> Floats:
        """(3,) unit vector into the ground, square to it."""
        return np.array([-self.ground.slope_x, -self.ground.slope_y, 1.0]) / self._steep

    def _range_m(self, p: Floats) -> Floats:
        out: Floats = np.hypot(p[:, 0] - self.place_m[0], p[:, 1] - self.place_m[1])
        return out

    def _height_m(self, p: Floats) -> Floats:
        """(M,) straight up from the plane to points."""
        g, (x, y, z) = self.ground, self.place_m
        out: Floats = z + g.height_m + g.slope_x * (p[:, 0] - x) + g.slope_y * (p[:, 1] - y) - p[:, 2]
        return out

    def _on_plane(self, xy: Floats) -> Floats:
        """(M, 3) the points of the plane at (M, 2) from the camera's foot."""
        g, (x, y, z) = self.ground, self.place_m
        height = z + g.height_m + g.slope_x * xy[:, 0] + g.slope_y * xy[:, 1]
        return np.column_stack([x + xy[:, 0], y + xy[:, 1], height])

    def _measured(self, p: Floats, radius_m: Floats | float) -> NDArray[np.bool_]:
        """(M,) whether the ground was measured anywhere below or above balls around points."""
        x, y = p[:, 0] - self.place_m[0], p[:, 1] - self.place_m[1]
        range_m = np.hypot(x, y)
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.where(range_m > radius_m, np.arcsin(np.clip(radius_m / range_m, 0.0, 1.0)), np.pi)
        first, last = self.edges_rad[0], self.edges_rad[-1]
        low = np.mod(np.arctan2(y, x) - half - first, math.tau) + first  # edges are not wrapped to one turn
        out = np.zeros(len(p), bool)
        for turn in (0.0, -math.tau):  # a ball that begins left of the first direction may reach into it
            begin = np.maximum(low + turn, first)
            end = np.minimum(low + turn + 2.0 * half, last)
            d0 = np.clip(np.searchsorted(self.edges_rad, begin, side="right") - 1, 0, len(self.to_m) - 1)
            d1 = np.clip(np.searchsorted(self.edges_rad, end, side="left") - 1, d0, len(self.to_m) - 1)
            inside = end >= begin
            for step in range(int((d1 - d0)[inside].max(initial=-1)) + 1):
                d = np.minimum(d0 + step, d1)
                near = (range_m + radius_m >= self.from_m[d]) & (range_m - radius_m <= self.to_m[d])
                out |= inside & near & (self.to_m[d] > self.from_m[d])
        return out

    def _touched(self, p: Floats, radius_m: Floats) -> NDArray[np.bool_]:
        """(M,) whether balls around points touch the ground, or lie below it, where it was measured."""
        noise_m = self.ground.noise_per_m * (self._range_m(p) + radius_m)
        out = np.asarray(self._height_m(p) < self._steep * radius_m + noise_m)
        rows = np.flatnonzero(out)
        out[rows] = self._measured(p[rows], radius_m[rows])
        return out


def solid_ground(ground: Ground, free: FreeProfile, place_m: tuple[float, float, float]) -> SolidGround:
    """The ground of a frame's model; one without ranges, or whose ranges do not fit the profile, was measured nowhere."""
    count = len(free.azimuth_edges_rad) - 1
    fits = ground.seen and len(ground.seen_from_m) == len(ground.seen_to_m) == count
    nothing = (0.0,) * count
    return SolidGround(
        ground,
        place_m,
        free.azimuth_edges_rad.astype(np.float64),
        np.array(ground.seen_from_m if fits else nothing),
        np.array(ground.seen_to_m if fits else nothing),
    )

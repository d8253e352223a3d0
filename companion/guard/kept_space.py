"""Free space of earlier sights, as it counts along the path of the newest one.

The corridor of an earlier sight lies slightly beside, above or below that of the newest sight. As a whole it counts
as far as it lies within a tolerance. In addition the sights complete each other ray by ray, because holes of the
depth image are at other places in each frame. A ray of an earlier sight then lies between two rays of the newest one.
It counts as far as its neighbours were seen free, too, and only if it is displaced by at most half of the distance
between two rays: otherwise two sights, displaced to opposite sides, would make space free that neither has measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..autopilot.polar_histogram import inner_heights
from ..config.avoidance import AvoidParams
from ..config.guard import GuardParams
from .corridor import ACROSS, common_free_m, half_width_m, seen_at_heights_m
from .path_sight import PathSight

Floats = NDArray[np.float64]
NEWEST_SHARE = 0.5
"""Part of the share of rays that must be free which the newest sight must show alone: frames of a net or a bush may
each show other gaps."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Greatest displacement at which an earlier corridor counts."""

    beside_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Grid:
    """Rays of a corridor."""

    heights: int  # number of heights, each with ACROSS rays
    inner: slice  # heights of which each must be seen free
    within: Tolerance  # greatest displacement at which the rays of an eroded sight count


@dataclass(frozen=True, slots=True)
class Kept:
    """A sight, and the distance flown since."""

    sight: PathSight
    way_m: float


def grid_of(avoid: AvoidParams, guard: GuardParams) -> Grid:
    """Returns the rays of a configuration.

    They count within half of the distance between two rays, so that sights displaced to opposite sides are at most
    one distance apart."""
    spacing_m = 2.0 * half_width_m(avoid, guard) / (ACROSS - 1)
    slice_m = (avoid.band_above_m + avoid.band_below_m) / avoid.slices
    within = Tolerance(min(guard.side_m, 0.5 * spacing_m), 0.5 * slice_m)
    return Grid(avoid.slices, inner_heights(avoid), within)


def reach_m(sight: PathSight, newest: PathSight, within: Tolerance, ahead: bool = False) -> float:
    """Returns the distance to which the corridor of a sight lies within a tolerance of that of the newest one.

    ahead: along the course that follows in a turn."""
    if sight is newest:
        return math.inf
    if sight.course_rad is None or newest.course_rad is None or not _one_estimate(sight, newest):
        return 0.0
    beside_m, height_m = 0.0, 0.0
    if sight.position_ned_m is not None and newest.position_ned_m is not None:
        north_m, east_m, down_m = (b - a for a, b in zip(sight.position_ned_m, newest.position_ned_m, strict=True))
        cos, sin = math.cos(newest.course_rad), math.sin(newest.course_rad)
        beside_m = abs(cos * east_m - sin * north_m)
        height_m = abs(down_m - newest.slope * (cos * north_m + sin * east_m))
    turned = sight.course_rad - newest.course_rad
    if ahead:
        turned += sight.ahead_rad - newest.ahead_rad
    if math.cos(turned) <= 0.0:  # the opposite direction: its sine is small too
        return 0.0
    return min(
        max(0.0, within.beside_m - beside_m) / max(abs(math.sin(turned)), 1e-6),
        max(0.0, within.height_m - height_m) / max(abs(sight.slope - newest.slope), 1e-6),
    )


def _one_estimate(a: PathSight, b: PathSight) -> bool:
    """True if neither the position nor the heading has jumped between two sights: their corridors can be compared."""
    (section_a, heading_a), (section_b, heading_b) = a.estimate, b.estimate
    return heading_a == heading_b and (section_a == section_b or section_a is None or section_b is None)


def kept_free_m(newest: Kept, older: Sequence[Kept], grid: Grid, clear_share: float, since_ns: int) -> float:
    """Returns the distance to which clear_share of the rays and each inner height are free, by the newest sight or an
    earlier one; 0 without rays. since_ns: oldest exposure of an earlier frame that counts; the caller has applied it to `older`."""
    now_m = newest.sight.rays_free_m
    if now_m is None:
        return 0.0
    now_m = now_m - newest.way_m
    together_m = now_m
    if newest.sight.kept_rays:  # the same rays, seen by earlier frames
        older = ()
        for rays in newest.sight.kept_rays:
            if rays.exposed_ns >= since_ns:
                together_m = np.maximum(together_m, rays.free_m - newest.way_m)
    for kept in older:
        if kept.sight.rays_free_m is not None:
            counted_m = np.minimum(
                eroded(kept.sight.rays_free_m, grid.heights), reach_m(kept.sight, newest.sight, grid.within)
            )
            together_m = np.maximum(together_m, counted_m - kept.way_m)
    return min(
        common_free_m(together_m, clear_share),
        seen_at_heights_m(together_m, grid.inner),
        common_free_m(now_m, NEWEST_SHARE * clear_share),
    )


def eroded(rays_m: Floats, heights: int) -> Floats:
    """Returns for each ray, (N,), the distance to which it and its neighbours beside, above and below were seen free."""
    padded = np.pad(rays_m.reshape(heights, -1), 1, mode="edge")
    rows, columns = padded.shape[0] - 2, padded.shape[1] - 2
    around = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    out: Floats = np.min(around, axis=0).ravel()
    return out

"""Distances around the vehicle in 72 sectors of 5 degrees, from the models of the cameras, as OBSTACLE_DISTANCE needs
them.

Coordinates are in `level` at the moment of sending: origin of frd, x along the vehicle's heading, y right, z down.
Sector i is centred on i * 5 degrees clockwise from the nose. It contains an obstacle at a distance, was seen to be
clear, or is unseen; an unseen sector is never clear."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel

from ..config.avoidance import AvoidParams
from .view_free import View, ended_by_obstacle, ground_z_m, points_free

SECTORS = 72
STEP_RAD = math.tau / SECTORS
_EDGE_RAD = 1e-3
"""Overlap of neighbouring sectors, so that no obstacle falls between two of them. It is not a tuning parameter."""
SEEN_SHARE = 0.4
"""Least share of a sector in view for which free space that was seen earlier may complete the rest."""
SHORT_SIGMAS = 4.0
"""Noise of a plane, in sigmas (sigma = ke * range^2), by which the free-range profile may end before a plane that was
seen in full, in addition to one of its rings and one step along the ray."""


class SectorState(IntEnum):
    """State of a sector."""

    UNSEEN = 0
    CLEAR = 1
    OBSTACLE = 2


@dataclass(frozen=True, slots=True, eq=False)
class SectorScan:
    """The result for each sector."""

    state: NDArray[np.uint8]  # (72,) uint8 SectorState
    distance_m: NDArray[np.float64]  # (72,) float64, from the vehicle's hull to the nearest obstacle; inf: none
    # (72,) float64, length from the vehicle's middle over which the sector was seen free; 0: not seen free
    free_m: NDArray[np.float64]
    # (72,) float64, direction of the nearest obstacle; the middle of the sector if there is none
    azimuth_rad: NDArray[np.float64]
    # (72, slices, rays) bool, rays of each height slice that were not seen as far as a clear sector requires
    lacking: NDArray[np.bool_]


Recall = Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]
"""Function of places x, y, z in level, (N,) each: True for places that were seen free before and are in no view now."""


def centres_rad() -> NDArray[np.float64]:
    """Returns the middles of the sectors, (72,), clockwise from the nose."""
    return np.arange(SECTORS, dtype=np.float64) * STEP_RAD


def scan(views: Sequence[View], avoid: AvoidParams, recall: Recall | None = None) -> SectorScan:
    """Returns the nearest obstacle of any view in each sector, and how far any view saw the sector free.

    A sector is CLEAR if it was seen free to the farthest distance sent, and OBSTACLE if it was seen free to its
    nearest plane. Otherwise it is UNSEEN, even with a plane in it: an obstacle that was not measured may be nearer
    than the plane. A plane nearer than near_m is always an OBSTACLE."""
    plane_m, azimuth_rad = np.full(SECTORS, np.inf), centres_rad()
    for view in views:
        if view.model.valid:
            distance, azimuth = plane_distances(view.model, avoid)
            azimuth_rad = np.where(distance < plane_m, azimuth, azimuth_rad)
            plane_m = np.minimum(plane_m, distance)
    distance_m = np.maximum(0.0, plane_m - avoid.radius_m)
    obstacle = distance_m < avoid.max_distance_m
    free_m, seen, lacking = seen_free(views, avoid, np.where(obstacle, plane_m, np.inf), recall)
    state = np.where(seen, np.where(obstacle, SectorState.OBSTACLE, SectorState.CLEAR), SectorState.UNSEEN)
    return SectorScan(state.astype(np.uint8), distance_m, free_m, azimuth_rad, lacking)


def plane_distances(model: FrameModel, avoid: AvoidParams) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns distance and azimuth, (72,) each, of the nearest point of any plane in each sector.

    The distance is horizontal, from the origin, less the margin of the plane; inf if there is no plane. Only planes
    that extend into the height band of the vehicle count."""
    planes = model.planes.astype(np.float64)
    inside = (planes[:, 4] < avoid.band_below_m) & (planes[:, 5] > -avoid.band_above_m)
    if not inside.any():
        return np.full(SECTORS, np.inf), centres_rad()
    distance, azimuth = segment_distances(planes[inside, 0:2], planes[inside, 2:4])
    distance -= model.margin_m[inside, None]
    nearest = distance.argmin(axis=0), np.arange(SECTORS)
    return distance[nearest].clip(0.0), azimuth[nearest]


def segment_distances(
    a_m: NDArray[np.float64], b_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns distance and azimuth, (N, 72) each, of the nearest point of each segment a -> b within each sector.

    The distance is from the origin; inf if no part of the segment lies in the sector. A sector is the intersection of
    two half planes through the origin, each of which clips the segment."""
    low = centres_rad() - 0.5 * STEP_RAD - _EDGE_RAD
    high = centres_rad() + 0.5 * STEP_RAD + _EDGE_RAD
    # normals of the half planes: a product >= 0 is clockwise of the lower edge, or counter-clockwise of the upper one
    sides = ((-np.sin(low), np.cos(low)), (np.sin(high), -np.cos(high)))
    first, last = np.zeros((len(a_m), SECTORS)), np.ones((len(a_m), SECTORS))
    for nx, ny in sides:
        at_a = a_m[:, 0:1] * nx + a_m[:, 1:2] * ny
        at_b = b_m[:, 0:1] * nx + b_m[:, 1:2] * ny
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = at_a / (at_a - at_b)
        enters, leaves = (at_a < 0.0) & (at_b >= 0.0), (at_a >= 0.0) & (at_b < 0.0)
        first = np.where(enters, np.maximum(first, crossing), first)
        last = np.where(leaves, np.minimum(last, crossing), last)
        last = np.where((at_a < 0.0) & (at_b < 0.0), -1.0, last)
    along = b_m - a_m
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)[:, None]
    nearest = -((a_m * along).sum(axis=1))[:, None] / length2
    share = np.clip(nearest, first, np.maximum(first, last))
    x, y = a_m[:, 0:1] + share * along[:, 0:1], a_m[:, 1:2] + share * along[:, 1:2]
    distance = np.where(first <= last, np.hypot(x, y), np.inf)
    known = np.isfinite(distance) & (distance > 1e-6)  # a segment through the origin has no direction
    return distance, np.where(known, np.arctan2(y, x), centres_rad())


def seen_free(
    views: Sequence[View], avoid: AvoidParams, plane_m: NDArray[np.float64], recall: Recall | None = None
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns free_m, seen and lacking of the sectors: how far each was seen free, and if that is far enough.

    A sector must be seen free to its plane, or to the farthest distance sent if there is none, for a share
    `clear_share` of its rays and of the heights of the band, and at every height but the outermost ones
    (`inner_heights`) in at least one ray. Rays begin at the vehicle, views at their cameras. A ray
    is followed from near_m on, since no camera covers the whole band nearer than that. A point is free if any view
    shows it free. Sectors of which the views show SEEN_SHARE are completed by `recall`.

    Args:
        views: models of the seeing cameras.
        avoid: parameters.
        plane_m: (72,) distance to the plane of each sector, from the vehicle's middle; inf: none.
        recall: see Recall.

    Returns:
        free_m (72,); seen (72,), the sector was seen far enough; lacking of SectorScan."""
    rays = _sector_rays(avoid)
    valid = [view for view in views if view.model.valid]
    free = np.zeros((len(rays.z_m), *rays.x_m.shape), bool)
    for view in valid:
        free |= points_free(view, rays.x_m, rays.y_m, rays.z_m, along_rays=True)
    must_m = _must_be_seen_m(valid, plane_m, avoid.step_m)
    to_plane = np.searchsorted(rays.ranges_m, must_m)
    needed = np.repeat(np.where(np.isfinite(plane_m), to_plane, len(rays.ranges_m)), avoid.rays)
    reached = _reached(free)
    seen = reached >= needed
    _add_ended_at_plane(seen, reached, rays, valid, plane_m, must_m)
    _add_ended_at_plane_beside(seen, reached, rays, valid, plane_m, avoid)
    if recall is not None:
        _add_recalled(free, seen, rays, recall)
        reached = _reached(free)
        seen |= reached >= needed
    least = math.ceil(avoid.clear_share * (len(rays.z_m) * avoid.rays))
    by_sector = _by_sector(seen)
    at_height = by_sector.reshape(SECTORS, len(rays.z_m), avoid.rays)
    enough = (by_sector.sum(axis=1) >= least) & np.any(at_height[:, inner_heights(avoid)], axis=2).all(axis=1)
    far_enough = enough & (np.isfinite(plane_m) | ~_ground_in_band(valid, avoid))
    return _common_m(reached, rays, least), far_enough, ~at_height


class _SectorRays(NamedTuple):
    """Samples along the rays of all sectors."""

    # x_m, y_m: (72 * rays, ranges)
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]  # (slices,) heights in the band
    ranges_m: NDArray[np.float64]  # (ranges,) from the vehicle's middle


def _sector_rays(avoid: AvoidParams) -> _SectorRays:
    rays = (centres_rad()[:, None] + np.linspace(-0.4, 0.4, avoid.rays) * STEP_RAD).ravel()
    ranges_m = np.arange(avoid.near_m, avoid.max_distance_m + avoid.step_m, avoid.step_m)
    band_m = avoid.band_above_m + avoid.band_below_m
    z_m = -avoid.band_above_m + (np.arange(avoid.slices) + 0.5) / avoid.slices * band_m
    return _SectorRays(np.cos(rays)[:, None] * ranges_m, np.sin(rays)[:, None] * ranges_m, z_m, ranges_m)


def _add_ended_at_plane(
    seen: NDArray[np.bool_],
    reached: NDArray[np.int64],
    rays: _SectorRays,
    valid: Sequence[View],
    plane_m: NDArray[np.float64],
    must_m: NDArray[np.float64],
) -> None:
    """Adds to `seen` the rays that end at a measured obstacle of their sector: behind it nothing needs to be seen."""
    each = reached.shape[1] // SECTORS
    i, ray = np.nonzero(~seen & np.isfinite(plane_m).repeat(each))
    k = reached[i, ray]
    share = must_m.repeat(each)[ray] / rays.ranges_m[k]
    for view in valid:
        seen[i, ray] |= ended_by_obstacle(view, rays.x_m[ray, k], rays.y_m[ray, k], rays.z_m[i], share)


def _add_ended_at_plane_beside(
    seen: NDArray[np.bool_],
    reached: NDArray[np.int64],
    rays: _SectorRays,
    valid: Sequence[View],
    plane_m: NDArray[np.float64],
    avoid: AvoidParams,
) -> None:
    """Adds to `seen` the rays of sectors without a plane that end at the plane of the next sector.

    A direction of the profile that reaches across the border of two sectors ends at the plane that stands in the other.
    This holds for rays at that border which end at the plane: those that end elsewhere have met another obstacle."""
    beside_m = _beside_m(plane_m, avoid.rays)
    at_m = np.where(np.isfinite(beside_m), beside_m, 0.0)
    short_m = at_m - _must_be_seen_m(valid, at_m, avoid.step_m)
    i, ray = np.nonzero(~seen & (np.isinf(plane_m).repeat(avoid.rays) & np.isfinite(beside_m)))
    k = reached[i, ray]
    at_plane = np.abs(rays.ranges_m[k] - beside_m[ray]) <= short_m[ray]
    x_m, y_m, z_m = rays.x_m[ray, k], rays.y_m[ray, k], rays.z_m[i]
    for view in valid:
        above_ground = z_m <= ground_z_m(view, x_m, y_m) - view.model.ground.tolerance_m
        seen[i, ray] |= ended_by_obstacle(view, x_m, y_m, z_m, np.ones(len(k))) & above_ground & at_plane


def _add_recalled(free: NDArray[np.bool_], seen: NDArray[np.bool_], rays: _SectorRays, recall: Recall) -> None:
    """Adds to `free` the places that were seen free before, in sectors of which the views show SEEN_SHARE."""
    share = _by_sector(seen).mean(axis=1)
    completed = np.repeat((share >= SEEN_SHARE) & (share < 1.0), seen.shape[1] // SECTORS)
    i, ray, k = np.nonzero(~free & completed[None, :, None])
    free[i, ray, k] = recall(rays.x_m[ray, k], rays.y_m[ray, k], rays.z_m[i])


def _common_m(reached: NDArray[np.int64], rays: _SectorRays, least: int) -> NDArray[np.float64]:
    """Returns the distance, (72,), that at least `least` of the rays and slices of each sector reach."""
    common = np.sort(_by_sector(reached), axis=1)[:, -least]
    return np.where(common > 0, rays.ranges_m[np.maximum(common - 1, 0)], 0.0)


def inner_heights(avoid: AvoidParams) -> slice:
    """Returns the heights of the band of which none may be unseen in all rays of a sector.

    `clear_share` allows for rays that end at mismatches and for a border of the image. All that it leaves out in one
    piece is as high as a thing. At either edge of the band at most half of it may be unseen."""
    edge = (avoid.slices - math.ceil(avoid.clear_share * avoid.slices)) // 2
    return slice(edge, avoid.slices - edge)


def _must_be_seen_m(views: Sequence[View], plane_m: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Returns the distance, (72,), to which a sector must be seen free before its plane.

    The free-range profile ends before the plane by a ring, a step and the noise of the plane, in addition to the
    margin, which plane_m does not include."""
    short_m = step_m + max((view.ring_m for view in views), default=0.0)
    ke_per_m = max((view.model.ke_per_m for view in views), default=0.0)
    return plane_m - short_m - SHORT_SIGMAS * ke_per_m * np.where(np.isfinite(plane_m), plane_m, 0.0) ** 2


def _beside_m(plane_m: NDArray[np.float64], rays: int) -> NDArray[np.float64]:
    """Returns the distance to the plane of the next sector, (72 * rays,), for rays in the outer quarters of a sector;
    inf: none."""
    offset = np.linspace(-0.4, 0.4, rays)
    before, after = np.roll(plane_m, 1)[:, None], np.roll(plane_m, -1)[:, None]
    out: NDArray[np.float64] = np.where(offset < -0.25, before, np.where(offset > 0.25, after, np.inf)).ravel()
    return out


def _ground_in_band(views: Sequence[View], avoid: AvoidParams) -> bool:
    """True if the ground below the vehicle lies in its height band, so that no direction is free over the whole band."""
    here = np.zeros(1)
    return any(ground_z_m(view, here, here)[0] < avoid.band_below_m for view in views)


def _reached(free: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns the number of samples, (slices, 72 * rays), that are free from near_m on. free: (slices, 72 * rays,
    ranges)."""
    out: NDArray[np.int64] = np.logical_and.accumulate(free, axis=2).sum(axis=2)
    return out


def _by_sector(values: NDArray[Any]) -> NDArray[Any]:
    """Reshapes values (slices, 72 * rays) to (72, rays * slices)."""
    return values.reshape(len(values), SECTORS, -1).transpose(1, 0, 2).reshape(SECTORS, -1)

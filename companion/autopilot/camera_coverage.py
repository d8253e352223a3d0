"""Which sectors of 5 degrees the cameras cover: in part, so that they could be found clear, or too near the edge of the view
for the hull of the vehicle. See `polar_histogram` for the sectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical
from core.params import Params
from core.types import CameraInfo

from ..config.avoidance import AvoidParams
from .polar_histogram import SECTORS, STEP_RAD

PARTS = 5
"""Parts of a sector, of one degree each, for which the coverage by cameras is determined."""
EDGE_MARGIN_M = 0.1
"""Margin beside the hull for deviations of the vehicle from the commanded direction."""
MOVES_DEG = (-0.5 * math.degrees(STEP_RAD), math.degrees(STEP_RAD))
"""Directions, from the middle of a sector, into which PX4 moves by the value of that sector. Its bins begin at the
middle of a sector or have it in their middle."""
_DIRECTION_PARTS = math.ceil(Params().profile_step_deg * SECTORS * PARTS / 360.0)
"""Width of a direction of the free-range profile, in parts."""


class Look(IntEnum):
    """How much of a part of a sector a camera covers, of the heights that its image reaches."""

    NOTHING = 0
    SOME = 1
    WHOLE = 2


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """What a camera covers while the vehicle is level."""

    look: NDArray[np.uint8]  # (72, PARTS) Look of each part of each sector
    heights: NDArray[np.bool_]  # (72, PARTS, slices) heights of the band that it covers there


def everywhere(avoid: AvoidParams) -> Coverage:
    """Returns the coverage of a camera that was never opened: it may cover any direction."""
    return Coverage(np.full((SECTORS, PARTS), Look.WHOLE, np.uint8), np.ones((SECTORS, PARTS, avoid.slices), np.bool_))


def looked_into(info: CameraInfo, avoid: AvoidParams, hidden: NDArray[np.bool_] | None = None) -> Coverage:
    """Returns what a camera covers.

    It is determined by the rays of the image that are in the height band at near_m; by all rays if there are none, and
    then it covers no height. A camera beside or before the middle of the vehicle has its rays in other
    sectors at near_m than far away: a part is covered wholly only if it is at all ranges.

    Args:
        info: description of the camera.
        avoid: parameters.
        hidden: (H, W) pixels that are never measured. If they hide more than 1 - clear_share of the heights that the
            image would cover, the part is covered only in some of it, and never clear."""
    k, n = info.intrinsics, 257
    u, v = np.linspace(-0.5, k.width - 0.5, n), np.linspace(-0.5, k.height - 0.5, n)
    optical = np.stack([*np.meshgrid((u - k.cx) / k.fx, (v - k.cy) / k.fy), np.ones((n, n))]).reshape(3, -1)
    x, y, z = rotation_frd_optical(info.mount) @ optical
    z_m = info.mount.z_m + avoid.near_m * z / np.maximum(np.hypot(x, y), 1e-9)
    inside = (z_m > -avoid.band_above_m) & (z_m < avoid.band_below_m)
    reaches_band = bool(inside.any())
    if not reaches_band:
        inside[:] = True
    measured = np.ones(n * n, np.bool_)
    if hidden is not None:
        rows, columns = (np.clip(np.round(c), 0, size - 1).astype(int) for c, size in ((v, k.height), (u, k.width)))
        measured = ~hidden[np.ix_(rows, columns)].ravel()
    seen = inside & measured
    share = (z_m + avoid.band_above_m) / (avoid.band_above_m + avoid.band_below_m)
    height = np.clip(share * avoid.slices, 0, avoid.slices - 1).astype(int)
    place_m = (info.mount.x_m, info.mount.y_m)
    looks, heights = [], np.zeros((SECTORS * PARTS, avoid.slices), bool)
    for range_m in np.geomspace(avoid.near_m, avoid.max_distance_m, 4):
        azimuth = _azimuth_at(np.arctan2(y, x), place_m, range_m)
        part = np.floor((azimuth + 0.5 * STEP_RAD) / (STEP_RAD / PARTS)).astype(int) % (SECTORS * PARTS)
        could, can = (np.zeros((SECTORS * PARTS, avoid.slices), bool) for _ in range(2))
        could[part[inside], height[inside]] = True
        can[part[seen], height[seen]] = True
        if reaches_band:
            heights |= can | _heights_between(part, share * avoid.slices, measured, avoid.slices)
        enough = can.sum(axis=1) >= avoid.clear_share * could.sum(axis=1)
        look = np.where(enough, np.uint8(Look.WHOLE), np.uint8(Look.SOME))
        looks.append(np.where(can.any(axis=1), look, np.uint8(Look.NOTHING)))
    whole = np.minimum.reduce(looks) == Look.WHOLE
    some = np.minimum(np.maximum.reduce(looks), np.uint8(Look.SOME))
    look = np.where(whole, np.uint8(Look.WHOLE), some).reshape(SECTORS, PARTS)
    return Coverage(look, heights.reshape(SECTORS, PARTS, -1))


def _heights_between(
    part: NDArray[np.int_], height: NDArray[np.float64], measured: NDArray[np.bool_], slices: int
) -> NDArray[np.bool_]:
    """Returns the heights, (72 * PARTS, slices), that lie between two neighbouring rays of a part.

    A slice may be lower than the distance of two rays, so that no ray passes through it.

    Args:
        part: (N,) part of each ray of a square grid.
        height: (N,) height of each ray, in slices from the top of the band.
        measured: (N,) whether its pixel is measured.
        slices: number of heights."""
    out, n = np.zeros((SECTORS * PARTS, slices), np.bool_), math.isqrt(len(part))
    part, height, measured = part.reshape(n, n), height.reshape(n, n), measured.reshape(n, n)
    for one, beside in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        low, high = np.minimum(height[one], height[beside]), np.maximum(height[one], height[beside])
        both = measured[one] & measured[beside] & (part[one] == part[beside]) & (low < slices) & (high >= 0.0)
        low, high, where = low[both], high[both], part[one][both]
        for k in range(slices):
            out[where[(low < k + 1) & (high >= k)], k] = True
    return out


def _azimuth_at(azimuth_rad: NDArray[np.float64], place_m: tuple[float, float], range_m: float) -> NDArray[np.float64]:
    """Returns the directions from the vehicle's middle to the places at which horizontal rays are at a range from it.

    A camera that is farther out than the range has the directions of its rays.

    Args:
        azimuth_rad: (N,) directions of the rays.
        place_m: (x, y) of the camera.
        range_m: see above."""
    cx, cy = place_m
    along = -(cx * np.cos(azimuth_rad) + cy * np.sin(azimuth_rad))
    beyond = range_m**2 - cx**2 - cy**2
    if beyond <= 0.0:
        return azimuth_rad
    length = along + np.sqrt(along**2 + beyond)
    out: NDArray[np.float64] = np.arctan2(cy + length * np.sin(azimuth_rad), cx + length * np.cos(azimuth_rad))
    return out


@dataclass(frozen=True, slots=True, eq=False)
class CoveredSectors:
    """Sectors, (72,) each, by which cameras are blind and which see."""

    blind: NDArray[np.bool_]  # blind cameras cover them in part
    seeing: NDArray[np.bool_]  # seeing cameras cover them in part
    whole: NDArray[np.bool_]  # seeing cameras could find them clear, see `covered`
    heights_lost: NDArray[np.bool_]  # see `heights_lost`
    edge: NDArray[np.bool_]  # see `too_near_the_edge`


def covered_sectors(blind: Sequence[Coverage], seeing: Sequence[Coverage], avoid: AvoidParams) -> CoveredSectors:
    """Returns the sectors that blind and seeing cameras cover."""
    by_blind, _ = covered(blind)
    by_seeing, whole = covered(seeing)
    return CoveredSectors(
        by_blind, by_seeing, whole, heights_lost(blind, seeing, avoid), too_near_the_edge(seeing, avoid)
    )


def too_near_the_edge(cameras: Sequence[Coverage], avoid: AvoidParams) -> NDArray[np.bool_]:
    """Returns the sectors, (72,), into which the vehicle must not move by what these cameras cover.

    Its hull, with a margin, would pass through directions beside their views, or through directions in which they cover
    less than clear_share of the heights that they cover in the sector, at a range of near_m or more."""
    parts = _looks(cameras).ravel() == Look.WHOLE
    heights = _heights(cameras, avoid)
    hull_deg = math.degrees(math.asin(min(1.0, (avoid.radius_m + EDGE_MARGIN_M) / avoid.near_m)))
    part_deg = 360.0 / len(parts)
    first = math.floor((MOVES_DEG[0] - hull_deg + 0.5 * PARTS * part_deg) / part_deg + 1e-9)
    end = math.ceil((MOVES_DEG[1] + hull_deg + 0.5 * PARTS * part_deg) / part_deg - 1e-9)
    needed = (PARTS * np.arange(SECTORS)[:, None] + np.arange(first, end)[None, :]) % len(parts)
    own: NDArray[np.bool_] = np.logical_or.reduce(heights, axis=1)
    beside = heights.reshape(len(parts), -1)[needed] & own[:, None, :]
    as_high = beside.sum(axis=2) >= avoid.clear_share * own.sum(axis=1)[:, None]
    return np.asarray(~((parts[needed] & as_high).all(axis=1) & own.any(axis=1)))


def covered(cameras: Sequence[Coverage]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns the sectors, (72,) each, that these cameras cover in part, and those that they could find clear.

    The latter are covered completely, and beside them by as much as the width of a direction of the free-range
    profile: the outermost direction is only partly in the view, and never free."""
    parts = _looks(cameras)
    whole = (parts == Look.WHOLE).ravel()
    beside = [np.roll(whole, k) for k in range(-_DIRECTION_PARTS, _DIRECTION_PARTS + 1)]
    whole = np.logical_and.reduce(beside).reshape(parts.shape).all(axis=1)
    return np.asarray((parts > Look.NOTHING).any(axis=1)), np.asarray(whole)


def heights_lost(blind: Sequence[Coverage], seeing: Sequence[Coverage], avoid: AvoidParams) -> NDArray[np.bool_]:
    """Returns the sectors, (72,), in a part of which the seeing cameras cover less than clear_share of the heights that
    they and the blind ones cover together: one that looks up does not replace one that looks ahead."""
    now = _heights(seeing, avoid)
    together = now | _heights(blind, avoid)
    out: NDArray[np.bool_] = (now.sum(axis=2) < avoid.clear_share * together.sum(axis=2)).any(axis=1)
    return out


def _looks(cameras: Sequence[Coverage]) -> NDArray[np.uint8]:
    """Returns the greatest Look of any camera, (72, PARTS)."""
    nothing = np.zeros((SECTORS, PARTS), np.uint8)
    out: NDArray[np.uint8] = np.maximum.reduce([nothing, *(camera.look for camera in cameras)])
    return out


def _heights(cameras: Sequence[Coverage], avoid: AvoidParams) -> NDArray[np.bool_]:
    """Returns the heights that any camera covers, (72, PARTS, slices)."""
    nothing = np.zeros((SECTORS, PARTS, avoid.slices), np.bool_)
    out: NDArray[np.bool_] = np.logical_or.reduce([nothing, *(camera.heights for camera in cameras)])
    return out

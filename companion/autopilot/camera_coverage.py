"""Which sectors of 5 degrees the cameras cover: in part, so that they could be found clear, or too near the edge of the view
for the hull of the vehicle. See `polar_histogram` for the sectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    """How much of a part of a sector a camera covers."""

    NOTHING = 0
    SOME = 1
    WHOLE = 2


def looked_into(info: CameraInfo, avoid: AvoidParams, hidden: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
    """Returns how much of each part of each sector a camera covers while the vehicle is level, (72, PARTS) Look.

    It is determined by the rays of the image through the height band at near_m or farther; by all rays if there are
    none. A camera beside or before the middle of the vehicle has its rays in other sectors at near_m than far away: a part is
    covered wholly only if it is at all ranges.

    Args:
        info: description of the camera.
        avoid: parameters.
        hidden: (H, W) pixels that are never measured. If they hide more than 1 - clear_share of the heights that the
            image would cover, the part is covered only in some of it, and never clear."""
    k, n = info.intrinsics, 257
    u, v = np.linspace(-0.5, k.width - 0.5, n), np.linspace(-0.5, k.height - 0.5, n)
    optical = np.stack([*np.meshgrid((u - k.cx) / k.fx, (v - k.cy) / k.fy), np.ones((n, n))]).reshape(3, -1)
    x, y, z = rotation_frd_optical(info.mount) @ optical
    z_m = avoid.near_m * z / np.maximum(np.hypot(x, y), 1e-9)
    inside = (z_m > -avoid.band_above_m) & (z_m < avoid.band_below_m)
    if not inside.any():
        inside[:] = True
    seen = inside.copy()
    if hidden is not None:
        rows, columns = (np.clip(np.round(c), 0, size - 1).astype(int) for c, size in ((v, k.height), (u, k.width)))
        seen &= ~hidden[np.ix_(rows, columns)].ravel()
    share = (z_m + avoid.band_above_m) / (avoid.band_above_m + avoid.band_below_m)
    height = np.clip(share * avoid.slices, 0, avoid.slices - 1).astype(int)
    place_m = (info.mount.x_m, info.mount.y_m)
    looks = []
    for range_m in np.geomspace(avoid.near_m, avoid.max_distance_m, 4):
        azimuth = _azimuth_at(np.arctan2(y, x), place_m, range_m)
        part = np.floor((azimuth + 0.5 * STEP_RAD) / (STEP_RAD / PARTS)).astype(int) % (SECTORS * PARTS)
        could, can = (np.zeros((SECTORS * PARTS, avoid.slices), bool) for _ in range(2))
        could[part[inside], height[inside]] = True
        can[part[seen], height[seen]] = True
        enough = can.sum(axis=1) >= avoid.clear_share * could.sum(axis=1)
        look = np.where(enough, np.uint8(Look.WHOLE), np.uint8(Look.SOME))
        looks.append(np.where(can.any(axis=1), look, np.uint8(Look.NOTHING)))
    whole = np.minimum.reduce(looks) == Look.WHOLE
    some = np.minimum(np.maximum.reduce(looks), np.uint8(Look.SOME))
    return np.where(whole, np.uint8(Look.WHOLE), some).reshape(SECTORS, PARTS)


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


def too_near_the_edge(cameras: Sequence[NDArray[np.uint8]], avoid: AvoidParams) -> NDArray[np.bool_]:
    """Returns the sectors, (72,), into which the vehicle must not move by what these cameras cover.

    Its hull, with a margin, would pass through directions beside their views, at a range of near_m or more. cameras:
    of `looked_into`."""
    parts = np.maximum.reduce([np.zeros((SECTORS, PARTS), np.uint8), *cameras]).ravel() == Look.WHOLE
    hull_deg = math.degrees(math.asin(min(1.0, (avoid.radius_m + EDGE_MARGIN_M) / avoid.near_m)))
    part_deg = 360.0 / len(parts)
    first = math.floor((MOVES_DEG[0] - hull_deg + 0.5 * PARTS * part_deg) / part_deg + 1e-9)
    end = math.ceil((MOVES_DEG[1] + hull_deg + 0.5 * PARTS * part_deg) / part_deg - 1e-9)
    needed = PARTS * np.arange(SECTORS)[:, None] + np.arange(first, end)[None, :]
    out: NDArray[np.bool_] = ~parts[needed % len(parts)].all(axis=1)
    return out


def covered(cameras: Sequence[NDArray[np.uint8]]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns the sectors, (72,) each, that these cameras cover in part, and those that they could find clear.

    The latter are covered completely, and beside them by as much as the width of a direction of the free-range
    profile: the outermost direction is only partly in the view, and never free. cameras: of `looked_into`."""
    parts = np.maximum.reduce([np.zeros((SECTORS, PARTS), np.uint8), *cameras])
    whole = (parts == Look.WHOLE).ravel()
    beside = [np.roll(whole, k) for k in range(-_DIRECTION_PARTS, _DIRECTION_PARTS + 1)]
    return (parts > Look.NOTHING).any(axis=1), np.logical_and.reduce(beside).reshape(parts.shape).all(axis=1)

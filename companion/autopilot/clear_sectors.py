"""Which sectors can be clear by a camera at all: those that are clear where everything it measures is far.

Range, noise, bias, field of view, mount, masks, and the height band all limit it. A camera by which no sector can be clear
makes the vehicle stand: PX4 does not move into sectors that are not clear, ArduPilot is sent the artificial wall there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import rotation_frd_optical, rotation_level_cam_optical
from core.params import Params
from core.types import FAR_MM, UNKNOWN_MM, CameraInfo

from ..config.avoidance import AvoidParams
from ..config.clear_reach import clear_reach_text
from ..pipeline.transform import LevelTransform, transform_model
from .polar_histogram import SECTORS, SectorState, scan
from .view_free import View

Mask = NDArray[np.bool_]
STEEP_DEG = 45.0
"""A camera that looks more steeply up or down is not expected to find directions clear."""


def clear_sectors(info: CameraInfo, avoid: AvoidParams, params: Params, hidden: Mask | None = None) -> Mask:
    """Returns the sectors, (72,), that are clear by this camera while the vehicle is level and everything is far.

    Args:
        info: description of the camera; its prior noise is used.
        avoid: parameters of the obstacle output.
        params: parameters of the extraction.
        hidden: (H, W) pixels that are never measured."""
    k, R = info.intrinsics, rotation_frd_optical(info.mount)
    depth_mm = np.full((k.height, k.width), FAR_MM, np.uint16)
    if hidden is not None:
        depth_mm[hidden] = UNKNOWN_MM
    model, _ = Extractor(params).extract(depth_mm, info, rotation_level_cam_optical(R))
    if not model.valid:
        return np.zeros(SECTORS, np.bool_)
    mount = info.mount
    to_level = LevelTransform(math.atan2(R[1, 2], R[0, 2]), (mount.x_m, mount.y_m, mount.z_m))
    view = View(
        model=transform_model(model, to_level),
        transform=to_level,
        intrinsics=k,
        R_optical_level=R.T,
        ring_m=params.profile_ring_m,
    )
    return np.asarray(scan([view], avoid).state == SectorState.CLEAR)


def no_clear_text(info: CameraInfo, avoid: AvoidParams, params: Params, hidden: Mask | None = None) -> str:
    """Returns why the sector straight ahead of this camera can never be clear, and what to do; empty: it can, or the camera
    looks up or down. Sectors aside of it reach farther, and are no help to a vehicle that flies ahead."""
    north, east, down = (float(c) for c in rotation_frd_optical(info.mount)[:, 2])
    if abs(down) > math.sin(math.radians(STEEP_DEG)):
        return ""
    ahead = round(math.degrees(math.atan2(east, north)) / (360.0 / SECTORS)) % SECTORS
    if clear_sectors(info, avoid, params, hidden)[ahead]:
        return ""
    if text := clear_reach_text(info, avoid, params):
        return text
    return (
        f"straight ahead of camera {info.camera} no sector is ever clear, however far it sees: its image, mounted with a pitch of "
        f"{math.degrees(info.mount.pitch_rad):.0f} degrees, does not cover {100 * avoid.clear_share:.0f} % of the height band "
        f"({avoid.band_above_m:g} m above to {avoid.band_below_m:g} m below the vehicle) from {avoid.near_m:g} m on; mount it "
        "closer to level, or lower [avoid] band_above_m and band_below_m, and check the masks"
    )

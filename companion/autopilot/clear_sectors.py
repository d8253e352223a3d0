"""Which sectors can be clear by the cameras at all: those that are clear where everything they measure is far.

Range, noise, bias, field of view, mount, masks, and the height band all limit it. A camera ahead of which no sector can be clear
makes the vehicle stand: PX4 does not move into sectors that are not clear, ArduPilot is sent the artificial wall there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import rotation_frd_optical, rotation_level_cam_optical
from core.params import Params
from core.types import FAR_MM, UNKNOWN_MM, CameraInfo

from ..cameras.masks import Mask
from ..config.avoidance import AvoidParams
from ..config.clear_reach import clear_reach_text, looks_ahead
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.transform import LevelTransform, transform_model
from .obstacle_report import RECKONING_ERRORS
from .polar_histogram import SECTORS, SectorState, scan
from .view_free import View


def far_view(info: CameraInfo, params: Params, hidden: Mask | None = None) -> View | None:
    """Returns the view of a camera while the vehicle is level and everything it measures is far; None: it has none.

    Args:
        info: description of the camera; its prior noise is used.
        params: parameters of the extraction.
        hidden: (H, W) pixels that are never measured."""
    k, R = info.intrinsics, rotation_frd_optical(info.mount)
    depth_mm = np.full((k.height, k.width), FAR_MM, np.uint16)
    if hidden is not None:
        depth_mm[hidden] = UNKNOWN_MM
    model, _ = Extractor(params).extract(depth_mm, info, rotation_level_cam_optical(R))
    if not model.valid:
        return None
    mount = info.mount
    to_level = LevelTransform(math.atan2(R[1, 2], R[0, 2]), (mount.x_m, mount.y_m, mount.z_m))
    return View(
        model=transform_model(model, to_level),
        transform=to_level,
        intrinsics=k,
        R_optical_level=R.T,
        ring_m=params.profile_ring_m,
    )


def clear_sectors(views: Sequence[View], avoid: AvoidParams) -> NDArray[np.bool_]:
    """Returns the sectors, (72,), that are clear by these far views together."""
    if not views:
        return np.zeros(SECTORS, np.bool_)
    return np.asarray(scan(views, avoid).state == SectorState.CLEAR)


def no_clear_text(info: CameraInfo, avoid: AvoidParams, params: Params, views: Sequence[View]) -> str:
    """Returns why the sector straight ahead of this camera can never be clear, and what to do; empty: it can, or the camera
    looks up or down. Sectors aside of it reach farther, and are no help to a vehicle that flies ahead.

    views: far views of this camera and of those beside it; two cameras may cover the height band together."""
    if not looks_ahead(info):
        return ""
    forward, right, _ = (float(c) for c in rotation_frd_optical(info.mount)[:, 2])
    ahead = round(math.degrees(math.atan2(right, forward)) / (360.0 / SECTORS)) % SECTORS
    if clear_sectors(views, avoid)[ahead]:
        return ""
    if text := clear_reach_text(info, avoid, params):
        return text
    place, height = (
        (f" and z_m = {info.mount.z_m:g} m", ", closer to the height of the autopilot") if info.mount.z_m else ("", "")
    )
    return (
        f"straight ahead of camera {info.camera} no sector is ever clear, however far it sees: its image, mounted with a pitch of "
        f"{math.degrees(info.mount.pitch_rad):.0f} degrees{place}, does not cover {100 * avoid.clear_share:.0f} % of the height band "
        f"({avoid.band_above_m:g} m above to {avoid.band_below_m:g} m below the vehicle) from {avoid.near_m:g} m on; mount it "
        f"closer to level{height}, or lower [avoid] band_above_m and band_below_m, and check the masks"
    )


@dataclass(frozen=True, slots=True, eq=False)
class OpenedCamera:
    """A camera that was opened."""

    info: CameraInfo
    hidden: Mask | None  # (H, W) pixels that are never measured; None: all can be


def never_clear_texts(cameras: Sequence[OpenedCamera], avoid: AvoidParams, params: Params) -> dict[str, str]:
    """Returns the text of no_clear_text for each of the cameras of a vehicle, by its name."""
    views = [view for camera in cameras if (view := far_view(camera.info, params, camera.hidden)) is not None]
    return {camera.info.camera: no_clear_text(camera.info, avoid, params, views) for camera in cameras}


class ClearCheck:
    """Examines the cameras after one was opened with another description. Methods may be called in different threads."""

    def __init__(self, avoid: AvoidParams, params: Params) -> None:
        self._avoid, self._params = avoid, params
        self._opened: dict[str, OpenedCamera] = {}
        self._examined: dict[str, CameraInfo] = {}
        self._texts: dict[str, str] = {}

    def announce(self, info: CameraInfo, hidden: Mask | None) -> None:
        """Takes a camera that was opened. hidden: pixels that are never measured."""
        self._opened[info.camera] = OpenedCamera(info, hidden)

    def examine(self) -> None:
        """Examines what was announced; with the first result of a camera, because the kernels are loaded then. It is advice:
        a fault in it must not end the output."""
        cameras = self._opened.copy()
        infos = {name: camera.info for name, camera in cameras.items()}
        if infos == self._examined:
            return
        self._examined = infos
        try:
            self._texts = never_clear_texts(list(cameras.values()), self._avoid, self._params)
        except RECKONING_ERRORS as error:
            self._texts = {
                name: f"whether a sector can be clear by camera {name} is not known: {error}" for name in infos
            }

    def diagnostics(self) -> list[Diagnostic]:
        """Returns one for each camera straight ahead of which no sector can be clear."""
        return [Diagnostic(DiagnosticCode.NEVER_CLEAR, c, text) for c, text in sorted(self._texts.items()) if text]

"""Depth of a simulated flight from rendered image pairs, in place of the depth ray caster and its noise model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, Intrinsics

from ...cameras.stereo import MatchParams
from ..scenes import Scene
from .pair_renderer import StereoView
from .sky import CLEAR
from .stereo_profiles import ZED, StereoCamera, StereoProfile
from .stereo_scene import StereoScene, surfaces_of
from .textures import Floats

BASELINE_M = 0.12


def flight_profile(intrinsics: Intrinsics, disparities: int = 96, mark_smooth: bool = False) -> StereoProfile:
    """The host's matcher behind imagers with these intrinsics, BASELINE_M apart."""
    view = StereoView(intrinsics=intrinsics, baseline_m=BASELINE_M)
    return replace(ZED, name="flight", view=view, match=MatchParams(disparities=disparities, mark_smooth=mark_smooth))


def stereo_camera_info(intrinsics: Intrinsics, camera: str, mark_smooth: bool) -> CameraInfo:
    """The description of a simulated stereo camera. mark_smooth: see MatchParams."""
    return flight_profile(intrinsics, mark_smooth=mark_smooth).info(camera)


class RenderedDepth:
    """Depth images of one scene for several cameras. One thread at a time."""

    def __init__(self, scene: Scene, disparities: int, mark_smooth: bool) -> None:
        self._disparities, self._mark_smooth = disparities, mark_smooth
        self._scene = StereoScene(name=scene.name, surfaces=surfaces_of(scene), sky=CLEAR)
        self._cameras: dict[Intrinsics, StereoCamera] = {}

    def depth_mm(
        self, info: CameraInfo, R_ned_optical: Floats, position_ned_m: Floats, seed: int, frame: int
    ) -> NDArray[np.uint16]:
        """(H, W) uint16 mm; the same arguments give the same image. seed: of the noise; the textures of a scene stay."""
        camera = self._cameras.get(info.intrinsics)
        if camera is None:
            camera = StereoCamera(flight_profile(info.intrinsics, self._disparities, self._mark_smooth))
            self._cameras[info.intrinsics] = camera
        return camera.depth_of(camera.pair(self._scene, R_ned_optical, position_ned_m, seed, frame))

"""Views of the stereo scenes: rendered, matched and extracted as the service would do it."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.open_air.stereo_profiles import PROFILES
from benchmarks.open_air.stereo_scenes import make_stereo_scene
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.types import CameraInfo, ExtractorState, FrameModel
from drivers.simulation.source import Rendered, look
from drivers.simulation.stereo.pair_renderer import PairBrightness, StereoPair, expose_pair
from drivers.simulation.stereo.sky import SKIES
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile
from drivers.simulation.stereo.stereo_scene import StereoScene

FRAMES = 2
"""The second of two frames is judged, as in the fidelity run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One view. height_m: above what the camera flies over; pitch_deg, roll_deg: of the camera."""

    scene: str
    profile: str = "zed"
    sky: str = "clear"
    height_m: float = 2.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Seen:
    """A view with its images (None: its depth is ray-cast), depth (in frame) and model. unmatched_left_px, unmatched_right_px: columns at each side
    that never have a match."""

    view: View
    noise_grey: float
    scene: StereoScene
    pair: StereoPair | None
    frame: Rendered
    model: FrameModel
    unmatched_left_px: int
    unmatched_right_px: int = 0


@functools.lru_cache(maxsize=8)
def scene_of(name: str, seed: int, sky: str) -> StereoScene:
    """A stereo scene under a sky."""
    return replace(make_stereo_scene(name, seed), sky=SKIES[sky])


def profile_of(name: str) -> StereoProfile:
    """A profile by name. Raises ValueError for a name that does not exist."""
    if name not in PROFILES:
        raise ValueError(f"no stereo profile {name!r}; there are: {', '.join(PROFILES)}")
    return PROFILES[name]


def every_match(profile: StereoProfile) -> StereoProfile:
    """The same camera with the confidence rules off."""
    off = replace(profile.match, correlation=0.0, texture=0.0, period=1.0, patch_px=0, patch_per_px=0.0)
    return replace(profile, match=replace(off, shared=1.0, smear_px=0, smear_rows=0, level_px=0))


def pose_of(view: View, scene: StereoScene) -> tuple[np.ndarray, np.ndarray]:
    """(R_ned_optical, position_ned_m): a little aside and turned by the seed, so that nothing is met exactly square."""
    rng = np.random.Generator(np.random.PCG64([view.seed, 5]))
    x, y, yaw = rng.uniform(-1.0, 1.0, 3) * [0.1, 0.1, 0.1]
    height = scene.stand_m + min(view.height_m, scene.highest_m)
    R = rotation_from_euler(math.radians(view.roll_deg), math.radians(view.pitch_deg), float(yaw)) @ R_CAMFRD_OPTICAL
    return R, np.array([float(x), float(y), -height])


def last_model(
    extractor: Extractor, info: CameraInfo, R_level: NDArray[np.float64], images: Iterable[NDArray[np.uint16]]
) -> tuple[NDArray[np.uint16], FrameModel]:
    """The last of some images of one view, and its model: the images before measure the noise of the depth and the ground."""
    state = ExtractorState()
    for depth_mm in images:
        model, state = extractor.extract(depth_mm, info, R_level, state=state)
    return depth_mm, model


def see(view: View, noises: tuple[float, ...], camera: StereoCamera, extractor: Extractor) -> Iterator[Seen]:
    """A view at several levels of sensor noise."""
    profile, scene = camera.profile, scene_of(view.scene, view.seed, view.sky)
    R, at = pose_of(view, scene)
    bright: PairBrightness = camera.brightness(scene, R, at, view.seed)
    info = profile.info()
    truth = look(scene.scene, info, R, at)
    R_level = rotation_level_cam_optical(R)
    for noise in noises:
        exposure = replace(profile.view.exposure, noise_grey=noise)
        pairs = [expose_pair(bright, exposure, view.seed, number) for number in range(FRAMES)]
        depth, model = last_model(extractor, info, R_level, map(camera.depth_of, pairs))
        yield Seen(
            view=view,
            noise_grey=noise,
            scene=scene,
            pair=pairs[-1],
            model=model,
            unmatched_left_px=profile.unmatched_left_px,
            unmatched_right_px=profile.unmatched_right_px,
            frame=Rendered(scene.scene, info, depth, R, R_level, at, truth),
        )

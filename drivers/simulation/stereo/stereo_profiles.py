"""Stereo cameras of the simulation: geometry, imagers and matching of each.

What is public of each camera is in docs/explanation/stereo-depth.md with its source. What is not public (cost tables of the
hardware) is left at values with which the method works; figures of these profiles show what the kind of matching does, not
what one device does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, CameraMount, Intrinsics

from ...cameras.device_matches import confirmed_depth
from ...cameras.stereo import MatchParams, StereoMatcher, depth_mm
from ...cameras.textureless import limits_of, mark_unmeasured
from .census_matching import CensusParams, census_disparity
from .exposure import Gray
from .pair_renderer import PairBrightness, StereoPair, StereoView, expose_pair, pair_brightness
from .shading import Light, Projector
from .stereo_scenes import StereoScene
from .textures import Floats

Disparity = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoProfile:
    """One kind of stereo camera."""

    name: str
    view: StereoView
    match: MatchParams = field(default_factory=MatchParams)  # the host's matcher
    # the device's own, then only the confidence rules of `match` are used, and only with host_check: the driver tests
    # the device's depth with its rectified images
    census: CensusParams | None = None
    projector: Projector | None = None
    min_range_m: float = 0.5
    max_range_m: float = 15.0
    disparity_sigma_px: float = 0.3  # prior of the noise, as the driver states it
    host_check: bool = False

    def info(self, camera: str = "front", mount: CameraMount | None = None) -> CameraInfo:
        """The description that the driver of such a camera gives."""
        ke = self.disparity_sigma_px / (self.view.intrinsics.fx * self.view.baseline_m)
        return CameraInfo(
            camera,
            self.view.intrinsics,
            mount or CameraMount(),
            min_range_m=self.min_range_m,
            max_range_m=self.max_range_m,
            ke_per_m=min(max(ke, 1e-4), 0.05),
            marks_smooth=self.marks_smooth,
        )

    @property
    def marks_smooth(self) -> bool:
        """Whether unmeasured pixels are marked; depth that a device has matched has no marks."""
        return self.census is None and self.match.mark_smooth

    @property
    def unmatched_left_px(self) -> int:
        """Columns at the left in which nothing is ever matched."""
        return self.census.disparities if self.census is not None else self.match.disparities

    @property
    def unmatched_right_px(self) -> int:
        """Columns at the right in which nothing is ever matched."""
        return 0 if self.census is not None else self.match.edge_px

    def matching(self) -> Callable[[Gray, Gray], Disparity]:
        """A function from both images to disparity (H, W) float32 px, negative: none; of a device that matches, before the test of
        the host. Not for two threads at once."""
        if self.census is not None:
            census = self.census
            return lambda left, right: census_disparity(left, right, census)
        return StereoMatcher(self.match).disparity


def _view(width: int, height: int, focal_px: float, baseline_m: float) -> StereoView:
    return StereoView(
        intrinsics=Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2),
        baseline_m=baseline_m,
    )


ZED = StereoProfile(name="zed", view=_view(672, 376, 350.0, 0.12), max_range_m=12.0)
ZED_RECTIFIED = replace(
    ZED,
    name="zed_rectified",
    view=replace(ZED.view, imagers_deg=((0.1, -0.15, 0.2), (-0.1, 0.12, -0.15))),
)
"""The same with imagers that are turned as those of a real camera, so that its images are interpolated."""
ZED_HD = replace(ZED, name="zed_hd", view=_view(1280, 720, 700.0, 0.12), match=MatchParams(disparities=192))
"""The same at twice the resolution."""
ZED_WIDE = replace(ZED, name="zed_wide", view=_view(672, 376, 235.0, 0.12))
"""A lens of 110 degrees."""
LONG = StereoProfile(
    name="long", view=_view(640, 480, 450.0, 0.25), match=MatchParams(disparities=128), max_range_m=20.0
)
"""A wide baseline: a range of 20 m."""
OAK = StereoProfile(
    name="oak",
    view=_view(640, 400, 441.0, 0.075),
    census=CensusParams(subpixel_bits=5, threshold_grey=1, least_margin=0.15, most_cost=0.25),
    min_range_m=0.4,
    disparity_sigma_px=0.25,
    host_check=True,
)
OAK_HOST = replace(OAK, name="oak_host", census=None, host_check=False)
"""An OAK whose rectified images are matched on the host (`match_on = "host"`)."""
OAK_WIDE = replace(OAK_HOST, name="oak_wide", view=_view(640, 400, 285.0, 0.075), max_range_m=10.0)
"""The same with the wide lenses."""
OAK_HALF = replace(
    OAK_HOST,
    name="oak_half",
    view=_view(320, 200, 220.5, 0.075),
    match=MatchParams(disparities=48),
    min_range_m=0.4,
    max_range_m=10.0,
)
"""The same at half of the resolution."""
D400 = StereoProfile(
    name="d400",
    view=_view(640, 480, 385.0, 0.05),
    census=CensusParams(
        disparities=128, rows=7, columns=9, paths=2, p1=3, p2=12, subpixel_bits=5, least_margin=0.08, speckle_px=40
    ),
    min_range_m=0.2,
    max_range_m=6.0,
)
D400_ACTIVE = replace(D400, name="d400_active", projector=Projector(offset_m=0.025, strength=2.0))
_ALL = (ZED, ZED_RECTIFIED, ZED_HD, ZED_WIDE, LONG, OAK, OAK_HOST, OAK_WIDE, OAK_HALF, D400, D400_ACTIVE)
PROFILES: dict[str, StereoProfile] = {p.name: p for p in _ALL}


class StereoCamera:
    """Renders and matches: depth images of scenes as a stereo camera of a profile delivers them. One thread at a time."""

    def __init__(self, profile: StereoProfile) -> None:
        self.profile = profile
        self._matching = profile.matching()

    def brightness(
        self, scene: StereoScene, R_ned_optical: Floats, position_ned_m: Floats, seed: int = 0
    ) -> PairBrightness:
        """Both views from a left camera at a position with a rotation, before exposure; seed: of the textures."""
        light = Light(sky=scene.sky, fog_per_m=scene.fog_per_m, seed=seed, projector=self.profile.projector)
        return pair_brightness(scene.surfaces, scene.panes, self.profile.view, R_ned_optical, position_ned_m, light)

    def pair(
        self, scene: StereoScene, R_ned_optical: Floats, position_ned_m: Floats, seed: int, frame: int = 0
    ) -> StereoPair:
        """Both images; the same arguments give the same images. seed: of the noise; textures are those of seed 0."""
        bright = self.brightness(scene, R_ned_optical, position_ned_m)
        return expose_pair(bright, self.profile.view.exposure, seed, frame)

    def disparity(self, pair: StereoPair) -> Disparity:
        """(H, W) float32 px in the left image, negative: none; see `StereoProfile.matching`."""
        return self._matching(pair.left, pair.right)

    def depth_of(self, pair: StereoPair) -> NDArray[np.uint16]:
        """(H, W) uint16 mm in the left image."""
        disparity, k, baseline_m = self.disparity(pair), self.profile.view.intrinsics, self.profile.view.baseline_m
        depth = depth_mm(disparity, k.fx * baseline_m)
        if self.profile.host_check:
            return confirmed_depth(depth, (pair.left, pair.right), k.fx * baseline_m, self.profile.match)
        if self.profile.marks_smooth:
            return mark_unmeasured(depth, disparity, pair.left, pair.right, limits_of(k.fx, baseline_m))
        return depth

"""Stereo cameras of the simulation: geometry, imagers and matching.

What is public of each camera is in docs/explanation/stereo-depth.md with its source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.types import CameraInfo, CameraMount, Intrinsics

from ...cameras.device_matches import confirmed_depth
from ...cameras.stereo import MatchParams, StereoMatcher, depth_mm
from ...cameras.textureless import limits_of, mark_unmeasured
from .exposure import Gray
from .pair_renderer import PairBrightness, StereoPair, StereoView, expose_pair, pair_brightness
from .shading import Light, Projector
from .stereo_scene import StereoScene
from .textures import Floats

Disparity = NDArray[np.float32]


class DeviceMatching(Protocol):
    """The matching that a device does itself."""

    @property
    def disparities(self) -> int:
        """Number of disparities that are searched."""
        ...

    def disparity(self, left: Gray, right: Gray) -> Disparity:
        """(H, W) float32 px of a rectified pair, negative: none."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoProfile:
    """One kind of stereo camera."""

    name: str
    view: StereoView
    match: MatchParams = field(default_factory=MatchParams)  # the host's matcher
    # the device's own, then only the confidence rules of `match` are used, and only with host_check: the driver tests
    # the device's depth with its rectified images
    device: DeviceMatching | None = None
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
        return self.device is None and self.match.mark_smooth

    @property
    def unmatched_left_px(self) -> int:
        """Columns at the left in which nothing is ever matched."""
        return self.device.disparities if self.device is not None else self.match.disparities

    @property
    def unmatched_right_px(self) -> int:
        """Columns at the right in which nothing is ever matched."""
        return 0 if self.device is not None else self.match.edge_px

    def matching(self) -> Callable[[Gray, Gray], Disparity]:
        """A function from both images to disparity (H, W) float32 px, negative: none; of a device that matches, before the test of
        the host. Not for two threads at once."""
        return StereoMatcher(self.match).disparity if self.device is None else self.device.disparity


def view_of(width: int, height: int, focal_px: float, baseline_m: float) -> StereoView:
    """A view with the principal point in the middle of its images."""
    return StereoView(
        intrinsics=Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2),
        baseline_m=baseline_m,
    )


ZED = StereoProfile(name="zed", view=view_of(672, 376, 350.0, 0.12), max_range_m=12.0)


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

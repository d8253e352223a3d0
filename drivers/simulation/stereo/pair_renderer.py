"""A pair of grey images of a scene, as the two imagers of a rectified stereo camera see it."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import Intrinsics

from .exposure import Exposure, Gray, automatic_gain, expose
from .shading import Light, Surfaces, radiance
from .textures import Floats

SUPERSAMPLING = 2
"""Rays per pixel along each side."""
TurnDeg = tuple[float, float, float]
"""Rotation vector in degrees about the optical axes x (right), y (down), z (forward)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GlassPane:
    """A pane of glass: the solids with this name."""

    name: str
    normal_ned: tuple[float, float, float]  # unit normal of its face, point_ned_m: a point on it
    point_ned_m: tuple[float, float, float]
    # names of the solids before it, which it mirrors, with the ground and the sky. It adds `reflects` of the mirrored
    # brightness and lets `transmits` of what is behind it through.
    outside: tuple[str, ...] = ()
    reflects: float = 0.15
    transmits: float = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoView:
    """A rectified stereo camera."""

    intrinsics: Intrinsics  # of both images
    baseline_m: float  # the right camera is this far to the right
    exposure: Exposure = field(default_factory=Exposure)
    # by how much the left and the right imager are turned from the rectified view. Their noisy images are rectified by
    # interpolation then, as a driver does.
    imagers_deg: tuple[TurnDeg, TurnDeg] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def R_rectified_imager(self, eye: int) -> Floats:
        """(3, 3) of the left (0) or the right (1) imager."""
        return np.asarray(cv2.Rodrigues(np.radians(self.imagers_deg[eye]))[0], np.float64)

    def rectified(self, image: Gray, eye: int) -> Gray:
        """The rectified image of an imager."""
        if not any(self.imagers_deg[eye]):
            return image
        k = self.intrinsics
        matrix = np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]])
        homography = matrix @ self.R_rectified_imager(eye) @ np.linalg.inv(matrix)
        size = (k.width, k.height)
        return np.asarray(cv2.warpPerspective(image, homography, size, borderMode=cv2.BORDER_REPLICATE), np.uint8)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoPair:
    """Both images, (H, W) uint8, rectified."""

    left: Gray
    right: Gray


def _fine(k: Intrinsics) -> Intrinsics:
    """The same view with SUPERSAMPLING rays a pixel along each side."""
    n = SUPERSAMPLING
    return Intrinsics(n * k.width, n * k.height, n * k.fx, n * k.fy, n * (k.cx + 0.5) - 0.5, n * (k.cy + 0.5) - 0.5)


def _mean(fine: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = fine.shape
    n = SUPERSAMPLING
    return np.asarray(fine.reshape(height // n, n, width // n, n).mean(axis=(1, 3)), np.float32)


def brightness(
    surfaces: Surfaces,
    panes: tuple[GlassPane, ...],
    k: Intrinsics,
    R: Floats,
    at: Floats,
    light: Light,
    projector: Floats,
) -> NDArray[np.float32]:
    """(H, W) brightness that one imager at `at` sees."""
    fine = _fine(k)
    if not panes:
        return _mean(radiance(surfaces, fine, R, at, light, projector)[0])
    scene = surfaces.scene
    names = np.array([*scene.names, ""])
    glass = np.isin(names[scene.label], [p.name for p in panes]) & (scene.label >= 0)
    _, first = radiance(surfaces, fine, R, at, light, projector)
    image, _ = radiance(surfaces.without(glass), fine, R, at, light, projector)
    for pane in panes:
        mine = np.isin(first, np.flatnonzero((names[scene.label] == pane.name) & (scene.label >= 0)))
        if not mine.any():
            continue
        n = np.array(pane.normal_ned)
        mirror = np.eye(3) - 2.0 * np.outer(n, n)
        mirrored_at = at - 2.0 * float(n @ (at - np.array(pane.point_ned_m))) * n
        hidden = (scene.label >= 0) & ~np.isin(names[scene.label], pane.outside)
        reflected, _ = radiance(surfaces.without(hidden), fine, mirror @ R, mirrored_at, light, glare=False)
        image[mine] = pane.transmits * image[mine] + pane.reflects * reflected[mine]
    return _mean(image)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairBrightness:
    """Brightness (H, W) float32 of both imagers, before exposure and noise."""

    left: NDArray[np.float32]
    right: NDArray[np.float32]
    view: StereoView | None = None  # the camera that rectifies them, None: they are rectified


def pair_brightness(
    surfaces: Surfaces,
    panes: tuple[GlassPane, ...],
    view: StereoView,
    R_ned_optical: Floats,
    position_ned_m: Floats,
    light: Light,
) -> PairBrightness:
    """Both views from a left camera at a position (ned, metres) with a rotation."""
    left_at = np.array(position_ned_m, np.float64)
    across = np.asarray(R_ned_optical)[:, 0]
    offset = light.projector.offset_m if light.projector is not None else 0.0
    left, right = (
        brightness(surfaces, panes, view.intrinsics, R_ned_optical @ R, at, light, left_at + across * offset)
        for at, R in (
            (left_at, view.R_rectified_imager(0)),
            (left_at + across * view.baseline_m, view.R_rectified_imager(1)),
        )
    )
    return PairBrightness(left=left, right=right, view=view)


def expose_pair(bright: PairBrightness, exposure: Exposure, seed: int, frame: int = 0) -> StereoPair:
    """Both images; (seed, frame) chooses the noise. The exposure is that of the left image for both, as in a
    synchronised pair."""
    gain = automatic_gain(bright.left, exposure)
    rng = np.random.Generator(np.random.PCG64([seed, frame, 77]))
    left = expose(bright.left, gain, exposure, rng)
    right = expose(bright.right, gain * exposure.right_gain, exposure, rng)
    if bright.view is not None:
        left, right = bright.view.rectified(left, 0), bright.view.rectified(right, 1)
    return StereoPair(left=left, right=right)

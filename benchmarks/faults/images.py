"""The cameras of a flight: where they look, how often, and their images with faults."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical
from core.types import CameraInfo, CameraMount
from drivers.simulation.flight_path import VehicleState
from drivers.simulation.ray_caster import cast_rays
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import TYPICAL, measure
from drivers.simulation.source import camera_info

from .switches import NS, Switches

FRAME_HZ = 15.0
OTHER_HZ = (7.0, 10.0, 15.0, 20.0)
"""Rates of a second camera."""
FOCAL_SHARES = (0.8, 1.25)
"""Range of the change of the focal length when a camera is opened with another calibration."""


def cameras_of(seed: int) -> tuple[CameraInfo, ...]:
    """The cameras of a flight: one that looks ahead, and in every third flight a second one that looks to the right and overlaps
    its view, or does not. In every ninth flight both look ahead, one up and one down, and see the height band together."""
    front = camera_info(160, 120, max_range_m=20.0)
    if seed % 9 == 3:
        up, down = (replace(front.mount, pitch_rad=math.radians(pitch_deg)) for pitch_deg in (22.0, -22.0))
        return replace(front, mount=up), replace(front, camera="down", mount=down)
    if seed % 3:
        return (front,)
    mount = CameraMount(yaw_rad=math.radians(60.0 if seed % 2 else 85.0), x_m=0.1, y_m=0.15, z_m=-0.05)
    return front, replace(front, camera="right", mount=mount)


def reopened(info: CameraInfo, rng: np.random.Generator) -> CameraInfo:
    """The camera with another calibration."""
    focal_px = float(info.intrinsics.fx * rng.uniform(*FOCAL_SHARES))
    return replace(info, intrinsics=replace(info.intrinsics, fx=focal_px, fy=focal_px))


@dataclass(frozen=True, slots=True)
class Image:
    """depth_mm: (H, W) uint16; correct: it is complete, new and of the stamped instant; left_correct: the same without regard to
    columns on the right."""

    depth_mm: NDArray[np.uint16]
    correct: bool = True
    left_correct: bool = True


class ImageSource:
    """Makes the images of one camera. number: of the camera; period_ns: between two exposures."""

    def __init__(self, number: int, seed: int) -> None:
        rng = np.random.default_rng([7, seed, number])
        self.period_ns = round(NS / (FRAME_HZ if number == 0 else float(rng.choice(OTHER_HZ))))
        self.next_ns = round(rng.uniform(0.0, self.period_ns)) if number else 0
        self.frames = 0
        self._number, self._seed, self._rng = number, seed, rng
        self._images: deque[NDArray[np.uint16]] = deque(maxlen=16)
        self._repeating: list[NDArray[np.uint16]] = []
        self._repeats = 0

    def expose(self, info: CameraInfo, scene: Scene, state: VehicleState, s: Switches) -> Image | None:
        """Returns an image of the scene; None: the camera does not deliver it. Its faults include those of its stamp."""
        if s.repeats and not self._repeats:
            self._repeating = list(self._images)[-s.repeats :]
        self._repeats = s.repeats
        depth_mm = self._measured(info, scene, state, s.noise_factor)
        self._images.append(depth_mm)
        if not s.delivers:
            return None
        if s.repeats and self._repeating:
            return Image(self._repeating[self.frames % len(self._repeating)], False, False)
        if s.other_size:
            return Image(np.ascontiguousarray(depth_mm[:-20]), False, False)
        stamped = not s.stamp_shift_ns
        if s.unmeasured_share:
            depth_mm = np.where(self._rng.random(depth_mm.shape) < s.unmeasured_share, np.uint16(0), depth_mm)
        if s.covered:
            depth_mm = depth_mm.copy()
            depth_mm[:, : round(s.covered * depth_mm.shape[1])] = 0
            return Image(depth_mm, stamped and s.covered < 1.0, False)
        return Image(depth_mm, stamped, stamped)

    def _measured(self, info: CameraInfo, scene: Scene, state: VehicleState, noise_factor: float) -> NDArray[np.uint16]:
        self.frames += 1
        R_ned_optical = state.R_ned_frd @ rotation_frd_optical(info.mount)
        lever_m = np.array([info.mount.x_m, info.mount.y_m, info.mount.z_m])
        at = np.array(state.position_ned_m) + state.R_ned_frd @ lever_m
        depth_m, _ = cast_rays(
            scene.kinds, scene.rows, scene.corners, scene.halfspaces, info.intrinsics, R_ned_optical, at
        )
        sensor = TYPICAL.scaled_to(160)
        sensor = replace(sensor, ke_per_m=noise_factor * sensor.ke_per_m)
        return measure(depth_m, info, sensor, self._seed + 1000 * self._number, self.frames)

"""A simulated depth camera: `render` makes one frame of a scene with its truth.

    from drivers.simulation.source import camera_info, render
    from drivers.simulation.sensor_model import TYPICAL
    r = render("street", camera_info(), pitch_rad=0.2, sensor=TYPICAL, seed=1)
    r.depth_mm        # (480, 640) uint16, what the camera delivers
    r.R_level_optical # the rotation for the extractor
    r.truth.depth_m   # (480, 640) exact depth, r.truth.obstacle: which pixels show an obstacle

The sign of the angles is MAVLink's: a positive pitch looks up, a positive roll tilts to the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.types import CameraInfo, Intrinsics

from .ray_caster import cast_rays
from .scene_library import make_scene
from .scenes import Scene
from .sensor_model import PERFECT, SensorModel, measure

Floats = NDArray[np.float64]


def camera_info(
    width: int = 640,
    height: int = 480,
    *,
    camera: str = "front",
    focal_px: float | None = None,
    ke_per_m: float = 0.0015,
    max_range_m: float = 20.0,
    min_range_m: float = 0.3,
) -> CameraInfo:
    """A forward-looking camera of any image size; 640x480 has a focal length of 450 px, other sizes the same
    view."""
    focal = 450.0 * width / 640.0 if focal_px is None else focal_px
    intrinsics = Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    return CameraInfo(camera, intrinsics, max_range_m=max_range_m, min_range_m=min_range_m, ke_per_m=ke_per_m)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What each pixel's ray really meets."""

    depth_m: Floats  # (H, W) float64 Z, inf: nothing
    solid: NDArray[np.int32]  # (H, W) int32 index into the scene's solids or -1
    height_m: Floats  # (H, W) float64 above the scene's ground, nan: nothing
    points_level_cam_m: Floats  # (H, W, 3) float64, not finite: nothing
    drawn_ground: NDArray[np.bool_]

    def obstacle(self, min_height_m: float = 0.6) -> NDArray[np.bool_]:
        """(H, W) bool: the ray meets something, not the ground itself, at more than min_height_m above the
        ground."""
        return np.asarray(np.isfinite(self.depth_m) & ~self.drawn_ground & (self.height_m > min_height_m))

    def label(self, scene: Scene) -> NDArray[np.int32]:
        """(H, W) index into scene.names; -1: ground or nothing."""
        if not len(scene.label):
            return np.full(self.solid.shape, -1, np.int32)
        return np.where(self.solid >= 0, scene.label[self.solid], np.int32(-1))


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """One simulated frame: depth_mm (H, W) uint16 as the camera delivers it, the rotations and position (ned,
    metres) of the camera, and the truth."""

    scene: Scene
    info: CameraInfo
    depth_mm: NDArray[np.uint16]
    R_ned_optical: Floats
    R_level_optical: Floats
    position_ned_m: Floats
    truth: Truth


def look(scene: Scene, info: CameraInfo, R_ned_optical: Floats, position_ned_m: Floats) -> Truth:
    """The exact view of a scene from a camera at a position (ned, metres) with a rotation."""
    k = info.intrinsics
    depth, solid = cast_rays(scene.kinds, scene.rows, scene.corners, scene.halfspaces, k, R_ned_optical, position_ned_m)
    R_level = rotation_level_cam_optical(R_ned_optical)
    u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)
    with np.errstate(invalid="ignore"):
        ned = (rays @ R_ned_optical.T) * depth[..., None] + position_ned_m
        level = (rays @ R_level.T) * depth[..., None]
        g = scene.ground
        height = g.z_m + g.slope_x * ned[..., 0] + g.slope_y * ned[..., 1] - ned[..., 2]
    height[~np.isfinite(depth)] = np.nan
    ground = (solid >= 0) & (scene.label[solid] < 0) if len(scene.label) else np.zeros(solid.shape, np.bool_)
    return Truth(depth, solid, height, level, ground)


def render(
    scene: Scene | str,
    info: CameraInfo,
    *,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
    yaw_rad: float = 0.0,
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -2.0),
    sensor: SensorModel = PERFECT,
    seed: int = 0,
    frame: int = 0,
) -> Rendered:
    """One frame of a scene (or a scene's name, made with the same seed) from a camera with the given
    attitude.

    The angles are those of the camera itself (the mount in `info` is not used). The same (seed, frame) gives
    the same noise."""
    made = make_scene(scene, seed) if isinstance(scene, str) else scene
    R = rotation_from_euler(roll_rad, pitch_rad, yaw_rad) @ R_CAMFRD_OPTICAL
    at = np.array(position_ned_m)
    truth = look(made, info, R, at)
    depth = measure(truth.depth_m, info, sensor, seed, frame)
    return Rendered(made, info, depth, R, rotation_level_cam_optical(R), at, truth)

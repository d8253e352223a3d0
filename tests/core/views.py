"""Small analytic depth images and short ways to run the extractor on them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.params import Params
from core.stages.classify import classify, pixel_limits
from core.types import CameraInfo, ExtractorState, FrameModel, Intrinsics
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import Rendered, camera_info, render

SMALL = Intrinsics(40, 30, 30.0, 30.0, 19.5, 14.5)
"""A picture small enough for the interpreter: 67 by 53 degrees."""
INFO = CameraInfo("test", SMALL, ke_per_m=0.0015)
VIEW = camera_info(320, 240)
"""Half the usual resolution: the same view, a quarter of the time."""

CLEAN = SensorModel(sky_is_far=True)


def level(pitch_rad: float = 0.0, roll_rad: float = 0.0) -> NDArray[np.float64]:
    """R_level_optical of a camera that heads along x, with MAVLink's signs."""
    return rotation_from_euler(roll_rad, pitch_rad, 0.0) @ R_CAMFRD_OPTICAL


def pixel_grid(k: Intrinsics) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(u, v), each (H, W)."""
    u, v = np.meshgrid(np.arange(k.width, dtype=float), np.arange(k.height, dtype=float))
    return u, v


def to_mm(depth_m: NDArray[np.float64]) -> NDArray[np.uint16]:
    """uint16 millimetres; what is not finite or too far becomes UNKNOWN_MM."""
    good = np.isfinite(depth_m) & (depth_m > 0.0) & (depth_m < 65.0)
    return np.where(good, np.rint(1000.0 * np.where(good, depth_m, 0.0)), 0.0).astype(np.uint16)


def flat_wall(info: CameraInfo, distance_m: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> NDArray[np.uint16]:
    """Depth of an endless vertical wall that crosses the camera's heading `distance_m` ahead."""
    k, R = info.intrinsics, level(pitch_rad, roll_rad)
    u, v = pixel_grid(k)
    forward = R[0, 0] * (u - k.cx) / k.fx + R[0, 1] * (v - k.cy) / k.fy + R[0, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(forward > 1e-6, distance_m / forward, np.inf)
    return to_mm(depth)


def marks_of(depth_mm: NDArray[np.uint16], info: CameraInfo, ke_per_m: float = 1e-5) -> NDArray[np.uint16]:
    """Marks of `classify`, with no flying pixel removed. The noise coefficient determines the clear range."""
    out = np.empty(depth_mm.shape, np.uint16)
    classify(depth_mm, pixel_limits(info, ke_per_m, Params())._replace(relative=np.float32(1e9)), out)
    return out


def noisy(depth_mm: NDArray[np.uint16], ke_per_m: float, seed: int) -> NDArray[np.uint16]:
    """The same image with stereo noise: normal and independent in 1/Z."""
    rng = np.random.default_rng(seed)
    with np.errstate(divide="ignore"):
        inverse = 1000.0 / depth_mm + ke_per_m * rng.standard_normal(depth_mm.shape)
    inverse = np.where(depth_mm > 0, inverse, 0.0)
    with np.errstate(divide="ignore"):
        return to_mm(np.where(inverse > 0.0, 1.0 / inverse, np.inf))


def extract(
    depth: NDArray[np.uint16] | NDArray[np.float32],
    info: CameraInfo,
    R: NDArray[np.float64] | None = None,
    *,
    state: ExtractorState | None = None,
    keep_strips: bool = False,
    **params: float | str | bool,
) -> FrameModel:
    """The model of one image by a new extractor; `params` go to Params."""
    used = Params(**params)
    model, _ = Extractor(used).extract(depth, info, level() if R is None else R, state, keep_strips=keep_strips)
    return model


def seen(scene: Scene | SceneBuilder, info: CameraInfo = VIEW, **look: object) -> Rendered:
    """A scene rendered by a perfect sensor that reports sky as far."""
    made = scene.build() if isinstance(scene, SceneBuilder) else scene
    return render(made, info, **{"sensor": CLEAN, **look})


def first_hit(model: FrameModel, azimuth_rad: float, z_m: float) -> float:
    """Horizontal range at which the ray from the camera at this azimuth and height meets the nearest plane; inf: none."""
    direction = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad)])
    best = math.inf
    for ax, ay, bx, by, top, bottom in model.planes.astype(float):
        along = np.array([bx - ax, by - ay])
        det = direction[0] * -along[1] + direction[1] * along[0]
        if abs(det) < 1e-12 or not top <= z_m <= bottom:
            continue
        reach = (ax * -along[1] + ay * along[0]) / det
        share = (direction[0] * ay - direction[1] * ax) / det
        if reach > 0.0 and 0.0 <= share <= 1.0:
            best = min(best, reach)
    return best


def free_to(model: FrameModel, azimuth_rad: float, z_m: float) -> float:
    """Horizontal range up to which the profile calls this direction and height free; 0: nothing is."""
    f = model.free
    d = int(np.searchsorted(f.azimuth_edges_rad, azimuth_rad, side="right")) - 1
    layer = int(np.searchsorted(f.layer_edges_m, z_m, side="right")) - 1
    if not (0 <= d < f.free_to_m.shape[0] and 0 <= layer < f.free_to_m.shape[1]):
        return 0.0
    to, start = float(f.free_to_m[d, layer]), float(f.free_from_m[d, layer])
    return to if to > start else 0.0


def anything_free(model: FrameModel) -> bool:
    """Whether the profile claims any free range at all."""
    return bool(np.any(model.free.free_to_m > model.free.free_from_m))

"""Directions at the camera's height in recorded depth images: which have nothing measured nearby, which are called free.

The measured points are the only truth of a recording, so a direction counts as truly free if something is measured in it and
nothing nearer than TO_M."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from companion.config.loader import Config, load_config
from companion.importers.folder import open_folder
from companion.importers.report import ImportOptions, Report
from companion.pipeline.configured import effective_cameras
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.pipeline.transform import transform_model
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_quaternion, rotation_level_cam_optical
from core.types import CameraInfo, DepthFrame, FreeProfile
from drivers.base import Event

TO_M: Final = 2.0
HALF_HEIGHT_M: Final = 0.25
"""Points at most this far above and below the camera belong to a direction: half the height of a default layer."""


@dataclass(frozen=True, slots=True)
class FreeCounts:
    """Numbers of directions. truly_free: something is measured, nothing within TO_M; called: those of them that are called
    free up to TO_M; wrong: directions with a point in what is called free, nearer than TO_M."""

    frames: int = 0
    truly_free: int = 0
    called: int = 0
    wrong: int = 0

    def __add__(self, other: FreeCounts) -> FreeCounts:
        return FreeCounts(
            self.frames + other.frames,
            self.truly_free + other.truly_free,
            self.called + other.called,
            self.wrong + other.wrong,
        )


def count_recording(folder: Path, config_path: Path) -> FreeCounts:
    """Counts over all valid frames of a recording, modelled with a configuration. For cameras aligned with the vehicle's
    axes, as in the recordings."""
    config = load_config(config_path)
    source = open_folder(folder, ImportOptions(camera=config.camera("front"), use_tlog=False), Report())
    return sum((_counted(*frame) for frame in _frames(source.events(), config, source.cameras)), FreeCounts())


def _frames(
    events: Iterable[Event], config: Config, cameras: tuple[CameraInfo, ...]
) -> Iterable[tuple[CameraInfo, DepthFrame, PrismsResult]]:
    infos = effective_cameras(config, cameras)
    pipeline = Pipeline(
        infos,
        lambda info: Extractor(config.extractor, config.open_sky),
        config.sync,
        mount_check=config.mount_check,
    )
    for event in events:
        for output in pipeline.handle(event):
            if isinstance(event, DepthFrame) and isinstance(output, PrismsResult) and output.valid:
                yield infos[0], event, output


def _counted(info: CameraInfo, frame: DepthFrame, result: PrismsResult) -> FreeCounts:
    if result.model is None or result.attitude is None or result.transform is None:
        raise ValueError("the result is not valid")
    R_ned_optical = rotation_from_quaternion(result.attitude.q_ned_frd_wxyz) @ R_CAMFRD_OPTICAL
    points = level_points(frame.depth_mm, info, rotation_level_cam_optical(R_ned_optical))
    return count_directions(points, transform_model(result.model, result.transform.inverse()).free)


def level_points(
    depth_mm: NDArray[np.uint16], info: CameraInfo, R_level_cam_optical: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 3) m in level_cam: the measured pixels of an image (H, W). A depth of 0 or 65535 is no measurement."""
    v, u = np.nonzero((depth_mm != 0) & (depth_mm != np.iinfo(np.uint16).max))
    z, k = depth_mm[v, u] / 1000.0, info.intrinsics
    return np.column_stack([(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z]) @ R_level_cam_optical.T


def count_directions(points_level_cam_m: NDArray[np.float64], free: FreeProfile) -> FreeCounts:
    """Compares the directions of a profile in level_cam with measured points (N, 3) in level_cam."""
    p = points_level_cam_m[np.abs(points_level_cam_m[:, 2]) < HALF_HEIGHT_M]
    directions = len(free.azimuth_edges_rad) - 1
    direction = np.searchsorted(free.azimuth_edges_rad, np.arctan2(p[:, 1], p[:, 0]), side="right") - 1
    inside = (direction >= 0) & (direction < directions)
    direction, range_m = direction[inside], np.hypot(p[inside, 0], p[inside, 1])
    measured, near, wrong = (np.zeros(directions, np.bool_) for _ in range(3))
    measured[direction] = True
    near[direction[range_m < TO_M]] = True
    layer = int(np.searchsorted(free.layer_edges_m, 0.0, side="right")) - 1
    from_m, to_m = free.free_from_m[:, layer], np.fmin(free.free_to_m[:, layer], TO_M)
    wrong[direction[(from_m[direction] < range_m) & (range_m < to_m[direction])]] = True
    called = (to_m >= 0.999 * TO_M) & (from_m < TO_M)
    truly_free = measured & ~near
    return FreeCounts(1, int(truly_free.sum()), int((truly_free & called).sum()), int(wrong.sum()))

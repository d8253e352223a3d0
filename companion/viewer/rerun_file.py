"""Writes a log as a Rerun recording (extra `rerun`): planes, depth images, vehicle, trajectory and diagnostics.

Rerun draws neither foxglove.SceneUpdate nor 16UC1 images as depth, so an MCAP log alone shows no obstacles there. All
entities are below `ned` (x north, y east, z down). Without a position the origin is the vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_frd_optical
from core.types import CameraInfo, is_measured
from drivers.optional_library import optional_module

from .colors import palette, range_index
from .frame import FrameStatus, ViewFrame
from .geometry import nearest_m, plane_corners_m
from .placement import placed_model

RERUN_NAME: Final = "flight.rrd"
ROOT: Final = "ned"
TIMELINE: Final = "time"
QUADS: Final = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
"""Two triangles of the four corners of a plane."""


def rerun_library() -> Any:
    """The module of rerun-sdk. Raises DeviceNotFound."""
    return optional_module("rerun", "a Rerun recording needs rerun-sdk", "rerun-sdk>=0.28")


class RerunWriter:
    """Call `add` with each frame in order, then `close`. Raises DeviceNotFound without rerun-sdk, and OSError."""

    def __init__(self, path: Path, title: str) -> None:
        self._rr = rr = rerun_library()
        path.unlink(missing_ok=True)
        self._stream = rr.RecordingStream("osape-companion", recording_id=title)
        self._stream.save(str(path))
        self._stream.log(ROOT, rr.ViewCoordinates.FRD, static=True)
        self._cameras: set[str] = set()
        self._trail: list[tuple[float, float, float]] = []
        self.frames = 0

    def add(self, frame: ViewFrame) -> None:
        """Adds a frame."""
        rr, stream = self._rr, self._stream
        stream.set_time(TIMELINE, duration=frame.t_ns / 1e9)
        self._describe(frame.info)
        camera = f"{ROOT}/vehicle/{frame.info.camera}"
        position = frame.position_ned_m or (0.0, 0.0, 0.0)
        if frame.R_ned_frd is not None:
            stream.log(f"{ROOT}/vehicle", rr.Transform3D(translation=position, mat3x3=frame.R_ned_frd))
        if frame.position_ned_m is not None:
            self._trail.append(frame.position_ned_m)
            stream.log(f"{ROOT}/position", rr.Points3D([position], radii=0.1, colors=[[255, 255, 255]]))
        if frame.depth_mm is not None:
            stream.log(f"{camera}/image/depth", rr.DepthImage(measured_mm(frame.depth_mm), meter=1000.0))
        self._planes(frame)
        blind = frame.status is not FrameStatus.VALID
        level = rr.TextLogLevel.WARN if blind else rr.TextLogLevel.INFO
        text = f"{frame.info.camera} frame {frame.sequence}: {frame.cause or frame.status}"
        stream.log("decisions", rr.TextLog(text, level=level))
        self.frames += 1

    def _describe(self, info: CameraInfo) -> None:
        """The camera's mount and intrinsics, once."""
        if info.camera in self._cameras:
            return
        self._cameras.add(info.camera)
        rr, k, m = self._rr, info.intrinsics, info.mount
        entity = f"{ROOT}/vehicle/{info.camera}"
        R_frd_optical = rotation_frd_optical(m)
        self._stream.log(entity, rr.Transform3D(translation=(m.x_m, m.y_m, m.z_m), mat3x3=R_frd_optical), static=True)
        pinhole = rr.Pinhole(
            focal_length=(k.fx, k.fy),
            principal_point=(k.cx, k.cy),
            resolution=(k.width, k.height),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=1.0,
        )
        self._stream.log(f"{entity}/image", pinhole, static=True)

    def _planes(self, frame: ViewFrame) -> None:
        """The planes; a frame without a model removes those before it."""
        rr, entity = self._rr, f"{ROOT}/obstacles/{frame.info.camera}"
        model = placed_model(frame)
        if model is None or frame.model is None or not len(model.planes):
            self._stream.log(entity, rr.Clear(recursive=False))
            return
        corners = plane_corners_m(model.planes).reshape(-1, 3)
        first = 4 * np.arange(len(model.planes), dtype=np.uint32)
        rgb = palette()[range_index(nearest_m(frame.model.planes), frame.info)]
        self._stream.log(
            entity,
            rr.Mesh3D(
                vertex_positions=corners.astype(np.float32),
                triangle_indices=(first[:, None, None] + QUADS).reshape(-1, 3),
                vertex_colors=np.repeat(rgb, 4, axis=0),
            ),
        )

    def close(self) -> None:
        """Writes the trajectory and finishes the file."""
        if self._trail:
            line = self._rr.LineStrips3D([self._trail], colors=[[255, 170, 0]], radii=0.03)
            self._stream.log(f"{ROOT}/trajectory", line, static=True)
        self._stream.flush()
        self._stream.disconnect()


def measured_mm(depth_mm: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """(H, W) uint16 millimetres; 0, which viewers leave out, where there is no measured distance."""
    return np.where(is_measured(depth_mm), depth_mm, 0).astype(np.uint16)

"""wavemap (pywavemap) over the frames of a flight: a wavelet octree of occupancy. No dependency: it is used where it is
installed; docs/research/benchmarks/peers.md has how it was built."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.sequences.frame_input import FrameInput
from benchmarks.peers.sequences.mapper import MapModel, Mapper, cube_model, library_makers

NAME: Final = "wavemap"
CELLS_M: Final = (0.1, 0.2)
SCALING_FREE, SCALING_OCCUPIED = 0.2, 0.4
"""Of its examples for depth cameras."""
SIGMA_AT_M: Final = 8.0
"""Its model has one standard deviation for all ranges: that of the camera at this range."""
UNMEASURED_M: Final = -100.0
"""Depth of pixels without a measurement: 0 would be a surface at the camera, 6 standard deviations thick."""
OCCUPIED_LOG_ODDS: Final = 1e-3
"""Its threshold is 0; what is nearer to 0 than this was never observed."""
CLEANED_EVERY: Final = 24
"""Frames between two thresholdings and prunings: 2 s, as in its examples."""
_AROUND_M: Final = 21.0
_CHUNK: Final = 2_000_000


class Wavemap:
    """The map at one cell size."""

    unit = "cubes"

    def __init__(self, library: ModuleType, cell_m: float) -> None:
        self.name = f"{NAME} {cell_m:g} m"
        self._library, self._cell_m = library, cell_m
        self._map = library.Map.create(
            {"type": "hashed_chunked_wavelet_octree", "min_cell_width": {"meters": cell_m}},
        )
        self._pipeline: Any = None
        self._frames = 0

    def add(self, frame: FrameInput) -> None:
        """Integrates the sorted depth image."""
        if self._pipeline is None:
            self._pipeline = self._library.Pipeline(self._map)
            self._pipeline.add_integrator("camera", integrator_parameters(frame))
        pose = np.eye(4, dtype=np.float32)
        pose[:3, :3], pose[:3, 3] = frame.R_ned_optical, frame.position_m
        depth_m = np.where(frame.depth_m > 0.0, frame.depth_m, UNMEASURED_M).astype(np.float32)
        image = self._library.PosedImage(self._library.Pose(pose), self._library.Image(depth_m.T))
        self._pipeline.run_pipeline(["camera"], image)
        self._frames += 1
        if self._frames % CLEANED_EVERY == 0:
            self._map.threshold()
            self._map.prune()

    def model(self, frame: FrameInput) -> MapModel:
        """The occupied cells around the camera; bytes: of the stored map, free space included."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "map.wvmp"
            self._map.store(str(file))
            stored = file.stat().st_size
        return cube_model(self._occupied(frame), self._cell_m, frame, stored)

    def _occupied(self, frame: FrameInput) -> NDArray[np.int64]:
        """(N, 3) indices of the occupied cells."""
        low, high = (np.asarray(i, np.int64).ravel() for i in (self._map.min_index, self._map.max_index))
        at = np.floor(frame.position_m / self._cell_m).astype(np.int64)
        around = int(_AROUND_M / self._cell_m)
        low, high = np.maximum(low, at - around), np.minimum(high, at + around)
        found = [np.zeros((0, 3), np.int64)]
        shape = np.maximum(high - low + 1, 0)
        total = int(np.prod(shape))
        for first in range(0, total, _CHUNK):
            cells = np.column_stack(np.unravel_index(np.arange(first, min(first + _CHUNK, total)), tuple(shape))) + low
            values = self._map.get_cell_values(np.ascontiguousarray(cells, np.int32))
            found.append(cells[np.asarray(values).ravel() > OCCUPIED_LOG_ODDS])
        return np.vstack(found)


def integrator_parameters(frame: FrameInput) -> dict[str, Any]:
    """The settings of its depth camera."""
    info = frame.exposure.info
    k = info.intrinsics
    return {
        "projection_model": {
            "type": "pinhole_camera_projector",
            "width": k.width,
            "height": k.height,
            "fx": k.fx,
            "fy": k.fy,
            "cx": k.cx,
            "cy": k.cy,
        },
        "measurement_model": {
            "type": "continuous_ray",
            "range_sigma": {"meters": info.ke_per_m * SIGMA_AT_M**2},
            "scaling_free": SCALING_FREE,
            "scaling_occupied": SCALING_OCCUPIED,
        },
        "integration_method": {
            "type": "hashed_chunked_wavelet_integrator",
            "min_range": {"meters": info.min_range_m},
            "max_range": {"meters": info.max_range_m},
        },
    }


def makers() -> list[Callable[[], Mapper]] | str:
    """wavemap at its cell sizes, or why it cannot run."""
    return library_makers("pywavemap", Wavemap, CELLS_M, "it has no wheel and is built from its sources")

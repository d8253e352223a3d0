"""OctoMap (pyoctomap) over the frames of a flight: one octree, every frame inserted with its rays."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Final

from benchmarks.peers.octomap import NAME, occupied_leaves, small_cubes
from benchmarks.peers.sequences.frame_input import FrameInput
from benchmarks.peers.sequences.mapper import MapModel, Mapper, cube_model, library_makers

CELLS_M: Final = (0.1, 0.2)


class OctoMap:
    """An octree with the library's own probabilities (hit 0.7, miss 0.4, clamped to 0.12..0.97, occupied from 0.5)."""

    unit = "cubes"

    def __init__(self, library: ModuleType, cell_m: float) -> None:
        self.name = f"{NAME} {cell_m:g} m"
        self._cell_m, self._tree = cell_m, library.OcTree(cell_m)

    def add(self, frame: FrameInput) -> None:
        """Inserts the points and their rays. Points of one leaf are one hit (discretize)."""
        points = frame.points_m()
        if len(points):
            self._tree.insertPointCloud(points, frame.position_m, -1.0, False, True)

    def model(self, frame: FrameInput) -> MapModel:
        """The occupied leaves; bytes: the binary stream, free space included."""
        cubes = small_cubes(*occupied_leaves(self._tree), self._cell_m)
        stored = len(self._tree.writeBinary()) if self._tree.size() else 0
        return cube_model(cubes, self._cell_m, frame, stored)


def makers() -> list[Callable[[], Mapper]] | str:
    """OctoMap at its leaf sizes, or why it cannot run."""
    return library_makers("pyoctomap", OctoMap, CELLS_M, "python -m benchmarks.peers.install")

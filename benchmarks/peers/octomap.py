"""OctoMap (pyoctomap): one frame's points inserted into an empty octree, rays and all."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.cloud import Cloud
from benchmarks.peers.methods import Model, Peer
from benchmarks.peers.voxels import cube_model
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
NAME = "OctoMap"
CELLS_M = (0.1, 0.2, 0.4)


class OctoMap:
    """An octree of one leaf size, with the library's own chances of hits and misses."""

    unit = "leaves"

    def __init__(self, library: ModuleType, cell_m: float) -> None:
        self.name = f"OctoMap {cell_m:g} m"
        self._library, self._cell_m = library, cell_m

    def forget(self) -> None:
        """Does nothing: it keeps no state between frames."""

    def build(self, frame: Rendered, cloud: Cloud) -> Any:
        """The tree. Points of one leaf are one hit (discretize): the library's own fast way."""
        tree = self._library.OcTree(self._cell_m)
        tree.insertPointCloud(cloud.points_m, np.zeros(3), -1.0, False, True)
        return tree

    def model(self, built: Any) -> Model:
        """Its occupied leaves; bytes: the binary stream of a tree that holds nothing else (free space costs more)."""
        centres, sizes = occupied_leaves(built)
        bare = self._library.OcTree(self._cell_m)
        cubes = small_cubes(centres, sizes, self._cell_m)
        for x, y, z in (cubes + 0.5) * self._cell_m:
            bare.updateNode([x, y, z], True)
        stored = len(bare.writeBinary()) if len(cubes) else 0
        return cube_model(cubes, self._cell_m, np.zeros(3), primitives=len(centres), stored_bytes=stored)


def occupied_leaves(tree: Any) -> tuple[Floats, Floats]:
    """Centres (N, 3) and side lengths (N,) of a tree's occupied leaves.

    By its iterator: extractPointCloud gives corners for centres."""
    leaves = [(*leaf.getCoordinate(), leaf.getSize()) for leaf in tree.begin_leafs() if tree.isNodeOccupied(leaf)]
    table = np.array(leaves, np.float64).reshape(-1, 4)
    return table[:, :3], table[:, 3]


def small_cubes(centres: Floats, sizes: Floats, cell_m: float) -> NDArray[np.int64]:
    """(M, 3) indices of the smallest cubes that leaves (centres (N, 3), sizes (N,)) consist of: cube i reaches from
    i * cell_m to (i + 1) * cell_m."""
    found = [np.zeros((0, 3), np.int64)]
    for side in np.unique(np.rint(sizes / cell_m).astype(np.int64)):
        mine = centres[np.rint(sizes / cell_m) == side]
        low = np.rint(mine / cell_m - 0.5 * side).astype(np.int64)
        inner = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        found.append((low[:, None, :] + inner).reshape(-1, 3))
    return np.vstack(found)


def peers() -> list[Peer] | str:
    """OctoMap at its leaf sizes, or why it cannot run."""
    try:
        library = importlib.import_module("pyoctomap")
    except (ImportError, OSError) as error:
        return f"not installed ({error}): pip install pyoctomap"
    return [OctoMap(library, cell) for cell in CELLS_M]

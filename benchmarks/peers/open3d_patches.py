"""Open3D: its planar patches (robust statistics on a cloud with normals) and its voxel grid."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.cloud import Cloud
from benchmarks.peers.methods import Model, Peer
from benchmarks.peers.solids import patch_distances, patch_stops
from benchmarks.peers.voxels import cube_model
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
NAME = "Open3D"
VOXELS_M = (0.1, 0.2, 0.4)
VOXEL_BYTES, PATCH_BYTES = 6, 36
"""Three int16 a voxel; a corner and two edges in float32 a patch."""
THIN_M, NEIGHBOURS, NORMAL_DEG, COPLANAR_DEG, OUTLIERS = 0.1, 30, 60.0, 60.0, 0.75
"""Chosen on tuning seeds for the sake of the patches: thinned to 0.1 m they are more and faster than from all points, and
a coplanarity of 60 instead of 75 degrees finds more in noise; the rest are the library's own values."""


class Patches:
    """Planar patches of a thinned cloud."""

    unit = "patches"
    name = "Open3D planar patches"

    def __init__(self, library: ModuleType) -> None:
        self._o3d = library

    def forget(self) -> None:
        """Does nothing: it keeps no state between frames."""

    def build(self, frame: Rendered, cloud: Cloud) -> list[Any]:
        """Oriented boxes around the patches."""
        geometry, points = self._o3d.geometry, self._o3d.utility.Vector3dVector(cloud.points_m)
        thin = geometry.PointCloud(points).voxel_down_sample(THIN_M)
        if len(thin.points) <= NEIGHBOURS:
            return []
        around = geometry.KDTreeSearchParamKNN(NEIGHBOURS)
        thin.estimate_normals(around)
        found: list[Any] = thin.detect_planar_patches(
            normal_variance_threshold_deg=NORMAL_DEG,
            coplanarity_deg=COPLANAR_DEG,
            outlier_ratio=OUTLIERS,
            min_plane_edge_length=0.0,
            min_num_points=0,
            search_param=around,
        )
        return found

    def model(self, built: list[Any]) -> Model:
        """The middle rectangles of the boxes."""
        patches = np.array([rectangle(np.asarray(b.center), np.asarray(b.R), np.asarray(b.extent)) for b in built])
        patches = patches.reshape(-1, 9)

        def off(points: Floats) -> Floats:
            return patch_distances(points, patches)

        return Model(
            primitives=len(patches),
            facing=len(patches),
            bytes=PATCH_BYTES * len(patches),
            stops=lambda k, R: patch_stops(patches, k, R),
            surface=off,
            body=off,
        )


def rectangle(centre: Floats, axes: Floats, extent: Floats) -> Floats:
    """(9,) corner and edges of an oriented box's middle rectangle; its normal is the third column of axes (3, 3)."""
    first, second = axes[:, 0] * extent[0], axes[:, 1] * extent[1]
    return np.concatenate([centre - 0.5 * (first + second), first, second])


class Voxels:
    """The voxel grid: every cube that holds a point."""

    unit = "voxels"

    def __init__(self, library: ModuleType, cell_m: float) -> None:
        self.name = f"Open3D VoxelGrid {cell_m:g} m"
        self._o3d, self._cell_m = library, cell_m

    def forget(self) -> None:
        """Does nothing: it keeps no state between frames."""

    def build(self, frame: Rendered, cloud: Cloud) -> Any:
        """The grid."""
        points = self._o3d.utility.Vector3dVector(cloud.points_m)
        return self._o3d.geometry.VoxelGrid.create_from_point_cloud(self._o3d.geometry.PointCloud(points), self._cell_m)

    def model(self, built: Any) -> Model:
        """Its voxels."""
        indices = np.array([v.grid_index for v in built.get_voxels()], np.int64).reshape(-1, 3)
        origin = np.asarray(built.origin, np.float64)
        size = VOXEL_BYTES * len(indices)
        return cube_model(indices, self._cell_m, origin, primitives=len(indices), stored_bytes=size)


def peers() -> list[Peer] | str:
    """Open3D's models, or why it cannot run."""
    try:
        library = importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        return f"not installed ({error}): pip install open3d (about 1 GB)"
    library.utility.set_verbosity_level(library.utility.VerbosityLevel.Error)
    return [Patches(library), *(Voxels(library, cell) for cell in VOXELS_M)]

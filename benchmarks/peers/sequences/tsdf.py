"""Open3D's VoxelBlockGrid over the frames of a flight: a truncated signed distance field, judged by its mesh."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.open3d_patches import NAME
from benchmarks.peers.sequences.frame_input import GROUND_CUT_M, FrameInput
from benchmarks.peers.sequences.mapper import MapModel, Mapper, library_makers
from core.types import Intrinsics

Floats = NDArray[np.float64]
VOXELS_M: Final = (0.1, 0.2)
BLOCK, BLOCKS, WEIGHT, TRUNCATION = 16, 2000, 3.0, 8.0
"""Voxels along a block, blocks at the start, least observations of a surface voxel, truncation in voxels: the library's
own values, except for the number of blocks, which grows."""
VOXEL_BYTES: Final = 8
"""Distance and weight in float32."""


class Tsdf:
    """The distance field at one voxel size."""

    unit = "triangles"

    def __init__(self, library: ModuleType, voxel_m: float) -> None:
        self.name = f"{NAME} TSDF {voxel_m:g} m"
        self._o3d = library
        core = library.core
        self._grid = library.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight"),
            attr_dtypes=(core.float32, core.float32),
            attr_channels=((1,), (1,)),
            voxel_size=voxel_m,
            block_resolution=BLOCK,
            block_count=BLOCKS,
        )

    def add(self, frame: FrameInput) -> None:
        """Integrates the sorted depth image into the blocks around its surfaces, as the library's examples do."""
        if not frame.depth_m.any():
            return
        o3d, info = self._o3d, frame.exposure.info
        depth = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(frame.depth_m)))
        camera = o3d.core.Tensor(camera_matrix(info.intrinsics))
        extrinsic = np.eye(4)
        extrinsic[:3, :3] = frame.R_ned_optical.T
        extrinsic[:3, 3] = -frame.R_ned_optical.T @ frame.position_m
        pose = o3d.core.Tensor(extrinsic)
        given = (depth, camera, pose, 1.0, info.max_range_m, TRUNCATION)
        blocks = self._grid.compute_unique_block_coordinates(*given)
        self._grid.integrate(blocks, *given)

    def model(self, frame: FrameInput) -> MapModel:
        """The mesh without the ground; bytes: of the blocks in use."""
        blocks = int(self._grid.hashmap().size())
        stored = blocks * BLOCK**3 * VOXEL_BYTES
        # the library raises an error instead of making a mesh without a triangle
        if not blocks or float(self._grid.attribute("weight").max().item()) < WEIGHT:
            return MapModel(primitives=0, bytes=stored, stops=_never)
        mesh = self._grid.extract_triangle_mesh(WEIGHT)
        vertices, triangles = mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy()
        if not len(triangles):
            return MapModel(primitives=0, bytes=stored, stops=_never)
        centres = vertices[triangles].mean(axis=1).astype(np.float64)
        kept = triangles[frame.above_ground_m(centres) >= GROUND_CUT_M]
        return MapModel(primitives=len(kept), bytes=stored, stops=mesh_stops(self._o3d, vertices, kept))


def camera_matrix(k: Intrinsics) -> Floats:
    """(3, 3) of a pinhole camera."""
    return np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]])


def mesh_stops(library: ModuleType, vertices: NDArray[np.float32], triangles: NDArray[Any]) -> Any:
    """The `stops` of a MapModel for a mesh; triangles (N, 3) stop rays from either side."""
    if not len(triangles):
        return _never
    core = library.core
    scene = library.t.geometry.RaycastingScene()
    scene.add_triangles(core.Tensor(vertices.astype(np.float32)), core.Tensor(triangles.astype(np.uint32)))

    def meets(position_m: Floats, intrinsics: Intrinsics, R_ned_optical: Floats) -> Floats:
        k = intrinsics
        u, v = np.meshgrid(np.arange(k.width), np.arange(k.height))
        optical = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)
        rays = np.concatenate([np.broadcast_to(position_m, optical.shape), optical @ R_ned_optical.T], axis=-1)
        # a direction with Z = 1: the ray's parameter is the depth
        found = scene.cast_rays(core.Tensor(rays.astype(np.float32)))
        return np.asarray(found["t_hit"].numpy().astype(np.float64))

    return meets


def _never(position_m: Floats, intrinsics: Intrinsics, R_ned_optical: Floats) -> Floats:
    return np.full((intrinsics.height, intrinsics.width), np.inf)


def makers() -> list[Callable[[], Mapper]] | str:
    """The distance field at its voxel sizes, or why it cannot run."""
    return library_makers("open3d", Tsdf, VOXELS_M, "python -m benchmarks.peers.install")

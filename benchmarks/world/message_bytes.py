"""Bytes of a flight: our world, OctoMap and the grid in the manner of 3DP, each from frames with the true pose."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.cloud import cloud_of
from benchmarks.peers.grid_outlines import outlines
from benchmarks.peers.grid_prisms import CELLS_M, FOCAL_PX, HEIGHT_M, LAYER_M, MIN_POINTS, MIN_SHARE, simplified
from benchmarks.peers.octomap import occupied_leaves, small_cubes
from benchmarks.world.flights import CONDITION
from benchmarks.world.truth import Merged, to_ned
from core.world.serialize import bytes_of
from drivers.simulation.source import Rendered

OCTOMAP_M = 0.2
OCTOMAP_STEP = 4
"""Frames to the next that OctoMap is given: casting rays through leaves takes it long, and a view changes little."""
AGREE = 2
"""Frames that must have found a cell occupied: fewer are taken for noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bytes:
    """One flight. disk, stream: of our world in the end, and of all its messages; grids: of each cell size in the end;
    octomap, octomap_free: occupied leaves alone, and with what is free; None: pyoctomap is not there."""

    flight: str
    frames: int
    planes: int
    disk: int
    stream: int
    stream_planes: int
    grids: dict[float, int]
    octomap: int | None
    octomap_free: int | None


def measured(name: str, m: Merged, rendered: Sequence[Rendered]) -> Bytes:
    """All of one flight."""
    clouds = [to_ned(r, cloud_of(r, CONDITION.ke_per_m).points_m) for r in rendered]
    octomap = _octomap(clouds, rendered)
    return Bytes(
        flight=name,
        frames=len(rendered),
        planes=m.steps[-1].planes,
        disk=len(bytes_of(m.world.saved())),
        stream=m.steps[-1].stream_bytes,
        stream_planes=m.steps[-1].plane_bytes,
        grids={cell: grid_bytes(clouds, rendered, cell) for cell in CELLS_M},
        octomap=None if octomap is None else octomap[0],
        octomap_free=None if octomap is None else octomap[1],
    )


def grid_bytes(clouds: Sequence[NDArray[np.float64]], rendered: Sequence[Rendered], cell_m: float) -> int:
    """8 bytes a vertex and 8 a polygon of the outlines of all cells that AGREE frames found occupied, each by the rule
    that one frame is judged by (benchmarks/peers/grid_prisms.py)."""
    found: list[NDArray[np.int64]] = []
    for points, r in zip(clouds, rendered, strict=True):
        if not len(points):
            continue
        cells = np.column_stack([np.floor(-points[:, 2] / LAYER_M), np.floor(points[:, :2] / cell_m)]).astype(np.int64)
        kept, count = np.unique(cells, axis=0, return_counts=True)
        off = (kept[:, 1:] + 0.5) * cell_m - r.position_ned_m[:2]
        range2 = np.maximum((off**2).sum(axis=1), cell_m**2)
        focal = FOCAL_PX * r.info.intrinsics.width / 640.0
        found.append(kept[count >= np.maximum(MIN_POINTS, MIN_SHARE * focal**2 * cell_m * HEIGHT_M / range2)])
    if not found:
        return 0
    cells, frames = np.unique(np.concatenate(found), axis=0, return_counts=True)
    cells = cells[frames >= AGREE]
    total = 0
    for layer in np.unique(cells[:, 0]):
        mine = cells[cells[:, 0] == layer, 1:]
        low = mine.min(axis=0) - 1
        occupied = np.zeros(mine.max(axis=0) - low + 2, bool)
        occupied[tuple((mine - low).T)] = True
        for loop in outlines(occupied):
            corners = simplified(loop, cell_m, 0.75)
            total += 8 * len(corners) + 8 if len(corners) else 0
    return total


def _octomap(clouds: Sequence[NDArray[np.float64]], rendered: Sequence[Rendered]) -> tuple[int, int] | None:
    """(occupied alone, with free space) as its own binary stream."""
    try:
        library = importlib.import_module("pyoctomap")
    except (ImportError, OSError):
        return None
    tree = library.OcTree(OCTOMAP_M)
    for points, r in list(zip(clouds, rendered, strict=True))[::OCTOMAP_STEP]:
        if len(points):
            tree.insertPointCloud(points, r.position_ned_m.astype(np.float64), -1.0, False, True)
    bare = library.OcTree(OCTOMAP_M)
    centres, sizes = occupied_leaves(tree)
    for x, y, z in (small_cubes(centres, sizes, OCTOMAP_M) + 0.5) * OCTOMAP_M:
        bare.updateNode([x, y, z], True)
    return len(bare.writeBinary()) if len(centres) else 0, len(tree.writeBinary())

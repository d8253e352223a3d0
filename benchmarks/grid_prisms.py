"""The grid baseline in the manner of 3DP: occupied cells of a 2-D grid per 2 m of height, outlined by
polygons.

What it is given is generous: the true ground, and every point's true attitude. Its polygons are simplified.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulated import Rendered

Floats = NDArray[np.float64]
CELLS_M = (0.1, 0.2, 0.4, 0.8)
LAYER_M = 2.0
MIN_POINTS = 3
"""Points that make a cell occupied: fewer are taken for noise."""
EPSILON_CELLS = 0.75
"""Tolerance of the simplification in cells: just above the 0.71 that turns a diagonal staircase into a
line."""
DROP_M = 0.3
"""Lower points are ground."""


@dataclass(frozen=True, slots=True, eq=False)
class GridPrisms:
    """planes: (N, 6) level_cam, the polygons' sides; polygons: how many; bytes: 8 a vertex and 8 a
    polygon."""

    planes: Floats
    polygons: int
    bytes: int


def obstacle_points(frame: Rendered, ke_per_m: float) -> Floats:
    """(P, 3) measured points above the ground in level_cam, from the noisy depth; ke_per_m: its true
    noise."""
    k = frame.info.intrinsics
    v, u = np.nonzero((frame.depth_mm > 0) & (frame.depth_mm < 65534))
    z = frame.depth_mm[v, u].astype(np.float64) / 1000.0
    optical = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
    ground = frame.scene.ground
    ned = optical @ frame.R_ned_optical.T + frame.position_ned_m
    height = ground.z_m + ground.slope_x * ned[:, 0] + ground.slope_y * ned[:, 1] - ned[:, 2]
    below_camera = ground.z_m - frame.position_ned_m[2]
    keep = height > np.maximum(DROP_M, 3.0 * ke_per_m * z * abs(below_camera - height))
    return np.asarray(optical[keep] @ frame.R_level_optical.T)


def grid_prisms(points_m: Floats, ground_z_m: float, cell_m: float) -> GridPrisms:
    """Prisms around points (P, 3) in level_cam above a ground at z = ground_z_m, in layers of 2 m."""
    layer = np.floor((ground_z_m - points_m[:, 2]) / LAYER_M).astype(np.int64)
    planes: list[Floats] = []
    polygons = 0
    for number in np.unique(layer):
        xy = points_m[layer == number, :2]
        low = np.floor(xy.min(axis=0) / cell_m).astype(np.int64) - 1
        cells = np.floor(xy / cell_m).astype(np.int64) - low
        count = np.zeros(cells.max(axis=0) + 2, np.int64)
        np.add.at(count, (cells[:, 0], cells[:, 1]), 1)
        bottom = ground_z_m - number * LAYER_M
        for loop in outlines(count >= MIN_POINTS):
            simple = cv2.approxPolyDP(loop.astype(np.float32).reshape(-1, 1, 2), EPSILON_CELLS, True).reshape(-1, 2)
            corners = (simple.astype(np.float64) + low) * cell_m
            polygons += 1
            following = np.roll(corners, -1, axis=0)
            heights = np.tile([bottom - LAYER_M, bottom], (len(corners), 1))
            planes.append(np.hstack([corners, following, heights]))
    joined = np.vstack(planes) if planes else np.zeros((0, 6))
    return GridPrisms(joined, polygons, 8 * len(joined) + 8 * polygons)


def outlines(occupied: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Closed outlines (M, 2) of the occupied cells, in cells, with the occupied side on the left seen from
    above (x forward, y right), corners only. Cells that touch by a corner belong together; the border must be
    free."""
    onward: dict[tuple[int, int], list[tuple[int, int]]] = {}
    # each entry: the free neighbour's offset, then start and end of the shared side
    sides = (
        ((-1, 0), (0, 0), (0, 1)),
        ((0, 1), (0, 1), (1, 1)),
        ((1, 0), (1, 1), (1, 0)),
        ((0, -1), (1, 0), (0, 0)),
    )
    for (dx, dy), start, end in sides:
        neighbour = np.roll(occupied, (-dx, -dy), axis=(0, 1))
        for x, y in np.argwhere(occupied & ~neighbour).tolist():
            onward.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    loops = []
    while onward:
        first = at = next(iter(onward))
        loop, heading = [], (0, 0)
        while True:
            choices = onward[at]
            # where two cells touch by a corner, turning away from the cell just followed keeps both in one outline
            pick = max(range(len(choices)), key=lambda i: _turn(heading, at, choices[i])) if len(choices) > 1 else 0
            following = choices.pop(pick)
            if not choices:
                del onward[at]
            step = (following[0] - at[0], following[1] - at[1])
            if step != heading:
                loop.append(at)
            at, heading = following, step
            if at == first:
                break
        loops.append(np.array(loop, np.int64))
    return loops


def _turn(heading: tuple[int, int], at: tuple[int, int], to: tuple[int, int]) -> int:
    """> 0 where going on to `to` turns right seen from above."""
    return heading[0] * (to[1] - at[1]) - heading[1] * (to[0] - at[0])

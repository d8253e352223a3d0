"""Occupied cubes of one size as a model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.methods import Model
from benchmarks.peers.solids import box_distances, box_stops, cube_faces

Floats = NDArray[np.float64]


def cube_model(
    indices: NDArray[np.int64], side_m: float, origin_m: Floats, *, primitives: int, stored_bytes: int
) -> Model:
    """Cubes (N, 3 indices); cube i reaches from origin + i * side to origin + (i + 1) * side, level_cam."""
    low = indices * side_m + origin_m
    boxes = np.hstack([low, low + side_m]).reshape(-1, 6)
    faces = cube_faces(indices, side_m, origin_m)
    return Model(
        primitives=primitives,
        facing=primitives,
        bytes=stored_bytes,
        stops=lambda k, R: box_stops(boxes, k, R),
        surface=lambda points: box_distances(points, faces),
        body=lambda points: box_distances(points, boxes),
    )

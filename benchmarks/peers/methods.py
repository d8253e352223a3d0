"""The methods of the comparison and their common model: our method and the grid baseline.

Each builds its own representation of a frame (which is timed) and converts it to a `Model`, which is scored. Ours start
from the depth image; the others from the cloud of benchmarks.peers.cloud."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.case import prism_bytes
from benchmarks.fidelity.metrics import distances, stops
from benchmarks.paper.forms import extractor_of, params_of
from benchmarks.peers.cloud import Cloud, cloud_of
from benchmarks.peers.grid_bodies import body_distances, prism_stops
from benchmarks.peers.grid_prisms import EPSILON_CELLS, GridPrisms, facing_camera, grid_of, grid_prisms
from core.types import ExtractorState, FrameModel, Intrinsics
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
NOT_SIMPLIFIED, UNSORTED = ", not simplified", ", of all pixels"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Model:
    """The representation of one frame. primitives: planes, cubes or patches; facing: those that face the camera; bytes:
    stored as compactly as the method itself does.

    stops(intrinsics, R_level_optical): depth Z (H, W) at which each ray first meets it, inf: never. surface(points (P,
    3)), body(points): distance to its surface, and to its body, 0 inside; equal where it has no body."""

    primitives: int
    facing: int
    bytes: int
    stops: Callable[[Intrinsics, Floats], Floats]
    surface: Callable[[Floats], Floats]
    body: Callable[[Floats], Floats]


class Peer(Protocol):
    """name: as it stands in the tables; unit: what its primitives are."""

    name: str
    unit: str

    def forget(self) -> None:
        """The next frame is of another flight."""

    def build(self, frame: Rendered, cloud: Cloud) -> Any:
        """The peer's own representation of one frame: the part that is timed."""

    def model(self, built: Any) -> Model:
        """The same as a Model."""


class Ours:
    """Our method in one of its modes; its noise estimate and ground go on from frame to frame, as in flight."""

    unit = "planes"

    def __init__(self, mode: str) -> None:
        self.name = f"OSAPE, {mode}"
        self._extractor = extractor_of(params_of(mode))
        self._state = ExtractorState()

    def forget(self) -> None:
        """Begins without a noise estimate and without a ground."""
        self._state = ExtractorState()

    def build(self, frame: Rendered, cloud: Cloud) -> FrameModel:
        """The model of a frame, from its depth image."""
        model, self._state = self._extractor.extract(
            frame.depth_mm, frame.info, frame.R_level_optical, state=self._state
        )
        return model

    def model(self, built: FrameModel) -> Model:
        """Its planes; bytes are those of its prisms, counted as the grid's are."""
        planes = built.planes.astype(np.float64)

        def off(points: Floats) -> Floats:
            return distances(points, planes)

        return Model(
            primitives=len(planes),
            facing=len(planes),
            bytes=prism_bytes(built),
            stops=lambda k, R: stops(planes, k, R)[0],
            surface=off,
            body=off,
        )


class Grid:
    """The grid baseline at one cell size. simplified: its outlines; sorted_pixels: from the cloud that all others are
    given too, else from every pixel above the ground with 3 points a cell, mismatches and all."""

    unit = "planes"

    def __init__(self, cell_m: float, *, simplified: bool = True, sorted_pixels: bool = True) -> None:
        self.name = (
            f"3DP grid {cell_m:g} m" + ("" if simplified else NOT_SIMPLIFIED) + ("" if sorted_pixels else UNSORTED)
        )
        self._sorted_pixels = sorted_pixels
        self._cell_m = cell_m
        self._epsilon_cells = EPSILON_CELLS if simplified else 0.0

    def forget(self) -> None:
        """Does nothing: it keeps no state between frames."""

    def build(self, frame: Rendered, cloud: Cloud) -> GridPrisms:
        """The prisms around a cloud."""
        if self._sorted_pixels:
            return grid_of(cloud, self._cell_m, epsilon_cells=self._epsilon_cells)
        every = cloud_of(frame, frame.info.ke_per_m, all_pixels=True)
        options = {"focal_px": 0.0, "epsilon_cells": self._epsilon_cells}
        return grid_prisms(every.points_m, every.ground_z_m, self._cell_m, **options)

    def model(self, built: GridPrisms) -> Model:
        """Sides as surface, prisms with tops and bottoms as bodies that stop rays."""
        return Model(
            primitives=len(built.planes),
            facing=int(facing_camera(built.planes).sum()),
            bytes=built.bytes,
            stops=lambda k, R: prism_stops(built, k, R),
            surface=lambda points: distances(points, built.planes),
            body=lambda points: body_distances(built, points),
        )

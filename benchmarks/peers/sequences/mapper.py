"""A method that merges frames, and its map as the judge uses it."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import stops
from benchmarks.peers.sequences.frame_input import GROUND_CUT_M, FrameInput
from benchmarks.peers.solids import box_stops
from core.types import Intrinsics

Floats = NDArray[np.float64]
Stops = Callable[[Floats, Intrinsics, Floats], Floats]
"""stops(position_m (3,), intrinsics, R_ned_optical (3, 3)): depth Z (H, W) at which each ray from a camera there first
meets the map, inf: never, 0 where the camera is inside of an obstacle."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapModel:
    """The map after a frame, in the reported ned. primitives: number of its parts; bytes: of its serialised form."""

    primitives: int
    bytes: int
    stops: Stops


class Mapper(Protocol):
    """name: in the tables; unit: of its primitives."""

    name: str
    unit: str

    def add(self, frame: FrameInput) -> None:
        """Merges one frame: the part that is timed."""

    def model(self, frame: FrameInput) -> MapModel:
        """The map after `frame`, which is the newest one."""


def library_makers(
    name: str, mapper: Callable[[ModuleType, float], Mapper], sizes_m: Sequence[float], remedy: str
) -> list[Callable[[], Mapper]] | str:
    """Returns makers of a library's mapper, one for each cell size, or why the library cannot be used.

    name: of the module. remedy: how to install it."""
    try:
        library = importlib.import_module(name)
    except (ImportError, OSError) as error:
        return f"not installed ({error}): {remedy}"
    return [functools.partial(mapper, library, size_m) for size_m in sizes_m]


def plane_model(planes: Floats, stored_bytes: int) -> MapModel:
    """Upright rectangles (N, 6) in the reported ned."""

    def meets(position_m: Floats, intrinsics: Intrinsics, R_ned_optical: Floats) -> Floats:
        x, y, z = position_m
        return stops(planes - np.array([x, y, x, y, z, z]), intrinsics, R_ned_optical)[0]

    return MapModel(primitives=len(planes), bytes=stored_bytes, stops=meets)


def cube_model(cubes: NDArray[np.int64], side_m: float, frame: FrameInput, stored_bytes: int) -> MapModel:
    """Cubes (N, 3 indices); cube i reaches from i * side_m to (i + 1) * side_m in the reported ned. Ground is taken
    out."""
    centres = np.asarray((cubes + 0.5) * side_m, np.float64)
    kept = cubes[frame.above_ground_m(centres) >= GROUND_CUT_M]
    low = kept * side_m
    boxes = np.hstack([low, low + side_m]).reshape(-1, 6)

    def meets(position_m: Floats, intrinsics: Intrinsics, R_ned_optical: Floats) -> Floats:
        return box_stops(boxes - np.tile(position_m, 2), intrinsics, R_ned_optical)

    return MapModel(primitives=len(kept), bytes=stored_bytes, stops=meets)

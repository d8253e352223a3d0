"""Obstacles that neighbours have reported, in the own local frame, for planners.

These types contain no free space, and no own obstacle can be removed by them: a report of a neighbour can only add
obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from ..types import readonly
from .placement import Placement


class PlacementState(Code):
    """How well the frame of a neighbour is known."""

    UNKNOWN = "unknown", "no position of the neighbour's frame was received, or the own one is not known"
    BY_POSITION = "by_position", "by the positions of both vehicles; margins contain their error"
    ALIGNED = "aligned", "by planes that both vehicles have observed"
    WITHHELD = "withheld", "too uncertain: the obstacles are withheld"


class MoverKind(IntEnum):
    """What a moving obstacle is."""

    OBSTACLE = 1
    VEHICLE = 2
    """The neighbour itself, at its reported position."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedMovingObstacle:
    """A moving obstacle in the own frame at the instant of the snapshot.

    Attributes:
        sender: number of the vehicle.
        id: number of the obstacle.
        kind: obstacle or vehicle.
        centre_m, half_size_m: its box.
        velocity_m_s: horizontal.
        margin_m: around the box, 2 sigma of all errors.
        age_s: since its newest observation."""

    sender: int
    id: int
    kind: MoverKind
    centre_m: tuple[float, float, float]
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]
    margin_m: float
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NeighbourStatus:
    """State of one neighbour.

    Attributes:
        vehicle: its number.
        silent_s: time since its newest packet.
        placement: how well its frame is known.
        fit: code of the newest alignment; empty: none was tried.
        sigma_m: horizontal uncertainty of its frame.
        planes: published planes.
        movers: published moving obstacles.
        withheld: planes that are not published.
        packets: accepted packets.
        refused: refused packets.
        vehicle_m: its position in the own frame; None: not known."""

    vehicle: int
    silent_s: float
    placement: PlacementState
    fit: str
    sigma_m: float
    planes: int
    movers: int
    withheld: int
    packets: int
    refused: int
    vehicle_m: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SharedObstacles:
    """N planes and the moving obstacles of all neighbours at now_ns, in the own local frame (ned).

    Attributes:
        now_ns: instant.
        sender: (N,) uint8 vehicle.
        ids: (N,) uint16, the sender's number.
        planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom.
        margin_m: (N,) float32, including 2 sigma of the place of the sender's frame.
        age_s: (N,) float32 since the sender observed it.
        flags: (N,) uint8 PlaneFlags.
        aligned: (N,) uint8, 1: the frame of the sender is aligned by planes of both vehicles.
        movers: moving obstacles.
        neighbours: state of all neighbours."""

    now_ns: int
    sender: NDArray[np.uint8]
    ids: NDArray[np.uint16]
    planes: NDArray[np.float32]
    margin_m: NDArray[np.float32]
    age_s: NDArray[np.float32]
    flags: NDArray[np.uint8]
    aligned: NDArray[np.uint8]
    movers: tuple[SharedMovingObstacle, ...] = ()
    neighbours: tuple[NeighbourStatus, ...] = ()

    def __post_init__(self) -> None:
        n, put = len(self.sender), object.__setattr__
        for name, dtype in (
            ("sender", np.uint8),
            ("ids", np.uint16),
            ("margin_m", np.float32),
            ("age_s", np.float32),
            ("flags", np.uint8),
            ("aligned", np.uint8),
        ):
            put(self, name, readonly(getattr(self, name), dtype, (n,), name))
        put(self, "planes", readonly(self.planes, np.float32, (n, 6), "planes"))

    @classmethod
    def empty(cls, now_ns: int) -> SharedObstacles:
        """No neighbour."""
        none, one = np.zeros(0, np.float32), np.zeros(0, np.uint8)
        return cls(
            now_ns=now_ns,
            sender=one,
            ids=np.zeros(0, np.uint16),
            planes=np.zeros((0, 6), np.float32),
            margin_m=none,
            age_s=none,
            flags=one,
            aligned=one,
        )


def placed_planes(
    box: NDArray[np.float64], margin_m: NDArray[np.float64], placement: Placement
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]:
    """Returns (planes (N, 6), margin_m (N,), horizontal sigma (N,)) in the own frame. Margins and heights contain 2
    sigma of the place."""
    sigma_m = np.maximum(placement.sigma_at_m(box[:, 0:2]), placement.sigma_at_m(box[:, 2:4]))
    out = placement.boxes(box)
    out[:, 4] -= 2.0 * placement.sigma_z_m
    out[:, 5] += 2.0 * placement.sigma_z_m
    return out.astype(np.float32), (margin_m + 2.0 * sigma_m).astype(np.float32), sigma_m

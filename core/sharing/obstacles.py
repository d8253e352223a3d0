"""Obstacles that neighbours have reported, in the own local frame, for planners.

These types contain no free space, and no own obstacle can be removed by them: a report of a neighbour can only add
obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..codes import Code
from ..types import store_readonly
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
    """A moving obstacle in the own frame at the instant of the snapshot."""

    sender: int  # number of the vehicle
    id: int  # number of the obstacle
    kind: MoverKind  # obstacle or vehicle
    centre_m: tuple[float, float, float]  # centre_m, half_size_m: its box
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]  # horizontal
    margin_m: float  # around the box, 2 sigma of all errors
    age_s: float  # since its newest observation


@dataclass(frozen=True, slots=True, kw_only=True)
class NeighbourStatus:
    """State of one neighbour."""

    vehicle: int  # its number
    silent_s: float  # time since its newest packet
    placement: PlacementState  # how well its frame is known
    fit: str  # code of the newest alignment; empty: none was tried
    sigma_m: float  # horizontal uncertainty of its frame
    planes: int  # published planes
    movers: int  # published moving obstacles
    withheld: int  # planes that are not published
    packets: int  # accepted packets
    refused: int  # refused packets
    vehicle_m: tuple[float, float, float] | None  # its position in the own frame; None: not known


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SharedObstacles:
    """N planes and the moving obstacles of all neighbours at now_ns, in the own local frame (ned)."""

    now_ns: int  # instant
    sender: NDArray[np.uint8]  # (N,) uint8 vehicle
    ids: NDArray[np.uint16]  # (N,), the sender's number
    planes: NDArray[np.float32]  # (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom
    margin_m: NDArray[np.float32]  # (N,), including 2 sigma of the place of the sender's frame
    age_s: NDArray[np.float32]  # (N,) float32 since the sender observed it
    flags: NDArray[np.uint8]  # (N,) uint8 PlaneFlags
    aligned: NDArray[np.uint8]  # (N,), 1: the frame of the sender is aligned by planes of both vehicles
    movers: tuple[SharedMovingObstacle, ...] = ()  # moving obstacles
    neighbours: tuple[NeighbourStatus, ...] = ()  # state of all neighbours

    def __post_init__(self) -> None:
        n = len(self.sender)
        store_readonly(self, np.uint8, (n,), "sender", "flags", "aligned")
        store_readonly(self, np.uint16, (n,), "ids")
        store_readonly(self, np.float32, (n,), "margin_m", "age_s")
        store_readonly(self, np.float32, (n, 6), "planes")

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

"""Obstacles that other vehicles have reported, in the own ned. They can only add obstacles to the answers of the own model.

    own = space.segments(from_m, to_m, radius_m)               # WorldSpace or Space of the own vehicle
    answers = neighbours.added_to_segments(own, from_m, to_m, radius_m)

A free or unknown way that comes near a reported obstacle becomes occupied. Nothing else changes: nothing becomes free, and
nothing that is occupied becomes anything else."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .integers import flags, integers
from .model import MOST_M
from .proto import osape_v1_pb2 as pb
from .query.rectangles import Rectangles, rectangles
from .query.space import Occupancies, Occupancy
from .query.ways import checked_radius, positions

GROWTH_M_S2: Final = 2.0
"""Acceleration by which margins of moving obstacles grow with their age, as in the service."""
SPEED_SIGMA_M_S: Final = 0.5
"""Standard deviation of their velocity, which the messages do not contain: that of a neighbour's own report."""


@dataclass(frozen=True)
class NeighbourMover:
    """A moving obstacle, or a neighbour itself (is_vehicle). margin_m: 2 sigma of everything; age_s: since the observation."""

    sender: int
    id: int
    is_vehicle: bool
    centre_m: tuple[float, float, float]
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]
    margin_m: float
    age_s: float


@dataclass(frozen=True)
class Neighbour:
    """One vehicle of the team. placement, fit: codes (docs/reference/sharing.md); position_m: None, not known."""

    vehicle: int
    silent_s: float
    placement: str
    fit: str
    sigma_m: float
    planes: int
    movers: int
    withheld: int
    position_m: tuple[float, float, float] | None


class NeighbourObstacles:
    """The obstacles of one message. sender: (N,) uint8; planes: (N, 6) float32 a_x, a_y, b_x, b_y, top, bottom; margin_m,
    age_s: (N,) float32; aligned: (N,) bool, the sender's frame is aligned by planes of both vehicles. section: of the own world
    in which they stand; t_ns: instant of the positions. Raises ValueError for a message whose parts do not fit together."""

    def __init__(self, message: pb.NeighbourObstacles) -> None:
        self.t_ns, self.section = message.t_ns, message.section
        self.sender = np.frombuffer(message.sender, np.uint8)
        self.ids = integers(message.id, np.uint16, "obstacles of neighbours: id")
        self.planes = np.array(message.corners_m, np.float32).reshape(-1, 6)
        self.margin_m = np.array(message.margin_m, np.float32)
        self.age_s = np.array(message.age_s, np.float32)
        self.flags = flags(message.flags)
        self.aligned = np.frombuffer(message.aligned, np.uint8) != 0
        self.movers = tuple(_mover(m) for m in message.movers)
        self.neighbours = tuple(_neighbour(n) for n in message.neighbours)
        lengths = {
            len(a) for a in (self.sender, self.ids, self.planes, self.margin_m, self.age_s, self.flags, self.aligned)
        }
        if len(lengths) != 1:
            raise ValueError(f"obstacles of neighbours: columns of {sorted(lengths)} rows; is the message damaged?")
        if not ((np.abs(self.planes) <= MOST_M).all() and (np.abs(self.margin_m) <= MOST_M).all()):
            raise ValueError(f"obstacles of neighbours: not finite or beyond {MOST_M:g} m; is the message damaged?")
        self._rectangles = _finite(self.planes.astype(np.float64), self.margin_m.astype(np.float64))
        for mover in self.movers:
            _check_mover(mover)
        self._moving = _mover_rectangles(self.movers)

    def later(self, seconds: float) -> NeighbourObstacles:
        """These obstacles after this time: the moving ones further by their velocity, with margins that have grown."""
        found = copy.copy(self)
        found.movers = tuple(_later(m, max(0.0, seconds)) for m in self.movers)
        found._moving = _mover_rectangles(found.movers)
        return found

    def added_to_segments(
        self, own: Occupancies, from_m: ArrayLike, to_m: ArrayLike, radius_m: float = 0.0
    ) -> Occupancies:
        """(M,) the answers `own` of the own model for these ways, with the obstacles of neighbours added."""
        radius_m, a, b = checked_radius(radius_m), positions(from_m), positions(to_m)
        out = np.array(own, np.uint8)
        if not len(a) == len(b) == len(out):
            raise ValueError(f"{len(out)} answers for {len(a)} starts and {len(b)} ends; expected as many of each")
        for some in (self._rectangles, self._moving):
            out[some.touch(a, b, radius_m)] = Occupancy.OCCUPIED
        return out

    def added_to_points(self, own: Occupancies, points_m: ArrayLike, radius_m: float = 0.0) -> Occupancies:
        """(M,) the same for balls around points (M, 3)."""
        return self.added_to_segments(own, points_m, points_m, radius_m)


def _finite(planes: NDArray[np.float64], margin_m: NDArray[np.float64]) -> Rectangles:
    """The rectangles. Raises ValueError where one is not finite, has its top below its bottom (z points down) or a negative
    margin: it would touch nothing."""
    if not (np.isfinite(planes).all() and np.isfinite(margin_m).all()):
        raise ValueError("obstacles of neighbours: numbers that are not finite; is the message damaged?")
    if (planes[:, 4] > planes[:, 5]).any() or (margin_m < 0.0).any():
        raise ValueError(
            "obstacles of neighbours: a top below its bottom or a negative margin; is the message damaged?"
        )
    return rectangles(planes, margin_m)


def _check_mover(mover: NeighbourMover) -> None:
    """Raises ValueError where its size, margin or age is negative, or a number is not finite or beyond MOST_M."""
    numbers = (*mover.centre_m, *mover.half_size_m, *mover.velocity_m_s, mover.margin_m, mover.age_s)
    if not all(abs(v) <= MOST_M for v in numbers):
        raise ValueError(f"moving obstacles of neighbours: not finite or beyond {MOST_M:g}; is the message damaged?")
    if min(*mover.half_size_m, mover.margin_m, mover.age_s) < 0.0:
        raise ValueError("moving obstacles of neighbours: a negative size, margin or age; is the message damaged?")


def _mover_rectangles(movers: tuple[NeighbourMover, ...]) -> Rectangles:
    """Each mover as a plane along x whose margin contains its box."""
    boxes, margins = [], []
    for m in movers:
        (x, y, z), (hx, hy, hz) = m.centre_m, m.half_size_m
        boxes.append((x - hx, y, x + hx, y, z - hz, z + hz))
        margins.append(hy + m.margin_m)
    return _finite(np.array(boxes, np.float64).reshape(-1, 6), np.array(margins, np.float64))


def _later(m: NeighbourMover, seconds: float) -> NeighbourMover:
    (x, y, z), (vx, vy), age_s = m.centre_m, m.velocity_m_s, m.age_s + seconds
    grown_m = 2.0 * SPEED_SIGMA_M_S * seconds + 0.5 * GROWTH_M_S2 * (age_s**2 - m.age_s**2)
    centre_m = x + vx * seconds, y + vy * seconds, z
    return replace(m, centre_m=centre_m, margin_m=m.margin_m + grown_m, age_s=age_s)


def _mover(m: pb.NeighbourMover) -> NeighbourMover:
    return NeighbourMover(
        sender=m.sender,
        id=m.id,
        is_vehicle=m.kind == pb.NeighbourMover.KIND_VEHICLE,
        centre_m=_xyz(m.centre_m),
        half_size_m=_xyz(m.half_size_m),
        velocity_m_s=(m.velocity_x_m_s, m.velocity_y_m_s),
        margin_m=m.margin_m,
        age_s=m.age_s,
    )


def _neighbour(n: pb.NeighbourHealth) -> Neighbour:
    return Neighbour(
        vehicle=n.vehicle,
        silent_s=n.silent_s,
        placement=n.placement,
        fit=n.fit,
        sigma_m=n.sigma_m,
        planes=n.planes,
        movers=n.movers,
        withheld=n.withheld,
        position_m=_xyz(n.position_m) if n.HasField("position_m") else None,
    )


def _xyz(v: pb.Vector3) -> tuple[float, float, float]:
    return v.x, v.y, v.z


def no_obstacles() -> NeighbourObstacles:
    """No neighbour."""
    return NeighbourObstacles(pb.NeighbourObstacles())

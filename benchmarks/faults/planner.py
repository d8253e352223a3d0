"""What a planner takes for free by the message of a frame, and the truth at its exposure.

Points behind true surfaces are asked for with the query of the client library."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.pipeline.encode import prisms_message, wire_bytes
from companion.pipeline.results import PrismsResult
from core.types import CameraMount
from drivers.simulation.flight_path import VehicleState
from osape_client import Occupancy, PlacedModel, Space
from osape_client.decode import model_from_message
from osape_client.model import CameraModel
from osape_client.proto import osape_v1_pb2 as pb

STEP_DEG = 1.0
BESIDE_DEG = 2
"""A point is judged if all directions up to this angle beside it are blocked nearer: the edge of a solid may be displaced."""
TIMEOUT_NS = 300_000_000
"""Age of an exposure from which on a client takes nothing for free."""

Floats = NDArray[np.float64]


def camera_place_m(state: VehicleState, mount: CameraMount) -> Floats:
    """Returns the true position of a camera, (3,), ned."""
    return np.array(state.position_ned_m) + state.R_ned_frd @ np.array([mount.x_m, mount.y_m, mount.z_m])


def hidden_points(outline_m: Floats, place_m: Floats, behind_m: float) -> tuple[Floats, Floats]:
    """Returns points (N, 3) in ned at the height of the camera, so far behind the surface that hides them from it, and the
    distances (N,) of these surfaces."""
    count = round(360.0 / STEP_DEG)
    north, east = (outline_m - place_m[:2]).T
    sector = np.round(np.degrees(np.arctan2(east, north)) / STEP_DEG).astype(int) % count
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, sector, np.hypot(north, east))
    nearest = np.min(
        [np.roll(nearest, k) for k in (-1, 0, 1)], axis=0
    )  # near outlines have no point in some directions
    blocked = np.max([np.roll(nearest, k) for k in range(-BESIDE_DEG - 1, BESIDE_DEG + 2)], axis=0)
    known = np.isfinite(blocked)
    bearing = np.radians(STEP_DEG * np.arange(count))[known]
    range_m = blocked[known] + behind_m
    places = place_m[:2] + np.column_stack([range_m * np.cos(bearing), range_m * np.sin(bearing)])
    return np.column_stack([places, np.full(len(places), place_m[2])]), blocked[known]


@dataclass(frozen=True, slots=True, eq=False)
class PlannerView:
    """The message of a frame as a planner decodes it from its bytes. model: None: it has none."""

    model: CameraModel | None
    at_m: tuple[float, float, float]

    def free(self, points_m: Floats) -> NDArray[np.bool_]:
        """Returns which points (N, 3) of the frame of the message a planner takes for free."""
        if self.model is None:
            return np.zeros(len(points_m), bool)
        return np.asarray(Space([PlacedModel(self.model, self.at_m)]).points(points_m) == Occupancy.FREE)


def planner_view(result: PrismsResult) -> PlannerView:
    """Returns what a planner receives of a result."""
    message = pb.PrismsFrame.FromString(wire_bytes(prisms_message(result)))
    at = message.transform.translation_m
    return PlannerView(model_from_message(message) if message.valid else None, (at.x, at.y, at.z))


def in_level(points_m: Floats, state: VehicleState) -> Floats:
    """Returns points of ned in level."""
    c, s = math.cos(state.euler_rad[2]), math.sin(state.euler_rad[2])
    x, y, z = (points_m - np.array(state.position_ned_m)).T
    return np.column_stack([c * x + s * y, -s * x + c * y, z])


def in_estimate(points_m: Floats, heading_rad: float, shift_m: tuple[float, float, float]) -> Floats:
    """Returns points of ned in the ned of an estimate that is turned and shifted."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y, z = points_m.T
    return np.column_stack([c * x - s * y, s * x + c * y, z]) + np.array(shift_m)

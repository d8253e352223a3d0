"""Frames of simulated flights with their models, tracked in several ways at once."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.extractor import Extractor
from core.frames import rotation_level_cam_optical
from core.params import Params
from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tracker import Tracker
from core.transformed import turned
from core.types import CameraInfo, ExtractorState, FrameModel
from drivers.simulation.flight import Rates, SimulatedFlight
from drivers.simulation.flight_path import FlightPath
from drivers.simulation.flights import FlightPlan
from drivers.simulation.movers import moved
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import TYPICAL, SensorModel, measure
from drivers.simulation.source import Rendered, Truth, camera_info

Floats = NDArray[np.float64]
HZ = 12.0
NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Exposure:
    """One frame of a flight. model: in level_cam; heading_rad and position_m: of the camera in ned; R_ned_optical: (3, 3);
    truth: exact view; rendered: for the metrics of fidelity."""

    k: int
    t_ns: int
    info: CameraInfo
    model: FrameModel
    heading_rad: float
    position_m: Floats
    R_ned_optical: Floats
    truth: Truth
    rendered: Rendered


Pose = Callable[[Exposure], tuple[float, tuple[float, float, float]]]
"""The heading and position that the tracker is given for an exposure."""


def true_pose(e: Exposure) -> tuple[float, tuple[float, float, float]]:
    """Without an error."""
    x, y, z = e.position_m.tolist()
    return e.heading_rad, (x, y, z)


def drifting(share: float) -> Pose:
    """A position that drifts by a share of the way."""

    def pose(e: Exposure) -> tuple[float, tuple[float, float, float]]:
        heading, (x, y, z) = true_pose(e)
        return heading, (x * (1.0 + share), y + share * x, z)

    return pose


def swinging(yaw_deg: float, period_s: float = 1.5) -> Pose:
    """A heading that swings."""

    def pose(e: Exposure) -> tuple[float, tuple[float, float, float]]:
        heading, at = true_pose(e)
        return heading + math.radians(yaw_deg) * math.sin(math.tau * e.t_ns / NS / period_s), at

    return pose


def vibrating(sigma_m: float) -> Pose:
    """A position with independent errors."""

    def pose(e: Exposure) -> tuple[float, tuple[float, float, float]]:
        heading, at = true_pose(e)
        x, y, z = (np.array(at) + np.random.default_rng([5, e.k]).normal(0.0, sigma_m, 3)).tolist()
        return heading, (x, y, z)

    return pose


def tracking_frame(e: Exposure, pose: Pose | None) -> TrackingFrame:
    """The frame for a tracker. pose None: without a position, axes from the camera."""
    if pose is None:
        model = turned(e.model, e.heading_rad, (0.0, 0.0, 0.0))
        return TrackingFrame(model=model, camera_m=(0.0, 0.0, 0.0), t_ns=e.t_ns, positioned=False)
    heading, at = pose(e)
    return TrackingFrame(model=turned(e.model, heading, at), camera_m=at, t_ns=e.t_ns, positioned=True, origin_m=at)


def hovering(scene: Scene, height_m: float = 2.0) -> FlightPlan:
    """A still camera at the scene's origin that looks north."""
    return FlightPlan(
        name="still", scene=scene, path=FlightPath([[0, 0, 0, -height_m, 0, 0, 0], [1, 0, 0, -height_m, 0, 0, 0]])
    )


def along(scene: Scene, speed_m_s: float, duration_s: float, start_m: float = -3.0) -> FlightPlan:
    """A flight north with a swaying attitude."""
    end = start_m + speed_m_s * duration_s
    rows = [[0, start_m, 0, -2, 0, 0, 0], [0.5 * duration_s, 0.5 * (start_m + end), 0.3, -2.2, 0, -0.05, 0.05]]
    path = FlightPath([*rows, [duration_s, end, 0, -2, 0, 0, 0]], sway_rad=(0.03, 0.04, 0.02))
    return FlightPlan(name="along", scene=scene, path=path)


def exposures(
    plan: FlightPlan, frames: int, ke_per_m: float, seed: int = 1, width: int = 640, sensor: SensorModel = TYPICAL
) -> Iterator[Exposure]:
    """The frames of a flight at HZ, with all image faults unless another sensor is given; its noise is ke_per_m."""
    info = camera_info(width, width * 3 // 4, ke_per_m=ke_per_m)
    flight = SimulatedFlight(plan, cameras=(info,), seed=seed, rates=Rates(depth_hz=HZ), duration_s=frames / HZ)
    sensor = dataclasses.replace(sensor, ke_per_m=ke_per_m).scaled_to(width)
    extractor, state = Extractor(Params()), ExtractorState()
    still: Truth | None = None
    for k in range(frames):
        t_ns = flight.start_ns + round(k / HZ * NS)
        R, at = flight.camera_pose(info, t_ns)
        if plan.name != "still" or len(plan.scene.velocity_m_s) or still is None:
            still = flight.truth(info, t_ns)
        R_level = rotation_level_cam_optical(R)
        depth = measure(still.depth_m, info, sensor, seed, k)
        model, state = extractor.extract(depth, info, R_level, state)
        scene = moved(plan.scene, (t_ns - flight.start_ns) / NS)
        yield Exposure(
            k=k,
            t_ns=t_ns,
            info=info,
            model=model,
            heading_rad=heading_of(R),
            position_m=at,
            R_ned_optical=R,
            truth=still,
            rendered=Rendered(scene, info, depth, R, R_level, at, still),
        )


def heading_of(R_ned_optical: Floats) -> float:
    """Horizontal direction of the optical axis."""
    R_level = rotation_level_cam_optical(R_ned_optical)
    R = R_ned_optical @ R_level.T  # level_cam to ned: a rotation about the vertical
    return math.atan2(R[1, 0], R[0, 0])


def to_ned(planes: NDArray[np.float32], e: Exposure, pose: Pose | None) -> Floats:
    """Planes of a tracker's frame in true ned: with the error of the pose taken out, so that the true scene can judge
    them."""
    out = planes.astype(np.float64).copy()
    if pose is None:
        return out + np.array([*e.position_m[:2], *e.position_m[:2], e.position_m[2], e.position_m[2]])
    heading, at = pose(e)
    turn = e.heading_rad - heading
    c, s = math.cos(turn), math.sin(turn)
    for i in (0, 2):
        x, y = planes[:, i] - at[0], planes[:, i + 1] - at[1]
        out[:, i] = e.position_m[0] + c * x - s * y
        out[:, i + 1] = e.position_m[1] + s * x + c * y
    out[:, 4:6] += e.position_m[2] - at[2]
    return out


def to_level_cam(planes_ned: Floats, e: Exposure) -> Floats:
    """Planes in ned as the metrics of fidelity have them."""
    out, (c, s) = planes_ned.copy(), (math.cos(-e.heading_rad), math.sin(-e.heading_rad))
    for i in (0, 2):
        x, y = planes_ned[:, i] - e.position_m[0], planes_ned[:, i + 1] - e.position_m[1]
        out[:, i], out[:, i + 1] = c * x - s * y, s * x + c * y
    out[:, 4:6] -= e.position_m[2]
    return out


__all__ = ["Exposure", "Pose", "TrackSnapshot", "Tracker", "exposures", "to_level_cam", "to_ned", "tracking_frame"]

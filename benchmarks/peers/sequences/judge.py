"""Judges a map from the newest frame's view, and from views turned aside, by the metrics of single frames."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import NAN, Rays, missed_rays, open_stopped_rays, phantom_rays, rays_of
from benchmarks.peers.run import directions_of
from benchmarks.peers.sequences.frame_input import FrameInput
from benchmarks.peers.sequences.mapper import MapModel
from benchmarks.tracking.sequences import Exposure
from benchmarks.world.truth import seen_by, to_ned
from core.frames import rotation_level_cam_optical
from drivers.simulation.source import Rendered, look

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLIND_LEFT_PX: Final = 16
"""Columns that the simulated camera never measures."""
ASIDE_DEG: Final = (-50.0, 50.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class View:
    """A view and its true rays. rendered: in the true ned; yaw_rad: turned from the newest frame's view; counted: (H, W)
    obstacle rays that count for missed."""

    rendered: Rendered
    rays: Rays
    yaw_rad: float
    counted: Mask


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """A method at one frame of a flight.

    missed, aside_missed: obstacle rays let pass more than max(0.5 m, 2 sigma) beyond the truth, of obstacle_rays, of
    aside_rays. phantom: obstacle and open rays stopped where nothing is; open_stopped: open rays stopped at all.
    error_m, error_p95_m: distance along the ray between stop and truth over the stopped obstacle rays, median and 95th
    percentile; bias_m: median of stop minus truth. cpu_ms: median time of a frame since the previous judged frame."""

    method: str
    unit: str
    scene: str
    ke_per_m: float
    pose: str
    frames: int
    primitives: int
    bytes: int
    missed: int
    phantom: int
    open_stopped: int
    obstacle_rays: int
    open_rays: int
    aside_missed: int
    aside_rays: int
    error_m: float
    error_p95_m: float
    bias_m: float
    cpu_ms: float


def newest_view(e: Exposure, ke_per_m: float) -> View:
    """The view of the newest frame."""
    rays = rays_of(e.rendered, ke_per_m, blind_left_px=BLIND_LEFT_PX)
    return View(rendered=e.rendered, rays=rays, yaw_rad=0.0, counted=rays.obstacle)


def views_aside(e: Exposure, ke_per_m: float, flown: Sequence[Rendered]) -> list[View]:
    """Views from the place of the newest frame, turned by ASIDE_DEG. Rays count that end at something that at least two
    frames had in view, within their range."""
    return [_turned_view(e, ke_per_m, flown, math.radians(angle)) for angle in ASIDE_DEG]


def _turned_view(e: Exposure, ke_per_m: float, flown: Sequence[Rendered], yaw_rad: float) -> View:
    R = _rotation(yaw_rad) @ e.R_ned_optical
    truth = look(e.rendered.scene, e.info, R, e.position_m)
    level = rotation_level_cam_optical(R)
    view = dataclasses.replace(e.rendered, R_ned_optical=R, R_level_optical=level, truth=truth)
    rays = rays_of(view, ke_per_m)
    counted = rays.obstacle.copy()
    counted[rays.obstacle] = seen_by(to_ned(view, truth.points_level_cam_m[rays.obstacle]), flown)
    return View(rendered=view, rays=rays, yaw_rad=yaw_rad, counted=counted)


def _rotation(yaw_rad: float) -> Floats:
    """(3, 3) about the vertical of ned."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def stop_range_m(model: MapModel, frame: FrameInput, view: View) -> Floats:
    """(H, W) range at which each ray of a view meets the map, inf: never. The map is placed by the reported pose of the
    newest frame."""
    R = _rotation(view.yaw_rad) @ frame.R_ned_optical
    return model.stops(frame.position_m, frame.exposure.info.intrinsics, R) * view.rays.per_depth


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """What is judged. ke_per_m: the true noise; cpu_ms: as in Figures."""

    method: str
    unit: str
    scene: str
    ke_per_m: float
    pose: str
    cpu_ms: float


def figures(subject: Subject, model: MapModel, frame: FrameInput, newest: View, aside: Sequence[View]) -> Figures:
    """All figures of a map."""
    rays, truth = newest.rays, newest.rendered.truth.points_level_cam_m
    stop_m = stop_range_m(model, frame, newest)
    met = rays.obstacle & np.isfinite(stop_m)
    off = stop_m[met] - rays.range_m[met]
    return Figures(
        **dataclasses.asdict(subject),
        frames=frame.exposure.k + 1,
        primitives=model.primitives,
        bytes=model.bytes,
        missed=int(missed_rays(rays, stop_m).sum()),
        phantom=int(phantom_rays(rays, stop_m, truth, directions_of(newest.rendered, rays)).sum()),
        open_stopped=int(open_stopped_rays(rays, stop_m).sum()),
        obstacle_rays=int(rays.obstacle.sum()),
        open_rays=int(rays.open.sum()),
        aside_missed=sum(int((missed_rays(v.rays, stop_range_m(model, frame, v)) & v.counted).sum()) for v in aside),
        aside_rays=sum(int(v.counted.sum()) for v in aside),
        error_m=float(np.median(np.abs(off))) if len(off) else NAN,
        error_p95_m=float(np.percentile(np.abs(off), 95)) if len(off) else NAN,
        bias_m=float(np.median(off)) if len(off) else NAN,
    )

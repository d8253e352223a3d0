"""Thin wires over time: which share of their rays the tracks stop, and with how many planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.fidelity.metrics import MISSED_M, rays_of, recall, stops
from core.tracking.tracker import Tracker
from drivers.simulation.scenes import Scene, SceneBuilder

from .sequences import Exposure, Floats, exposures, hovering, to_level_cam, to_ned, tracking_frame, true_pose

WIRE = "wire"
RANGES_M = (8.0, 10.0, 12.0)
FRAMES = (1, 10, 30)
"""Frames after which the model is judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """After so many frames: share of the wire's rays that the model of the frame and the tracks stop at the wire, and the
    number of planes that stop any of them there."""

    frames: int
    frame_kept: float
    frame_planes: int
    tracks_kept: float
    tracks_planes: int


def scene(x_m: float) -> Scene:
    """A wire of 2 cm across the view, 2.5 m above the ground, before a wall."""
    s = SceneBuilder("wire")
    s.ground()
    s.wall("wall", (18.0, -16.0), (18.0, 16.0), 5.0)
    s.cylinder(WIRE, (x_m, -9.0, -2.5), (x_m + 0.3, 9.0, -2.5), 0.01)
    return s.build()


def run(x_m: float, ke_per_m: float) -> list[Row]:
    """The wire at x_m, seen by a still camera."""
    tracker, rows = Tracker(), []
    for e in exposures(hovering(scene(x_m)), max(FRAMES), ke_per_m):
        snapshot = tracker.observe(tracking_frame(e, true_pose))
        if e.k + 1 in FRAMES:
            frame = kept(e, e.model.planes.astype(np.float64), ke_per_m)
            tracks = kept(e, to_level_cam(to_ned(snapshot.planes, e, true_pose), e), ke_per_m)
            rows.append(
                Row(
                    frames=e.k + 1,
                    frame_kept=frame[0],
                    frame_planes=frame[1],
                    tracks_kept=tracks[0],
                    tracks_planes=tracks[1],
                )
            )
    return rows


def kept(e: Exposure, planes: Floats, ke_per_m: float) -> tuple[float, int]:
    """(Share of the wire's rays stopped within max(0.5 m, 2 sigma) of it, planes that stop any of them there)."""
    rays = rays_of(e.rendered, ke_per_m, blind_left_px=16)
    share = next((r.kept for r in recall(e.rendered, rays, planes) if r.name == WIRE), float("nan"))
    mine = rays.obstacle & (e.truth.label(e.rendered.scene) == e.rendered.scene.names.index(WIRE))
    depth, which = stops(planes, e.info.intrinsics, e.rendered.R_level_optical)
    near = mine & (np.abs(depth * rays.per_depth - rays.range_m) <= np.fmax(MISSED_M, 2.0 * rays.sigma_m))
    return share, len(np.unique(which[near]))

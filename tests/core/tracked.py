"""Frames of planes for a tracker, and its tracks."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from core.tracking.params import TrackingParams
from core.tracking.snapshot import TrackingFrame, TrackSnapshot

from .worlds import NS, seen, wall

STEP = NS // 10
WALL = wall(8.0, -4.0, 8.0, 4.0)
"""Faces a camera at the origin: free space on the right of a -> b is x < 8."""
POST = wall(4.0, -0.5, 4.0, 0.5)
SMALL = TrackingParams(most_tracks=256)


def frame(
    walls: list[list[float]],
    k: int,
    *,
    at: tuple[float, float] = (0.0, 0.0),
    heading: float = 0.0,
    rng: np.random.Generator | None = None,
    sigma_m: float = 0.03,
    reset_counter: int = 0,
    view_deg: float = 80.0,
) -> TrackingFrame:
    """Frame k, ten a second, of walls seen from a place in ned."""
    rows = np.array(walls, float).reshape(-1, 6)
    o = seen(rows, at, heading, k * STEP, noise=rng, sigma_m=sigma_m, view_deg=view_deg)
    return TrackingFrame(
        model=o.model, camera_m=o.place_m, t_ns=o.t_ns, positioned=True, origin_m=o.place_m, reset_counter=reset_counter
    )


def with_margin(f: TrackingFrame, margin_m: float) -> TrackingFrame:
    """The same frame with this margin of all planes."""
    margins = np.full(len(f.model.planes), margin_m, np.float32)
    return dataclasses.replace(f, model=dataclasses.replace(f.model, margin_m=margins))


def with_planes(f: TrackingFrame, planes: list[list[float]], flags: list[int]) -> TrackingFrame:
    """The frame with these planes instead of its own; its free ranges remain."""
    n = len(planes)
    model = dataclasses.replace(
        f.model,
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.array(flags, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    return dataclasses.replace(f, model=model)


def without_position(f: TrackingFrame) -> TrackingFrame:
    """The same frame as a vehicle without a position has it: its own place is the origin."""
    x, y, z = f.camera_m
    planes = f.model.planes - np.array([x, y, x, y, z, z], np.float32)
    model = dataclasses.replace(f.model, planes=planes)
    return dataclasses.replace(f, model=model, camera_m=(0.0, 0.0, 0.0), origin_m=(0.0, 0.0, 0.0), positioned=False)


def distance(s: TrackSnapshot, x: float, y: float) -> float:
    """Least distance of a place from any track, seen from above."""
    best = math.inf
    for ax, ay, bx, by, *_ in s.planes.tolist():
        e = np.array([bx - ax, by - ay])
        q = np.clip(((x - ax) * e[0] + (y - ay) * e[1]) / max(float(e @ e), 1e-9), 0.0, 1.0)
        best = min(best, math.hypot(ax + q * e[0] - x, ay + q * e[1] - y))
    return best

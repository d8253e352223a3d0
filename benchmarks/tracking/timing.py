"""Vanishing obstacles, and the cost of a frame."""

from __future__ import annotations

import math
import time

import numpy as np

from benchmarks.fidelity.metrics import distances
from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker
from core.transformed import turned
from core.types import FrameModel
from drivers.simulation.scenes import Scene, SceneBuilder

from .sequences import HZ, exposures, hovering, to_ned, tracking_frame, true_pose

BOX_M = (6.0, 0.0)


def scene(box: bool, screen: bool) -> Scene:
    """A wall, a box before it, and a screen before the box."""
    s = SceneBuilder("vanishing")
    s.ground()
    s.wall("wall", (14.0, -12.0), (14.0, 12.0), 5.0)
    if box:
        s.box("box", *BOX_M, 1.0, 1.0, 2.5)
    if screen:
        s.box("screen", 3.5, 0.0, 0.3, 3.0, 3.5)
    return s.build()


def vanishing(ke_per_m: float, hidden: bool) -> float:
    """Seconds until a box that is removed (hidden: that a screen hides) after 1.5 s is gone; inf: it is kept for the 3 s
    that follow."""
    tracker, before = Tracker(), round(1.5 * HZ)
    first = list(exposures(hovering(scene(True, False)), before, ke_per_m))
    later = list(exposures(hovering(scene(hidden, hidden)), before + round(3 * HZ), ke_per_m))[before:]
    x, y = BOX_M
    point = np.array([[x - 0.5, y, -1.2]])
    for e in first:
        tracker.observe(tracking_frame(e, true_pose))
    for n, e in enumerate(later):
        s = tracker.observe(tracking_frame(e, true_pose))
        planes = to_ned(s.planes, e, true_pose)
        if not len(planes) or distances(point, planes)[0] > 1.0:
            return n / HZ
    return math.inf


def cost_ms(planes: int, positioned: bool, model: FrameModel, frames: int = 60) -> tuple[float, float, float]:
    """(median, 99th percentile of the processor time of a frame, mean number of tracks). Planes stand at random in view of
    a camera; each frame moves each of them by noise and leaves out a tenth. model: of any frame, for its free ranges."""
    rng = np.random.default_rng(3)
    azimuth, range_m = rng.uniform(-0.6, 0.6, planes), rng.uniform(2.0, 19.0, planes)
    length, turn = rng.uniform(0.2, 2.5, planes), rng.uniform(-0.6, 0.6, planes)
    top = rng.uniform(-3.0, 0.0, planes)
    x, y = range_m * np.cos(azimuth), range_m * np.sin(azimuth)
    dx, dy = 0.5 * length * np.sin(turn), 0.5 * length * np.cos(turn)
    rows = np.column_stack([x - dx, y - dy, x + dx, y + dy, top, top + rng.uniform(0.4, 3.0, planes)])
    tracker, times, tracks = Tracker(), [], []
    import dataclasses

    level = turned(model, 0.0, (0.0, 0.0, 0.0))
    for k in range(frames):
        keep = rng.random(planes) > 0.1
        shift = rng.normal(0.0, 0.03, (planes, 2))
        noisy = (rows + np.column_stack([shift, shift, np.zeros((planes, 2))]))[keep].astype(np.float32)
        n = len(noisy)
        frame = dataclasses.replace(
            level,
            planes=noisy,
            margin_m=np.full(n, 0.1, np.float32),
            flags=np.zeros(n, np.uint8),
            cluster=np.zeros(n, np.int32),
            support_px=np.full(n, 50, np.int32),
        )
        given = TrackingFrame(model=frame, camera_m=(0.0, 0.0, 0.0), t_ns=round(k / HZ * 1e9), positioned=positioned)
        begun = time.thread_time_ns()
        s = tracker.observe(given)
        if k >= 10:
            times.append((time.thread_time_ns() - begun) / 1e6)
            tracks.append(len(s.ids))
    return float(np.median(times)), float(np.quantile(times, 0.99)), float(np.mean(tracks))

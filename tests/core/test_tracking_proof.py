"""Tracks lose only what is observed to be free: what is hidden, or out of view, is kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker

from .test_tracking import SMALL, distance, frame
from .worlds import wall

pytestmark = pytest.mark.nojit
BOX = wall(6.0, -0.25, 6.0, 0.25)
BACK = wall(12.0, -9.0, 12.0, 9.0)


def planes_of(planes: list[list[float]], walls: list[list[float]], k: int) -> TrackingFrame:
    """Frame k with these planes and the free ranges before `walls`."""
    f = frame(walls, k)
    n = len(planes)
    model = dataclasses.replace(
        f.model,
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.full(n, 2, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    return dataclasses.replace(f, model=model)


def settled(walls: list[list[float]], frames: int = 20) -> Tracker:
    tracker = Tracker(SMALL)
    for k in range(frames):
        tracker.observe(frame(walls, k))
    return tracker


def test_an_obstacle_behind_a_nearer_one_is_kept_where_the_wall_behind_is_one_plane() -> None:
    """The plane of the wall spans what a narrow screen hides."""
    tracker, screen = settled([BOX, BACK]), wall(3.0, -0.4, 3.0, 0.4)
    for k in range(20, 40):
        s = tracker.observe(planes_of([screen, BACK], [screen, BACK], k))
        assert distance(s, 6.0, 0.0) < 0.1, k

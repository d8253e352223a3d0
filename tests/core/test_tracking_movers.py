"""Moving obstacles: declared with support only, with a velocity near the truth; static scenes have none."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tracker import Tracker

from .test_tracking import SMALL, STEP, distance, frame
from .worlds import NS, wall

pytestmark = pytest.mark.nojit
BACK = wall(14.0, -14.0, 14.0, 14.0)


def face(x: float, y: float, width: float = 0.5, top: float = -1.0, bottom: float = 1.0) -> list[float]:
    """The face of a person or a car towards a camera that looks along x."""
    return wall(x, y - width / 2, x, y + width / 2, top, bottom)


def follow(place: Callable[[float], list[list[float]]], frames: int, **how: object) -> tuple[Tracker, TrackSnapshot]:
    """A tracker after frames of obstacles that `place` gives for each time, before a wall."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(4)
    for k in range(frames):
        s = tracker.observe(frame([*place(0.1 * k), BACK], k, rng=rng, **how))  # type: ignore[arg-type]
    return tracker, s


@pytest.mark.parametrize(
    ("x", "y", "vx", "vy"), [(5.0, -1.0, 0.0, 1.5), (9.0, 2.0, 0.0, -1.5), (8.5, 0.0, -1.5, 0.0), (3.5, 0.3, 1.5, 0.3)]
)
def test_a_person_is_moving_within_a_second(x: float, y: float, vx: float, vy: float) -> None:
    _, s = follow(lambda t: [face(x + vx * t, y + vy * t)], 11)
    assert len(s.objects) == 1
    o = s.objects[0]
    assert math.hypot(o.velocity_m_s[0] - vx, o.velocity_m_s[1] - vy) < 0.3
    assert math.hypot(o.centre_m[0] - (x + vx), o.centre_m[1] - (y + vy)) < 0.15
    assert o.velocity_sigma_m_s < 0.4
    assert (s.object_id == o.id).sum() >= 1
    wall_rows = s.planes[:, [0, 2]].min(axis=1) > 13.0
    assert (s.object_id[wall_rows] == 0).all()


def test_a_car_at_eight_metres_a_second() -> None:
    _, s = follow(lambda t: [face(10.0, -5.0 + 8.0 * t, width=1.8)], 11)
    assert len(s.objects) == 1
    assert math.hypot(s.objects[0].velocity_m_s[0], s.objects[0].velocity_m_s[1] - 8.0) < 0.8


def test_a_mover_leaves_no_trail_for_longer_than_half_a_second() -> None:
    _, s = follow(lambda t: [face(6.0, -2.5 + 1.5 * t)], 31)
    here = -2.5 + 1.5 * 3.0
    assert distance(s, 6.0, here) < 0.2
    assert distance(s, 6.0, here - 0.5 - 1.5 * 0.5 - 0.3) > 0.2
    assert len(s.ids) <= 4


def test_a_mover_that_stops_is_static_again() -> None:
    _, s = follow(lambda t: [face(6.0, -1.5 + 1.5 * min(t, 1.2))], 40)
    assert s.objects == ()


@pytest.mark.parametrize("seed", [1, 2])
def test_static_obstacles_do_not_move_whatever_the_errors_of_the_pose(seed: int) -> None:
    """Drift of 1 % of the way, a yaw error that swings by 1 degree, vibration of 0.03 m."""
    rng = np.random.default_rng(seed)
    posts = [face(4.0 + 2.0 * i, -3.0 + 1.7 * i, 0.4) for i in range(4)] + [BACK]
    tracker, movers = Tracker(SMALL), 0
    for k in range(60):
        t = 0.1 * k
        shake = rng.normal(0.0, 0.03, 2)
        yaw = math.radians(1.0) * math.sin(math.tau * 0.7 * t)
        at = (0.8 * t, 0.2 * math.sin(t))
        f = frame(posts, k, at=at, rng=rng)
        c, s = math.cos(yaw), math.sin(yaw)
        rotated = f.model.planes.copy()
        for i in (0, 2):
            x, y = f.model.planes[:, i] - at[0], f.model.planes[:, i + 1] - at[1]
            rotated[:, i] = at[0] + c * x - s * y + shake[0] + 0.008 * t
            rotated[:, i + 1] = at[1] + s * x + c * y + shake[1]
        snapshot = tracker.observe(with_planes(f, rotated))
        movers += len(snapshot.objects)
    assert movers == 0


def with_planes(f: TrackingFrame, planes: np.ndarray) -> TrackingFrame:
    import dataclasses

    return dataclasses.replace(f, model=dataclasses.replace(f.model, planes=planes.astype(np.float32)))


def test_flicker_is_no_motion() -> None:
    """Pieces of a bush that come and go at random."""
    rng = np.random.default_rng(9)
    tracker = Tracker(SMALL)
    for k in range(60):
        pieces = [face(*(np.array([6.0, 0.0]) + rng.normal(0.0, 0.4, 2)), 0.3) for _ in range(3)]
        assert tracker.observe(frame([*pieces, BACK], k)).objects == ()


def test_a_gap_in_time_ends_objects() -> None:
    tracker, s = follow(lambda t: [face(6.0, -1.5 + 1.5 * t)], 12)
    assert len(s.objects) == 1
    late = frame([face(6.0, 2.0), BACK], 12)
    s = tracker.observe(TrackingFrame(
        model=late.model, camera_m=late.camera_m, t_ns=12 * STEP + NS, positioned=True, origin_m=late.origin_m
    ))  # fmt: skip
    assert s.objects == ()

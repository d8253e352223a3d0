"""A detection that several tracks together hide adds no track; what they do not hide appears at once."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.tracking.association import GATE_MAX_M
from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker

from .tracked import SMALL, WALL, distance, frame, with_margin
from .worlds import wall

Floats = NDArray[np.float32]
LEFT, RIGHT = wall(6.0, -1.5, 6.0, 0.0), wall(6.1, 0.0, 6.1, 1.5)
FLAT = wall(6.2, -1.4, 6.2, 1.4)
"""Lies 0.2 m and 0.1 m behind the two."""


def settled(walls: list[list[float]], frames: int = 10) -> Tracker:
    tracker = Tracker(SMALL)
    for k in range(frames):
        tracker.observe(frame(walls, k))
    return tracker


def only(planes: list[list[float]], k: int, flags: int = 0) -> TrackingFrame:
    """Frame k with these planes, whatever they hide of each other."""
    f = frame([WALL], k)
    n = len(planes)
    model = dataclasses.replace(
        f.model,
        planes=np.array(planes, np.float32),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.full(n, flags, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    return dataclasses.replace(f, model=model)


@pytest.mark.nojit
def test_a_detection_behind_two_tracks_adds_none() -> None:
    tracker, tilted = settled([LEFT, wall(6.25, 0.0, 6.25, 1.5)]), wall(5.98, -1.2, 6.35, 1.0)
    s = tracker.observe(only([tilted], 10))
    assert sorted(s.ids.tolist()) == [1, 2]
    assert s.unseen_ns.tolist() == [0, 0]


def test_tracks_are_not_extended_into_a_gap_between_them() -> None:
    tracker = settled([wall(6.0, -1.5, 6.0, -0.1), wall(6.1, 0.1, 6.1, 1.5)])
    s = tracker.observe(only([wall(6.05, -1.2, 6.45, 1.2)], 10))
    assert len(s.ids) == 3
    widths_m = abs(s.planes[s.ids != 3][:, 3] - s.planes[s.ids != 3][:, 1])
    assert widths_m.max() <= 1.41


def test_the_margin_of_the_tracks_reaches_the_nearest_face_of_what_they_hide() -> None:
    tracker = settled([LEFT, RIGHT])
    s = tracker.observe(with_margin(only([FLAT], 10), 0.5))
    assert (s.planes[:, [0, 2]].max(axis=1) - s.margin_m <= 6.2 - 0.5 + 0.01).all()


def test_a_detection_in_front_of_the_tracks_is_a_track_at_once() -> None:
    tracker = settled([LEFT, RIGHT])
    s = tracker.observe(only([wall(5.2, -1.2, 5.2, 1.2)], 10))
    assert distance(s, 5.2, 0.0) < 1e-3


@pytest.mark.parametrize("gap_m", [0.1, 0.5])
def test_a_gap_between_the_tracks_is_covered_where_a_detection_lies_in_it(gap_m: float) -> None:
    left, right = wall(6.0, -1.5, 6.0, -gap_m / 2), wall(6.1, gap_m / 2, 6.1, 1.5)
    tracker = settled([left, right])
    s = tracker.observe(only([wall(6.05, -1.2, 6.45, 1.2)], 10))
    for y in np.linspace(-1.2, 1.2, 25):
        assert distance(s, 6.05 + (y + 1.2) / 6.0, float(y)) <= GATE_MAX_M + 0.01
        angle = math.atan2(y, 6.25)
        assert any(
            min(math.atan2(b, a), math.atan2(d, c)) <= angle + 1e-3
            and max(math.atan2(b, a), math.atan2(d, c)) >= angle - 1e-3
            for a, b, c, d, *_ in s.planes.tolist()
        )


@pytest.mark.nojit
def test_two_posts_are_not_joined_by_growth() -> None:
    tracker = Tracker(SMALL)
    for k in range(5):
        s = tracker.observe(only([wall(6.0, -0.3, 6.0, -0.1), wall(6.0, 0.1, 6.0, 0.3)], k))
    assert len(s.ids) == 2
    assert distance(s, 6.0, 0.0) >= 0.1 - 1e-3


def test_a_filled_gap_seen_open_goes_after_one_frame_that_sees_through_it() -> None:
    tracker = settled([WALL])
    s = tracker.observe(only([wall(4.0, -0.5, 4.0, 0.5), WALL], 10, flags=1))
    assert distance(s, 4.0, 0.0) < 0.1
    assert distance(tracker.observe(frame([WALL], 11)), 4.0, 0.0) > 3.0


@pytest.mark.nojit
def test_a_filled_gap_of_several_frames_loses_what_two_frames_see_through_and_keeps_what_is_hidden() -> None:
    tracker, gap, screen = settled([WALL]), wall(4.0, -0.5, 4.0, 0.5), wall(3.0, 0.0, 3.0, 0.6)
    for k in range(10, 15):
        tracker.observe(only([gap, WALL], k, flags=1))
    for k in (15, 16):
        s = tracker.observe(frame([screen, WALL], k))
    assert distance(s, 4.0, -0.4) > 0.2
    assert distance(s, 4.0, 0.4) < 0.1


@pytest.mark.nojit
def test_a_filled_gap_that_one_frame_alone_has_goes_whole_where_a_part_of_it_is_seen_through() -> None:
    """No obstacle was measured in it. Where all of it is hidden or out of view nothing says that there is none."""
    tracker, gap = settled([WALL]), wall(4.0, -0.5, 4.0, 0.5)
    tracker.observe(only([gap, WALL], 10, flags=1))
    away, hidden = Tracker(SMALL, tracker.state()), Tracker(SMALL, tracker.state())
    assert distance(away.observe(frame([WALL], 11, heading=math.pi)), 4.0, -0.3) < 0.1
    assert distance(hidden.observe(frame([wall(2.5, -0.5, 2.5, 0.5), WALL], 11)), 4.0, -0.3) < 0.1
    assert distance(tracker.observe(frame([wall(2.5, -0.5, 2.5, 0.05), WALL], 11)), 4.0, -0.3) > 1.0


def test_a_measured_obstacle_that_one_frame_has_is_kept_where_it_is_hidden() -> None:
    tracker, screen = settled([WALL]), wall(2.5, -0.4, 2.5, 0.4)
    tracker.observe(only([wall(4.0, -0.5, 4.0, 0.5), WALL], 10))
    assert distance(tracker.observe(frame([screen, WALL], 11)), 4.0, 0.0) < 0.1


def test_a_measured_obstacle_needs_more_than_one_frame_that_sees_through_it() -> None:
    tracker = settled([WALL])
    tracker.observe(only([wall(4.0, -0.5, 4.0, 0.5), WALL], 10, flags=3))
    assert distance(tracker.observe(frame([WALL], 11)), 4.0, 0.0) < 0.1


def test_one_tall_detection_does_not_make_a_steady_track_taller() -> None:
    low, tall = wall(6.0, -1.0, 6.0, 1.0, -3.0, -1.0), wall(6.0, -1.0, 6.0, 1.0, -3.0, 1.5)
    tracker = Tracker(SMALL)
    for k in range(10):
        tracker.observe(only([low], k))
    s = tracker.observe(only([tall], 10))
    assert s.planes[s.ids == 1, 5] <= -0.9
    assert s.planes[:, 5].max() >= 1.5 - 1e-3, "what the detection hides is hidden at once"


def test_a_plane_moved_towards_the_camera_hides_the_same_directions() -> None:
    tracker = settled([wall(6.0, 1.0, 6.0, 5.0)], 20)
    near = wall(5.7, 0.95, 5.7, 4.75)
    s = tracker.observe(with_margin(only([near], 20), 0.05))
    ax, ay, bx, by = s.planes[0, :4].tolist()
    assert min(ax, bx) < 5.95
    assert min(math.atan2(ay, ax), math.atan2(by, bx)) <= math.atan2(0.95, 5.7) + 2e-3
    assert max(math.atan2(ay, ax), math.atan2(by, bx)) >= math.atan2(4.75, 5.7) - 2e-3


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("frames", [1, 8])
def test_a_wall_seen_edge_on_stays_where_a_frame_with_a_heading_error_of_one_degree_shows_it(
    side: float, frames: int
) -> None:
    margin_m, turn = 0.3, math.radians(1.0) * side
    ends = np.array([[2.5, 1.5 * side], [13.0, 1.5 * side]])[:: -int(side)]  # the free side is that of the camera
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(with_margin(only([wall(*ends[0], *ends[1])], k), margin_m))
    c, s = math.cos(turn), math.sin(turn)
    (ax, ay), (bx, by) = ends @ np.array([[c, -s], [s, c]])  # turned towards the axis of the camera
    for k in range(frames):
        shown = tracker.observe(with_margin(only([wall(ax, ay, bx, by)], 20 + k), margin_m))
        for share in (0.3, 0.6, 0.95):
            x, y = ax + share * (bx - ax), ay + share * (by - ay)
            assert stop_behind(shown.planes, x, y) <= margin_m + 0.02


def stop_behind(planes: Floats, x: float, y: float) -> float:
    """How far behind a point the viewing ray through it meets the first plane, m; inf: none."""
    r = math.hypot(x, y)
    found = [math.inf]
    for ax, ay, bx, by, *_ in planes.tolist():
        m = np.array([[x / r, ax - bx], [y / r, ay - by]])
        if abs(np.linalg.det(m)) > 1e-9:
            range_m, share = np.linalg.solve(m, [ax, ay])
            if range_m > 0.0 and -1e-6 <= share <= 1.0 + 1e-6:
                found.append(float(range_m) - r)
    return min(found)

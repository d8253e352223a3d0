"""Tracks lose only what is observed to be free: what is hidden, or out of view, is kept."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker

from .tracked import POST, SMALL, STEP, WALL, distance, frame, with_planes, without_position
from .worlds import NS, wall

BOX = wall(6.0, -0.25, 6.0, 0.25)
BACK = wall(12.0, -9.0, 12.0, 9.0)


def planes_of(planes: list[list[float]], walls: list[list[float]], k: int, flags: int = 2) -> TrackingFrame:
    """Frame k with these planes and the free ranges before `walls`."""
    return with_planes(frame(walls, k), planes, [flags] * len(planes))


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


def test_the_part_of_a_wall_that_a_screen_hides_little_by_little_is_kept() -> None:
    tracker = settled([WALL])
    for k in range(20, 60):
        screen = wall(4.0, -2.5, 4.0, -2.0 + 0.05 * (k - 20))
        s = tracker.observe(frame([screen, WALL], k))
    assert distance(s, 8.0, -3.8) < 0.1
    assert distance(s, 8.0, -2.0) < 0.1


def test_the_far_end_of_an_oblique_wall_is_kept_while_a_screen_hides_it() -> None:
    """The rest of it remains in view, and beside the screen nothing is in view."""
    whole, rest, screen = wall(12.0, -3.0, 5.2, 3.8), wall(9.5, -0.5, 5.2, 3.8), wall(4.0, -1.3, 4.0, -0.2)
    tracker = settled([whole])
    for k in range(20, 30):
        s = tracker.observe(planes_of([screen, rest], [screen, whole], k))
        assert distance(s, 11.7, -2.7) < 0.1, k


@pytest.mark.parametrize("turn", [-1.0, 1.0])
def test_the_part_of_a_wall_that_leaves_the_view_little_by_little_is_kept(turn: float) -> None:
    tracker = settled([WALL])
    for k in range(20, 110):
        s = tracker.observe(frame([WALL], k, heading=turn * math.radians(0.4) * (k - 20)))
    assert distance(s, 8.0, -3.9 * turn) < 0.1


def test_a_detection_that_replaces_the_line_of_a_new_track_keeps_what_it_does_not_reach() -> None:
    """A wall seen edge-on, and then most of it 0.2 m beside its line; nothing is observed behind the rest."""
    tracker, side, part = Tracker(SMALL), wall(4.0, -1.0, 9.0, -1.0), wall(4.0, -0.8, 7.6, -0.8)
    tracker.observe(planes_of([side], [side], 0))
    s = tracker.observe(planes_of([part], [part], 1))
    assert len(s.ids) == 1
    assert distance(s, 8.9, -1.0) < 0.3


@pytest.mark.nojit
@pytest.mark.parametrize("cut", ["nowhere", "left", "right", "top", "bottom"])
def test_tracks_keep_the_edge_at_which_the_border_of_the_image_cut_what_they_hide(cut: str) -> None:
    """Two tracks hide one detection that continues neither, in a view that ends where it ends. Edges that were not cut follow
    it, the ends because few frames know them."""
    flags = {"nowhere": 0, "left": 4, "right": 8, "top": 16, "bottom": 32}[cut]
    walls = [wall(6.0, -1.5, 6.0, 0.0), wall(6.25, 0.0, 6.25, 1.5)]
    tracker = settled(walls, 5)
    before = tracker.observe(frame(walls, 5)).planes
    across = [5.98, -1.2, 6.35, 1.0, -2.0, 2.0]
    for k in range(6, 10):
        f = planes_of([across], walls, k, flags)
        ends = frame(walls, k, view_deg=19.0).model.free
        s = tracker.observe(dataclasses.replace(f, model=dataclasses.replace(f.model, free=ends)))
        assert s.ids.tolist() == [1, 2]
        assert s.unseen_ns.tolist() == [0, 0]
    assert np.allclose(s.planes[:, [1, 3]], before[:, [1, 3]], atol=1e-3) == (cut in ("left", "right"))
    assert np.allclose(s.planes[:, 4], before[:, 4], atol=0.05) == (cut == "top")
    assert np.allclose(s.planes[:, 5], before[:, 5], atol=0.05) == (cut == "bottom")


@pytest.mark.parametrize("frames", [2, 7, 20])
@pytest.mark.parametrize(("positioned", "memory_s"), [(True, SMALL.memory_s), (False, SMALL.memory_without_position_s)])
def test_what_has_left_the_view_is_kept_for_the_whole_memory(frames: int, positioned: bool, memory_s: float) -> None:
    """From the second observation on: the camera turns away, so that no frame can prove anything."""
    tracker, last = Tracker(SMALL), frames - 1
    for k in range(frames):
        f = frame([POST], k)
        tracker.observe(f if positioned else without_position(f))
    for k in range(frames, last + round(10 * memory_s) + 2):
        f = frame([POST], k, heading=math.radians(90.0))
        s = tracker.observe(f if positioned else without_position(f))
        assert (distance(s, 4.0, 0.0) < 0.1) is (k - last <= round(10 * memory_s)), k


def test_what_one_frame_alone_has_observed_does_not_accumulate_beside_the_view() -> None:
    tracker = Tracker(SMALL)
    tracker.observe(frame([POST], 0))
    turned = math.radians(90.0)
    assert distance(tracker.observe(frame([POST], 2, heading=turned)), 4.0, 0.0) < 0.1
    assert not len(tracker.observe(frame([POST], 3, heading=turned)).ids)


@pytest.mark.parametrize("frames", [2, 7])
def test_what_was_observed_is_kept_for_the_whole_memory_while_the_camera_is_blind(frames: int) -> None:
    tracker, last = Tracker(SMALL), frames - 1
    for k in range(frames):
        tracker.observe(without_position(frame([POST], k)))
    for k in range(frames, last + 21):
        unseen = dataclasses.replace(frame([], k).model, valid=False)
        s = tracker.observe(without_position(dataclasses.replace(frame([], k), model=unseen)))
        assert distance(s, 4.0, 0.0) < 0.1, k


def test_what_one_frame_has_observed_and_another_obstacle_hides_goes_soon() -> None:
    tracker, screen = Tracker(SMALL), wall(3.0, -1.0, 3.0, 1.0)
    tracker.observe(frame([POST], 0))
    for k in range(1, 5):
        s = tracker.observe(planes_of([screen], [screen], k))
    assert distance(s, 4.0, 0.0) > 0.5


@pytest.mark.parametrize("positioned", [True, False])
def test_a_clock_that_went_back_ends_no_track(positioned: bool) -> None:
    """Ages go on from the second that the clock has been back for, and obstacles beside the view stay for the whole memory."""
    tracker, memory = Tracker(SMALL), 20
    for k in range(100, 105):
        f = frame([POST], k)
        before = tracker.observe(f if positioned else without_position(f))
    for k in range(20, 20 + memory - 10):
        f = frame([], k, heading=math.radians(90.0))
        s = tracker.observe(f if positioned else without_position(f))
        assert s.ids.tolist() == before.ids.tolist()
        assert s.unseen_ns.tolist() == [NS + (k - 20) * STEP]
        assert s.age_ns.tolist() == [before.age_ns[0] + NS + (k - 20) * STEP]
        assert distance(s, 4.0, 0.0) < 0.1


def test_the_first_frame_after_a_clock_went_back_is_evidence() -> None:
    tracker = Tracker(SMALL)
    for k in range(100, 110):
        tracker.observe(frame([POST, WALL], k))
    s = tracker.observe(frame([POST, WALL], 20))
    assert s.unseen_ns.tolist() == [0] * len(s.ids)
    assert distance(s, 4.0, 0.0) < 0.1
    for k in range(21, 26):
        s = tracker.observe(frame([WALL], k))
    assert distance(s, 4.0, 0.0) > 3.0


def test_margins_without_a_position_contain_an_unknown_speed() -> None:
    """A vehicle looks to the side and starts along a wall, where its motion cannot be observed, with 5 m/s. The post before it
    is out of view; it is published where it was, and the margin reaches where it is."""
    tracker, side = Tracker(SMALL), wall(60.0, 3.0, -60.0, 3.0)
    for k in range(5):
        tracker.observe(without_position(frame([POST, side], k)))
    for k in range(5, 24):
        s = tracker.observe(without_position(frame([side], k, at=(0.5 * (k - 4), 0.0), heading=math.radians(90.0))))
        off = [
            distance(dataclasses.replace(s, planes=s.planes[[n]]), 4.0 - 0.5 * (k - 4), 0.0) for n in range(len(s.ids))
        ]
        assert min(np.array(off) - s.margin_m) <= 0.05, k

"""Tracks across jumps of the vehicle's heading: they turn with it, in view or not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker

from .tracked import POST, SMALL, STEP, WALL, distance, frame, without_position

JUMP = math.radians(70.0)
"""By more than half of the view, so that what was in view is out of it in the new axes, unless it is rotated too."""


def rotated(row: list[float]) -> list[float]:
    """A wall in axes in which the heading has jumped."""
    c, s = math.cos(JUMP), math.sin(JUMP)
    ax, ay, bx, by, top, bottom = row
    return [c * ax - s * ay, s * ax + c * ay, c * bx - s * by, s * bx + c * by, top, bottom]


def jumped(walls: list[list[float]], k: int) -> TrackingFrame:
    """A frame of a still camera after the heading has jumped."""
    f = frame([rotated(w) for w in walls], k, heading=JUMP)
    return dataclasses.replace(f, heading_jumps=((5 * STEP, JUMP),))


@pytest.mark.parametrize("positioned", [True, False])
def test_tracks_turn_with_a_heading_that_jumps(positioned: bool) -> None:
    tracker = Tracker(SMALL)
    for k in range(5):
        given = frame([WALL, POST], k)
        s = tracker.observe(given if positioned else without_position(given))
    ids = set(s.ids.tolist())
    for k in range(5, 9):
        given = jumped([WALL, POST], k)
        s = tracker.observe(given if positioned else without_position(given))
        assert set(s.ids.tolist()) == ids
        np.testing.assert_array_less(s.unseen_ns, STEP)
        assert s.objects == ()
    for x, y in ((8.0, 3.0), (4.0, 0.0)):
        rx, ry = rotated([x, y, x, y, 0.0, 0.0])[:2]
        assert distance(s, rx, ry) < 0.05


def test_a_hidden_track_turns_too() -> None:
    """What the camera does not observe after the jump keeps its place relative to the vehicle."""
    tracker, far = Tracker(SMALL), [8.0, -0.3, 8.0, 0.3, -2.5, -0.2]
    for k in range(5):
        tracker.observe(frame([far], k))
    screen = [4.0, -2.0, 4.0, 2.0, -3.0, 0.0]
    s = tracker.observe(jumped([screen], 5))
    rx, ry = rotated([8.0, 0.0, 8.0, 0.0, 0.0, 0.0])[:2]
    assert distance(s, rx, ry) < 0.1
    assert distance(s, 8.0, 0.0) > 2.0


@pytest.mark.nojit
def test_a_jump_that_the_tracks_contain_already_is_not_applied_again() -> None:
    tracker = Tracker(SMALL)
    for k in range(5):
        tracker.observe(frame([WALL], k))
    tracker.observe(jumped([WALL], 5))
    other = Tracker(SMALL, tracker.state())
    for k in range(6, 9):
        a, b = tracker.observe(jumped([WALL], k)), other.observe(jumped([WALL], k))
        np.testing.assert_array_equal(a.planes, b.planes)
        assert len(a.ids) == 1

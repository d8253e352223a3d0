"""How a frame observed a place: each rule at its limit, in a view of one direction and two layers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.free_view import FreeView
from core.tracking.observed import (
    CLEAR,
    EXPLAINED,
    FREE_SIGMAS,
    HIDDEN,
    OUT_OF_VIEW,
    by_direction,
    classify,
    is_beside,
    is_seen_through,
    is_unobserved,
    measured_limits,
    observed_heights,
    seen_from,
)
from core.tracking.tables import TRACK, detections_of
from core.types import FreeEnd, PlaneFlags

pytestmark = pytest.mark.nojit
SLACK_M, RANGE_M = 0.5, 5.0
OBSTACLE, UNKNOWN = int(FreeEnd.OBSTACLE), int(FreeEnd.UNKNOWN)


def view(
    *far_m: float, near_m: float = 1.0, end: int = UNKNOWN, ke_per_m: float = 0.0, ground_z_m: float = math.inf
) -> FreeView:
    """Layers from z = -1 to 0 and from 0 to 1 in directions of 0.5 rad to either side. far_m: of the layers."""
    near = np.full((1, 2), near_m, np.float32)
    far = np.array([far_m], np.float32)
    edges, layers = np.array([-0.5, 0.5]), np.array([-1.0, 0.0, 1.0])
    ends = np.full((1, 2), end, np.uint8)
    return FreeView(0.0, 0.0, ke_per_m, edges, layers, near, far, ends, ground_z_m, 0.0, 0.0, 0.25, 0.1)


def heights(seen: FreeView, top_m: float = -1.0, bottom_m: float = 1.0) -> tuple[float, float, float]:
    """(clear, explained, hidden) of a place 5 m ahead."""
    clear, explained, hidden = observed_heights(seen_from(RANGE_M, 0.0, seen), top_m, bottom_m, SLACK_M, seen)
    return round(clear, 6), round(explained, 6), round(hidden, 6)


def kind(seen: FreeView, y_m: float = 0.0) -> int:
    return int(classify(seen_from(RANGE_M, y_m, seen), -1.0, 1.0, SLACK_M, seen))


def test_a_place_is_clear_where_it_is_free_well_before_and_behind_it() -> None:
    assert heights(view(5.6, 5.6)) == (2.0, 0.0, 0.0)
    assert heights(view(5.6, 5.4)) == (1.0, 0.0, 0.0)
    assert heights(view(8.0, 8.0, near_m=4.4)) == (2.0, 0.0, 0.0)
    assert heights(view(8.0, 8.0, near_m=4.6)) == (0.0, 0.0, 0.0)
    assert heights(view(8.0, 8.0), -0.5, 0.25) == (0.75, 0.0, 0.0)


def test_the_noise_at_its_range_must_be_free_behind_it_too() -> None:
    noise_m = FREE_SIGMAS * 0.01 * RANGE_M**2
    end_m = RANGE_M + SLACK_M + noise_m
    assert heights(view(end_m + 0.01, end_m - 0.01, ke_per_m=0.01)) == (1.0, 0.0, 0.0)


def test_what_lies_below_the_ground_or_within_its_noise_is_not_clear() -> None:
    """At 5 m the noise of the ground is 0.5 m, more than its tolerance."""
    assert heights(view(8.0, 8.0, ground_z_m=0.9)) == (1.4, 0.0, 0.0)
    assert heights(view(8.0, 8.0, ground_z_m=0.0)) == (0.5, 0.0, 0.0)


def test_an_obstacle_at_about_its_range_explains_it_and_a_nearer_one_hides_it() -> None:
    assert heights(view(5.4, 4.8, end=OBSTACLE)) == (0.0, 2.0, 0.0)
    assert heights(view(5.4, 4.7, end=OBSTACLE)) == (0.0, 1.0, 1.0)
    assert heights(view(5.4, 4.7, end=UNKNOWN)) == (0.0, 0.0, 1.0)
    assert heights(view(1.0, 0.5, end=UNKNOWN)) == (0.0, 0.0, 0.0), "nothing was measured"
    assert heights(view(1.0, 0.5, end=OBSTACLE)) == (0.0, 0.0, 2.0)


def test_half_of_its_height_must_be_clear_and_little_of_it_explained() -> None:
    assert kind(view(8.0, 8.0)) == CLEAR
    assert kind(view(8.0, 3.0)) == CLEAR
    assert kind(view(8.0, 3.0, ground_z_m=0.2)) == HIDDEN, "0.7 m of it are clear"
    assert kind(view(8.0, 4.9, end=OBSTACLE)) == EXPLAINED
    assert kind(view(3.0, 3.0)) == HIDDEN
    assert kind(view(0.0, 0.0)) == OUT_OF_VIEW
    assert kind(view(8.0, 8.0), 4.0) == OUT_OF_VIEW


def test_a_place_beside_the_measured_directions_is_unobserved() -> None:
    measured, nothing = view(8.0, 3.0), view(0.0, 0.0)
    limits = measured_limits(measured)
    assert limits == (-0.5, 0.5)
    assert not is_beside(seen_from(5.0, 2.5, measured), limits)
    assert is_beside(seen_from(5.0, 3.0, measured), limits)
    assert is_beside(seen_from(5.0, 0.0, nothing), measured_limits(nothing))

    def unobserved(seen: FreeView, y_m: float = 0.0, top_m: float = -1.0) -> bool:
        return bool(is_unobserved(RANGE_M, y_m, top_m, 1.0, SLACK_M, seen, measured_limits(seen)))

    assert unobserved(view(8.0, 8.0), 3.0)
    assert not unobserved(view(8.0, 8.0))
    assert not unobserved(view(8.0, 3.0))
    assert unobserved(view(3.0, 3.0))
    assert unobserved(view(8.0, 3.0), top_m=-0.5)
    assert not unobserved(view(8.0, 3.0, ground_z_m=0.9), top_m=-0.5), "only what lies above the ground counts"


def across(x_m: float, top_m: float = -3.0, bottom_m: float = 3.0) -> tuple[float, ...]:
    """A plane across the view."""
    return x_m, -2.0, x_m, 2.0, top_m, bottom_m


def seen_through(*planes: tuple[float, ...], inferred: tuple[int, ...] = ()) -> bool:
    """Whether a frame with these planes shows that a track 2 m high is not at its place, 5 m ahead. inferred: planes that fill
    a gap. Margins are 0.1 m."""
    n, seen = len(planes), view(0.0, 0.0)
    flags = np.zeros(n, np.uint8)
    flags[list(inferred)] = int(PlaneFlags.INFERRED)
    detections = detections_of(np.array(planes, np.float32), np.full(n, 0.1, np.float32), flags, np.zeros(n, np.int32))
    track = np.zeros(1, TRACK)[0]
    track.top_m, track.bottom_m, track.margin_m = -1.0, 1.0, 0.1
    place = seen_from(RANGE_M, 0.0, seen)
    return bool(is_seen_through(place, track, by_direction(detections, seen), seen, 0.0))


def test_a_place_is_seen_through_where_something_is_measured_well_behind_it() -> None:
    assert seen_through(across(5.55))
    assert not seen_through(across(5.45)), "within both margins and FREE_BEHIND_M"
    assert not seen_through(across(4.5, -0.3, 0.1), across(10.0)), "a fifth of it is at its range"
    assert not seen_through(across(10.0), inferred=(0,)), "in a filled gap nothing was measured"
    assert not seen_through(across(10.0, 0.1, 6.0)), "less than half of its height"


def test_what_hides_a_place_is_no_proof_against_it() -> None:
    assert not seen_through(across(3.0), across(10.0))
    assert seen_through(across(3.0), across(10.0), inferred=(0,)), "a filled gap hides nothing"
    low = across(2.5, -0.5, -0.05)  # hides 0.9 m of its height
    assert seen_through(low, across(10.0))
    assert not seen_through(low, across(10.0, -3.0, 1.0)), "1.5 m of it are passed"

"""Tracked obstacles: they appear at once, keep their id, and go only when free space is observed through them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from core.tracking.association import GATE_MAX_M
from core.tracking.params import TrackingParams
from core.tracking.snapshot import STATES, TrackingFrame, TrackSnapshot, TrackState
from core.tracking.tracker import Tracker

from .tracked import POST, SMALL, STEP, WALL, distance, frame, with_margin, without_position
from .worlds import blind, wall


def states(s: TrackSnapshot) -> list[TrackState]:
    return [STATES[int(k)] for k in s.state]


def test_an_obstacle_appears_with_its_first_detection() -> None:
    s = Tracker(SMALL).observe(frame([WALL], 0))
    assert len(s.ids) == 1
    assert states(s) == [TrackState.NEW]
    assert distance(s, 8.0, 0.0) < 1e-3
    assert s.confidence[0] == pytest.approx(0.5)


def test_a_still_wall_keeps_its_id_and_its_noise_is_averaged() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(1)
    places, ids = [], set()
    for k in range(40):
        s = tracker.observe(frame([WALL], k, rng=rng, sigma_m=0.05))
        assert len(s.ids) == 1
        ids.add(int(s.ids[0]))
        places.append(float(s.planes[0, 0]))
    assert ids == {1}
    assert states(s) == [TrackState.DETECTED]
    assert s.hits[0] == 40
    assert np.std(places[20:]) < 0.02
    assert abs(np.mean(places[20:]) - 8.0) < 0.03
    assert s.sigma_m[0] < 0.03


def test_published_margin_reaches_the_nearest_face_of_the_newest_detection() -> None:
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(frame([WALL], k))
    near = wall(7.85, -4.0, 7.85, 4.0)
    s = tracker.observe(frame([near], 20))
    assert len(s.ids) == 1
    assert s.planes[:, [0, 2]].min() - s.margin_m[0] <= 7.85 - 0.05 + 1e-4


@pytest.mark.nojit
def test_one_detection_beside_a_wall_seen_edge_on_does_not_replace_its_line() -> None:
    """It is seen more than 0.15 m beside the line: the line moves so far that it hides what the detection hides."""
    tracker, side = Tracker(SMALL), wall(4.0, -2.0, 12.0, -2.0)
    for k in range(20):
        s = tracker.observe(frame([side], k))
    assert len(s.ids) == 1
    s = tracker.observe(with_margin(frame([wall(4.0, -2.2, 12.0, -2.2)], 20), 0.3))
    assert len(s.ids) == 1
    assert s.planes[0, [1, 3]] == pytest.approx(-2.0, abs=0.1)
    for x in (4.0, 8.0, 12.0):
        assert distance(s, x, -2.2) <= 0.15 / math.cos(math.atan2(2.2, x)) + 0.01


@pytest.mark.nojit
def test_every_detection_of_the_frame_is_covered_by_the_tracks() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(5)
    walls = [wall(6.0 + k % 3, -4.0 + k, 6.5 + k % 2, -3.2 + k) for k in range(8)]
    for k in range(30):
        f = frame(walls, k, rng=rng, sigma_m=0.1)
        s = tracker.observe(f)
        for ax, ay, bx, by, *_ in f.model.planes.tolist():
            for share in (0.0, 0.5, 1.0):
                assert distance(s, ax + share * (bx - ax), ay + share * (by - ay)) <= GATE_MAX_M + 1e-6


def test_pieces_of_one_wall_are_one_track_and_one_piece_is_not_two() -> None:
    tracker = Tracker(SMALL)
    halves = [wall(8.0, -4.0, 8.0, 0.0), wall(8.0, 0.0, 8.0, 4.0)]
    assert len(tracker.observe(frame(halves, 0)).ids) == 2
    s = tracker.observe(frame([WALL], 1))
    assert len(s.ids) == 1
    first = int(s.ids[0])
    s = tracker.observe(frame(halves, 2))
    assert s.ids.tolist() == [first]


def test_two_parallel_surfaces_stay_two_tracks() -> None:
    tracker = Tracker(SMALL)
    pair = [wall(7.7, -4.0, 7.7, 0.0), WALL]
    for k in range(10):
        s = tracker.observe(frame(pair, k))
    assert len(s.ids) == 2
    assert distance(s, 7.7, -2.0) < 0.05
    assert distance(s, 8.0, 3.0) < 0.05


def test_a_removed_obstacle_goes_within_half_a_second_of_being_seen_through() -> None:
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(frame([POST, WALL], k))
    for k in range(20, 25):
        s = tracker.observe(frame([WALL], k))
        if k < 22:
            assert distance(s, 4.0, 0.0) < 0.1, "removed without enough evidence"
    assert distance(s, 4.0, 0.0) > 3.0
    assert distance(s, 8.0, 0.0) < 0.1


@pytest.mark.parametrize(("detected", "needed"), [(1, 2), (2, 2), (3, 3), (4, 4), (12, 4)])
def test_an_obstacle_goes_after_as_many_frames_as_detected_it_two_at_least_and_four_at_most(
    detected: int, needed: int
) -> None:
    tracker = Tracker(SMALL)
    for k in range(detected):
        tracker.observe(frame([POST, WALL], k))
    shown = [distance(tracker.observe(frame([WALL], detected + k)), 4.0, 0.0) for k in range(needed)]
    assert max(shown[:-1]) < 0.1
    assert shown[-1] > 3.0


def test_an_obstacle_detected_now_and_then_stays() -> None:
    tracker = Tracker(SMALL)
    for k in range(60):
        s = tracker.observe(frame([POST, WALL] if k % 2 == 0 else [WALL], k))
        assert distance(s, 4.0, 0.0) < 0.1


def test_a_hidden_obstacle_is_kept_until_its_memory_ends() -> None:
    tracker = Tracker(SMALL)
    far = wall(8.0, -0.4, 8.0, 0.4)
    screen = wall(4.0, -2.0, 4.0, 2.0)
    for k in range(10):
        tracker.observe(frame([far], k))
    for k in range(10, 108):
        s = tracker.observe(frame([screen], k))
        assert distance(s, 8.0, 0.0) < 0.1
        assert TrackState.HIDDEN in states(s)
    for k in range(108, 112):
        s = tracker.observe(frame([screen], k))
    assert distance(s, 8.0, 0.0) > 1.0


def test_an_obstacle_out_of_view_is_kept_until_its_memory_ends() -> None:
    tracker = Tracker(SMALL)
    for k in range(10):
        tracker.observe(frame([WALL], k))
    s = tracker.observe(frame([WALL], 50, heading=math.pi))
    assert states(s) == [TrackState.OUT_OF_VIEW]
    assert not len(tracker.observe(frame([WALL], 111, heading=math.pi)).ids)


@pytest.mark.parametrize(("hits", "steps"), [(1, 2), (5, 25), (8, 64)])
def test_the_memory_of_what_is_hidden_grows_with_the_square_of_the_observations(hits: int, steps: int) -> None:
    tracker, far, screen = Tracker(SMALL), wall(8.0, -0.4, 8.0, 0.4), wall(4.0, -2.0, 4.0, 2.0)
    for k in range(hits):
        tracker.observe(frame([far], k))
    last = hits - 1
    assert distance(tracker.observe(frame([screen], last + steps)), 8.0, 0.0) < 0.1
    assert distance(tracker.observe(frame([screen], last + steps + 1)), 8.0, 0.0) > 1.0


@pytest.mark.nojit
def test_a_post_before_a_wall_is_seen_through_where_the_free_ranges_are_coarse() -> None:
    """Beside another post: their common direction is never free, but the wall is detected behind the place."""
    tracker, post, other = Tracker(SMALL), wall(6.0, -0.12, 6.0, 0.0), wall(6.0, 0.05, 6.0, 0.12)
    for k in range(10):
        tracker.observe(frame([post, other, WALL], k))
    for k in range(10, 15):
        s = tracker.observe(frame([other, WALL], k))
    assert distance(s, 6.0, -0.12) > 0.12
    assert distance(s, 6.0, 0.1) < 0.05


def test_a_short_detection_beside_a_line_seen_edge_on_is_no_part_of_it() -> None:
    """A post 0.3 m beside the line of a wall along the view: the wall does not hide what the post hides."""
    tracker = Tracker(SMALL)
    side, post = wall(4.0, -1.0, 9.0, -1.0), wall(9.5, -0.85, 9.5, -0.55)
    for k in range(5):
        f = frame([side, post], k)
        s = tracker.observe(f)
    assert distance(s, 9.5, -0.6) < 0.05
    assert len(s.ids) >= 2


@pytest.mark.nojit
def test_invalid_frames_remove_nothing() -> None:
    tracker = Tracker(SMALL)
    for k in range(10):
        tracker.observe(frame([POST], k))
    for k in range(10, 40):
        empty = blind(k * STEP).model
        s = tracker.observe(TrackingFrame(model=empty, camera_m=(0.0, 0.0, 0.0), t_ns=k * STEP, positioned=True))
    assert len(s.ids) == 1


def test_an_opening_in_a_wall_splits_its_track() -> None:
    tracker = Tracker(SMALL)
    back = wall(15.0, -9.0, 15.0, 9.0)
    for k in range(10):
        s = tracker.observe(frame([WALL, back], k))
    before = set(s.ids.tolist())
    parts = [wall(8.0, -4.0, 8.0, -1.5), wall(8.0, 1.5, 8.0, 4.0)]
    for k in range(10, 20):
        s = tracker.observe(frame([*parts, back], k))
    assert distance(s, 8.0, 0.0) > 0.7
    assert distance(s, 8.0, 3.0) < 0.1
    assert distance(s, 8.0, -3.0) < 0.1
    assert len(before & set(s.ids.tolist())) >= 1
    assert len(set(s.ids.tolist())) == len(s.ids)


def test_ids_last_along_a_street() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(2)
    walls = [wall(-5.0, -4.0, 40.0, -4.0), wall(40.0, 4.0, -5.0, 4.0)]
    seen_ids: list[set[int]] = []
    for k in range(60):
        s = tracker.observe(frame(walls, k, at=(0.3 * k, 0.0), rng=rng))
        seen_ids.append(set(s.ids.tolist()))
    assert all(len(ids) == 2 for ids in seen_ids[3:])
    assert set.intersection(*seen_ids[3:]) == seen_ids[-1]


def test_without_a_position_tracks_follow_the_motion_of_the_vehicle() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(3)
    walls = [wall(-5.0, -4.0, 12.0, -4.0), wall(12.0, -4.0, 12.0, 4.0), wall(12.0, 4.0, -5.0, 4.0)]
    ids = set()
    for k in range(30):
        s = tracker.observe(without_position(frame(walls, k, at=(0.2 * k, 0.0), rng=rng, sigma_m=0.02)))
        if k >= 10:
            ids |= set(s.ids[s.unseen_ns == 0].tolist())
            assert distance(s, 12.0 - 0.2 * k, 0.0) < 0.1
    assert len(ids) <= 4


@pytest.mark.nojit
def test_without_a_position_a_still_vehicle_has_no_speed_where_few_planes_show_its_motion() -> None:
    """A street in strong noise: only its far end shows how far the vehicle flies along it."""
    rng = np.random.default_rng(4)
    walls = [wall(3.0, -4.0, 15.0, -4.0), wall(15.0, 4.0, 3.0, 4.0), wall(15.0, -1.0, 15.0, 1.0)]
    tracker, speeds = Tracker(SMALL), []
    for k in range(60):
        f = with_margin(frame(walls, k, rng=rng, sigma_m=0.15), 0.4)
        tracker.observe(without_position(f))
        if k > 10:
            speeds.append(math.hypot(*tracker.state().velocity_m_s))
    assert max(speeds) < 1.0


@pytest.mark.parametrize("speed_m_s", [2.0, 4.0])
def test_without_a_position_the_speed_is_found_within_a_second(speed_m_s: float) -> None:
    rng = np.random.default_rng(5)
    walls = [wall(-5.0, -4.0, 18.0, -4.0), wall(18.0, -4.0, 18.0, 4.0), wall(18.0, 4.0, -5.0, 4.0)]
    tracker = Tracker(SMALL)
    for k in range(12):
        tracker.observe(without_position(frame(walls, k, at=(0.1 * speed_m_s * k, 0.0), rng=rng, sigma_m=0.02)))
    assert tracker.state().velocity_m_s == pytest.approx((speed_m_s, 0.0), abs=0.4)


@pytest.mark.nojit
def test_without_a_position_margins_grow_while_nothing_is_observed() -> None:
    tracker = Tracker(SMALL)
    for k in range(10):
        tracker.observe(without_position(frame([WALL], k)))
    s = tracker.observe(without_position(frame([], 19, heading=math.pi)))
    assert s.margin_m[0] >= 0.05 + 1.0 * SMALL.speed_error_m_s - 1e-6


def test_a_reset_of_the_position_moves_the_tracks_with_the_vehicle() -> None:
    tracker = Tracker(SMALL)
    for k in range(5):
        first = tracker.observe(frame([WALL], k))
    moved = wall(58.0, 26.0, 58.0, 34.0)
    s = tracker.observe(frame([moved], 5, at=(50.0, 30.0), reset_counter=1))
    assert s.ids.tolist() == first.ids.tolist()
    assert distance(s, 58.0, 30.0) < 0.1


@pytest.mark.nojit
def test_more_planes_than_slots_are_counted() -> None:
    tracker = Tracker(TrackingParams(most_tracks=64))
    walls = [wall(5.0 + 0.01 * k, -3.0 + 0.08 * k, 5.0 + 0.01 * k, -2.95 + 0.08 * k) for k in range(70)]
    f = frame([], 0)
    planes = np.array(walls, np.float32)
    n = len(planes)
    model = dataclasses.replace(
        f.model,
        planes=planes,
        support_px=np.ones(n, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    s = tracker.observe(dataclasses.replace(f, model=model))
    assert len(s.ids) == 64
    assert tracker.counts["detections_left_out"] == 6


@pytest.mark.parametrize("at", [5, 12, 17])
def test_a_tracker_resumed_from_its_state_continues_bit_for_bit(at: int) -> None:
    def frames() -> list[TrackingFrame]:
        rng = np.random.default_rng(7)
        out = []
        for k in range(25):
            person = wall(6.0, -3.0 + 0.15 * k, 6.0, -2.5 + 0.15 * k)
            walls = [WALL, person] if k != 8 else [WALL]
            out.append(frame(walls, k, at=(0.05 * k, 0.0), rng=rng))
        return out

    one = Tracker(SMALL)
    other = None
    for k, f in enumerate(frames()):
        if k == at:
            other = Tracker(SMALL, one.state())
            assert other.state() == one.state()
        s = one.observe(f)
        if other is not None:
            again = other.observe(f)
            for name in ("ids", "planes", "margin_m", "sigma_m", "confidence", "state", "hits", "age_ns", "object_id"):
                np.testing.assert_array_equal(getattr(s, name), getattr(again, name))
            assert s.objects == again.objects
    assert other is not None
    assert other.state() == one.state()


@pytest.mark.nojit
def test_a_state_that_does_not_fit_is_refused() -> None:
    tracker = Tracker(SMALL)
    tracker.observe(frame([WALL], 0))
    state = tracker.state()
    with pytest.raises(ValueError, match="stated size"):
        Tracker(SMALL, dataclasses.replace(state, tracks=state.tracks[:-8]))
    with pytest.raises(ValueError, match="most_tracks"):
        Tracker(SMALL, dataclasses.replace(state, slots=np.array([999], "<i4").tobytes()))
    with pytest.raises(ValueError, match="version 2 cannot be read"):
        Tracker(SMALL, dataclasses.replace(state, version=2))

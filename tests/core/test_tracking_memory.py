"""How long an obstacle is remembered: filled gaps, partial observations and losses of the position do not shorten it."""

from __future__ import annotations

import dataclasses
import math

import pytest

from core.tracking.losses import MOST_LOSSES
from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tables import CELL_M, coarsen, empty_table, make_room
from core.tracking.tracker import Tracker
from core.types import FreeEnd, PlaneFlags

from .tracked import POST, SMALL, STEP, WALL, distance, frame, with_planes, without_position
from .worlds import NS, wall

MEASURED, GAP = int(PlaneFlags.UNKNOWN_BEHIND), int(PlaneFlags.INFERRED)
ASIDE = math.radians(90.0)


# ---- filled gaps ----------------------------------------------------------------------------------------------------


def test_an_obstacle_that_one_frame_takes_for_a_filled_gap_is_remembered() -> None:
    """Twenty frames measure a post, one fills a gap over it, then the camera turns away."""
    tracker, gap = Tracker(SMALL), wall(4.0, -0.8, 4.0, 0.8)
    for k in range(20):
        tracker.observe(with_planes(frame([POST], k), [POST], [MEASURED]))
    s = tracker.observe(with_planes(frame([gap], 20), [gap], [GAP]))
    assert len(s.ids) == 1
    for k in range(21, 60):
        assert distance(tracker.observe(frame([POST], k, heading=ASIDE)), 4.0, 0.0) < 0.1, k


def test_a_wall_with_a_filled_gap_on_its_line_is_remembered() -> None:
    """The newest frame measures a part of a wall, and fills the rest of it."""
    tracker, part, gap = Tracker(SMALL), wall(8.0, -4.0, 8.0, 2.5), wall(8.0, 2.5, 8.0, 4.0)
    for k in range(20):
        tracker.observe(with_planes(frame([WALL], k), [WALL], [MEASURED]))
    s = tracker.observe(with_planes(frame([WALL], 20), [part, gap], [MEASURED, GAP]))
    assert len(s.ids) == 1
    for k in range(21, 60):
        assert distance(tracker.observe(frame([WALL], k, heading=ASIDE)), 8.0, -2.0) < 0.1, k


def test_a_gap_that_was_never_measured_is_forgotten_at_once_on_the_line_of_a_wall_too() -> None:
    tracker, part, gap = Tracker(SMALL), wall(8.0, -4.0, 8.0, 1.0), wall(8.0, 1.0, 8.0, 2.5)
    for k in range(20):
        tracker.observe(with_planes(frame([part, gap], k), [part, gap], [MEASURED, GAP]))
    for k in range(20, 25):
        s = tracker.observe(frame([WALL], k, heading=ASIDE))
    assert distance(s, 8.0, -2.0) < 0.1
    assert distance(s, 8.0, 2.0) > 0.7


def test_two_cells_that_become_one_are_measured_if_one_of_them_is() -> None:
    table = empty_table(1)
    t = table.tracks[0]
    t.cell_m, t.first_cell, t.cells = CELL_M, 0, 1
    make_room(table, 0, 0.0, 4.0 * CELL_M - 0.01)
    for k in range(4):
        table.cells[0, k].hits, table.cells[0, k].measured = 1, int(k == 2)
    coarsen(table, 0)
    assert table.cells["measured"][0, :2].tolist() == [0, 1]


# ---- partial observations -------------------------------------------------------------------------------------------


def partly_measured(walls: list[list[float]], k: int, measured: bool) -> TrackingFrame:
    """Frame k of a noisy camera, whose upper layer has no measurement unless `measured`."""
    f = frame(walls, k)
    model = dataclasses.replace(f.model, ke_per_m=0.005)
    if not measured:
        free = f.model.free
        far, end = free.free_to_m.copy(), free.end.copy()
        far[:, 0], end[:, 0] = free.free_from_m[:, 0], int(FreeEnd.UNKNOWN)
        model = dataclasses.replace(model, free=dataclasses.replace(free, free_to_m=far, end=end))
    return dataclasses.replace(f, model=model)


def test_a_low_obstacle_at_the_range_of_a_tall_one_does_not_explain_what_is_not_measured_of_it() -> None:
    """A house of 5 m, of which nothing is measured any more, and a wall of 1 m, which stays in view."""
    house, low = wall(10.0, -4.0, 10.0, 4.0, -4.0, 1.0), wall(9.5, -4.0, 9.5, 4.0, 0.0, 1.0)
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(with_planes(partly_measured([house], k, True), [house, low], [MEASURED, MEASURED]))
    for k in range(20, 40):
        s = tracker.observe(with_planes(partly_measured([low], k, False), [low], [MEASURED]))
        assert s.planes[:, 4].min() < -3.9, k


def test_of_what_few_frames_observed_a_low_obstacle_at_its_range_explains_all() -> None:
    """Three frames alone observe a plane of 5 m at a wall of 1 m: it flickers, and is one surface with the wall."""
    tall, low = wall(10.0, -4.0, 10.0, 4.0, -4.0, 1.0), wall(9.5, -4.0, 9.5, 4.0, 0.0, 1.0)
    tracker = Tracker(SMALL)
    for k in range(3):
        tracker.observe(with_planes(partly_measured([tall], k, True), [tall, low], [MEASURED, MEASURED]))
    for k in range(3, 8):
        s = tracker.observe(with_planes(partly_measured([low], k, False), [low], [MEASURED]))
    assert s.planes[:, 4].min() > -0.5


def test_an_obstacle_over_half_of_the_height_explains_a_track() -> None:
    """A plane 0.7 m behind a track of the same height, in noise that allows both to be one surface."""
    first, second = wall(10.0, -4.0, 10.0, 4.0, -2.0, 2.0), wall(10.7, -4.0, 10.7, 4.0, -2.0, 2.0)
    tracker = Tracker(SMALL)
    for k in range(4):
        tracker.observe(with_planes(partly_measured([first], k, True), [first], [MEASURED]))
    for k in range(4, 12):
        s = tracker.observe(with_planes(partly_measured([second], k, True), [second], [MEASURED]))
    assert distance(s, 10.0, 0.0) > 0.5


# ---- losses of the position -----------------------------------------------------------------------------------------


def turned_away(tracker: Tracker, frames: range, positioned: bool = True) -> TrackSnapshot:
    """The tracks after these frames of a camera that has turned away from POST."""
    for k in frames:
        f = frame([POST], k, heading=ASIDE)
        s = tracker.observe(f if positioned else without_position(f))
    return s


def observed_post() -> Tracker:
    """A tracker that has observed POST in the frames 0 to 19."""
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(frame([POST], k))
    return tracker


def test_a_position_that_is_lost_for_a_frame_ends_no_track_that_is_out_of_view() -> None:
    """The place of a track is exact up to the loss: its memory and its margin count from there."""
    tracker = observed_post()
    before = turned_away(tracker, range(20, 60))
    s = turned_away(tracker, range(60, 61), positioned=False)
    assert s.ids.tolist() == before.ids.tolist()
    assert s.margin_m - before.margin_m == pytest.approx(SMALL.speed_error_m_s * STEP / NS)
    s = turned_away(tracker, range(61, 115))
    assert distance(s, 4.0, 0.0) < 0.1


def test_without_a_position_a_track_is_forgotten_after_the_memory_since_the_loss() -> None:
    tracker, most = observed_post(), round(10 * SMALL.memory_without_position_s)
    turned_away(tracker, range(20, 60))
    assert len(turned_away(tracker, range(60, 60 + most - 1), positioned=False).ids) == 1
    assert len(turned_away(tracker, range(60 + most, 61 + most), positioned=False).ids) == 0


def test_a_position_that_returns_does_not_make_the_place_of_a_track_exact() -> None:
    """What was out of view while the position was lost may be displaced: its margin stays, until it is observed again."""
    tracker = observed_post()
    before = turned_away(tracker, range(20, 25))
    turned_away(tracker, range(25, 34), positioned=False)
    s = turned_away(tracker, range(34, 50))
    assert s.margin_m - before.margin_m == pytest.approx(SMALL.speed_error_m_s * 1.0)
    s = tracker.observe(frame([POST], 50))
    assert s.margin_m == pytest.approx(before.margin_m, abs=0.01)


def test_all_losses_since_the_newest_detection_count() -> None:
    """Two losses, of 1.0 and 0.2 s from the last position before them to the first one after them."""
    tracker = observed_post()
    before = turned_away(tracker, range(20, 25))
    turned_away(tracker, range(25, 34), positioned=False)
    turned_away(tracker, range(34, 50))
    turned_away(tracker, range(50, 51), positioned=False)
    s = turned_away(tracker, range(51, 60))
    assert s.margin_m - before.margin_m == pytest.approx(SMALL.speed_error_m_s * 1.2)
    restored = Tracker(SMALL, tracker.state())
    after, again = turned_away(tracker, range(60, 61)), turned_away(restored, range(60, 61))
    assert again.margin_m.tolist() == after.margin_m.tolist()


def test_a_loss_before_the_newest_detection_does_not_count() -> None:
    tracker = observed_post()
    turned_away(tracker, range(20, 35), positioned=False)
    before = tracker.observe(frame([POST], 35))
    s = turned_away(tracker, range(36, 45))
    s = turned_away(tracker, range(45, 46), positioned=False)
    assert s.margin_m - before.margin_m == pytest.approx(SMALL.speed_error_m_s * STEP / NS, abs=0.01)


def test_a_position_in_every_second_frame_only_is_no_position() -> None:
    """No step from frame to frame is measured: the track is forgotten as without a position."""
    tracker, most = observed_post(), round(10 * SMALL.memory_without_position_s)
    for k in range(20, 20 + most):
        s = turned_away(tracker, range(k, k + 1), positioned=k % 2 == 1)
    assert s.margin_m == pytest.approx(SMALL.speed_error_m_s * 0.1 * most, abs=0.2)
    assert len(turned_away(tracker, range(20 + most, 21 + most), positioned=False).ids) == 0


@pytest.mark.nojit
def test_many_losses_are_never_counted_as_less() -> None:
    params = dataclasses.replace(SMALL, memory_s=120.0, memory_without_position_s=30.0)
    tracker, losses = Tracker(params), 3 * MOST_LOSSES
    for k in range(20):
        tracker.observe(frame([POST], k))
    before = turned_away(tracker, range(20, 25))
    for n in range(losses):
        turned_away(tracker, range(25 + 10 * n, 26 + 10 * n), positioned=False)
        s = turned_away(tracker, range(26 + 10 * n, 35 + 10 * n))
    assert s.margin_m - before.margin_m >= SMALL.speed_error_m_s * 0.2 * losses - 1e-3
    assert len(tracker.state().losses) == MOST_LOSSES


@pytest.mark.nojit
@pytest.mark.parametrize("positioned", [True, False])
def test_a_clock_that_goes_back_moves_the_loss_of_the_position_too(positioned: bool) -> None:
    tracker = observed_post()
    before = turned_away(tracker, range(20, 25))
    turned_away(tracker, range(25, 30), positioned=False)
    s = turned_away(tracker, range(2, 3), positioned)
    lost_s = 0.5 + 1.0  # a clock that went back has been back for a second
    assert s.margin_m - before.margin_m == pytest.approx(SMALL.speed_error_m_s * lost_s)


def test_a_long_gap_between_two_frames_is_no_jump_of_the_position() -> None:
    """A vehicle flies 500 m in 50 s without a frame."""
    params = dataclasses.replace(SMALL, memory_s=120.0)
    tracker = Tracker(params)
    for k in range(20):
        tracker.observe(frame([POST], k, at=(0.1 * k, 0.0)))
    s = tracker.observe(frame([], 520, at=(-500.0, 0.0)))
    assert distance(s, 4.0, 0.0) < 0.1

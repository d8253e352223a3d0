"""Slots of the track table: what takes the slot of a merged track is not mixed with it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.tracking.association import GATE, assign, find_pairs
from core.tracking.params import TrackingParams
from core.tracking.splitting import split_tracks
from core.tracking.tables import Exposure, TrackTable, detections_of, empty_table
from core.tracking.tracker import Tracker
from core.tracking.update import apply_detections, begin_frame

from .test_tracking_proof import planes_of
from .tracked import frame
from .worlds import wall

pytestmark = pytest.mark.nojit
EYE = (0.0, 0.0, 0.0)


def apply(table: TrackTable, walls: list[list[float]], t_ns: int, next_id: int) -> np.ndarray:
    """The detections of a frame after they were applied to the table."""
    n = len(walls)
    margins, zeros = np.full(n, 0.05, np.float32), np.zeros(n, np.int32)
    d = detections_of(np.array(walls, np.float32), margins, zeros.astype(np.uint8), zeros)
    begin_frame(table, 0.1)
    pairs, scores = np.zeros((256, 3), np.int32), np.zeros(256)
    count, _ = find_pairs(d, table.tracks, GATE, (0.0, 0.0, 0.0), pairs, scores)
    order = np.argsort(-scores[:count], kind="stable")
    assign(d, table.tracks, pairs[order])
    apply_detections(table, d, pairs[order], Exposure(EYE, t_ns, True), next_id)
    return d


def test_a_detection_of_a_merged_track_does_not_go_to_the_track_that_takes_its_slot() -> None:
    table = empty_table(16)
    apply(table, [wall(8.0, -4.0, 8.0, 0.0), wall(8.0, 0.0, 8.0, 4.0)], 1, 1)
    post, left, right = wall(3.0, -0.2, 3.0, 0.2), wall(8.0, -4.0, 8.0, 1.0), wall(8.0, 1.25, 8.0, 4.0)
    d = apply(table, [post, left, right], 2, 3)
    first, second, third = d["track"].tolist()
    assert second == third, "both are parts of the merged wall"
    assert first != second
    ids = table.tracks["id"][table.tracks["hits"] > 0]
    assert len(set(ids.tolist())) == len(ids) == 2


def test_many_tracks_that_are_split_in_one_frame_evict_none_while_the_table_has_room() -> None:
    """The slots of one frame were limited to 64 more than its detections need."""
    tracker = Tracker(TrackingParams(most_tracks=512))
    walls = [wall(3.0 + 1.5 * k, -1.5, 3.0 + 1.5 * k, 1.5) for k in range(100)]
    before = len(tracker.observe(planes_of(walls, [], 0)).ids)
    assert before == 100
    tracks, cells = tracker._all
    for j in range(before):
        middle = tracks["cells"][j] // 2
        cells[j, middle] = np.zeros((), cells.dtype)
    blind = frame([], 1)
    after = tracker.observe(dataclasses.replace(blind, model=dataclasses.replace(blind.model, valid=False)))
    assert tracker.counts["tracks_evicted"] == 0
    assert len(after.ids) == 200


@pytest.mark.parametrize("gap", [4, 7])
@pytest.mark.parametrize("observed", [True, False])
def test_a_track_that_is_split_in_a_full_table_loses_only_its_gap(observed: bool, gap: int) -> None:
    """Its smaller part, the first or the second, takes the slot of a track that this frame did not observe; where there is none,
    the track stays whole."""
    tracker, t_ns = Tracker(TrackingParams(most_tracks=64)), 7
    tracker.observe(planes_of([wall(3.0 + 1.5 * k, -1.5, 3.0 + 1.5 * k, 1.5) for k in range(64)], [], 0))
    table = tracker._all
    table.tracks["seen_ns"], table.cells["seen_ns"] = t_ns, t_ns
    if not observed:
        table.tracks["seen_ns"][9] = 0
    table.cells[5, gap] = np.zeros((), table.cells.dtype)
    next_id, end, evicted = split_tracks(table, 64, 65, t_ns)
    assert (next_id, end, evicted) == ((65, 64, 0) if observed else (66, 64, 1))
    parts = table.tracks[np.abs(table.tracks["x_m"] - 10.5) < 0.01]
    assert len(parts) == (1 if observed else 2)
    assert np.abs(parts["s0_m"]).max() == np.abs(parts["s1_m"]).max() == 1.5


@pytest.mark.compiled  # a full table without the JIT: the test below
def test_what_removed_a_cell_is_no_evidence_against_its_next_observation() -> None:
    """The middle of a wall is removed while the full table keeps the wall whole; a frame then observes the wall again."""
    tracker, whole = Tracker(TrackingParams(most_tracks=64)), wall(9.0, -4.0, 9.0, 4.0)
    posts = [wall(3.0 + 0.05 * k, -3.1 + 0.1 * k, 3.0 + 0.05 * k, -3.05 + 0.1 * k) for k in range(63)]
    parts = [wall(9.0, -4.0, 9.0, -1.0), wall(9.0, 1.0, 9.0, 4.0)]
    for k in range(12):
        walls = [whole] if k < 5 else parts
        s = tracker.observe(planes_of([*walls, *posts], walls, k))
        assert (len(s.ids), s.evicted) == (64, 0)
    tracks, cells = tracker._all
    middle = cells[int(np.argmax(tracks["s1_m"] - tracks["s0_m"])), 7:10]
    assert (middle["hits"] == 0).all()
    tracker.observe(planes_of([whole, *posts], [whole], 12))
    assert (middle["hits"] == 1).all()
    assert (middle["against"] == 0).all()


def test_a_full_table_says_what_it_leaves_out_and_what_it_removes() -> None:
    tracker = Tracker(TrackingParams(most_tracks=64))
    walls = [wall(3.0 + 1.5 * k, -1.5, 3.0 + 1.5 * k, 1.5) for k in range(80)]
    first = tracker.observe(planes_of(walls, [], 0))
    assert (len(first.ids), first.left_out, first.evicted) == (64, 16, 0)
    same = tracker.observe(planes_of(walls[:64], [], 1))
    assert (len(same.ids), same.left_out, same.evicted) == (64, 0, 0)
    others = tracker.observe(planes_of([*walls[:44], *walls[64:74]], [], 2))
    assert (len(others.ids), others.left_out, others.evicted) == (64, 0, 10)

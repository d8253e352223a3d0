"""Slots of the track table: what takes the slot of a merged track is not mixed with it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.tracking.association import assign, find_pairs
from core.tracking.params import TrackingParams
from core.tracking.tables import TrackTable, detections_of, empty_table
from core.tracking.tracker import Tracker, rules_of
from core.tracking.update import apply_detections, begin_frame

from .test_tracking import frame
from .test_tracking_proof import planes_of
from .worlds import wall

pytestmark = pytest.mark.nojit
RULES = rules_of(TrackingParams())[0]
EYE = (0.0, 0.0, 0.0)


def apply(table: TrackTable, walls: list[list[float]], t_ns: int, next_id: int) -> np.ndarray:
    """The detections of a frame after they were applied to the table."""
    n = len(walls)
    margins, zeros = np.full(n, 0.05, np.float32), np.zeros(n, np.int32)
    d = detections_of(np.array(walls, np.float32), margins, zeros.astype(np.uint8), zeros, 0.03)
    begin_frame(table, 0.1, RULES)
    pairs, scores = np.zeros((256, 3), np.int32), np.zeros(256)
    live = np.flatnonzero(table.tracks["hits"])
    count, _ = find_pairs(d, table.tracks, live, RULES, 0.0, 0.0, pairs, scores)
    order = np.argsort(-scores[:count], kind="stable")
    assign(d, table.tracks, pairs, order)
    apply_detections(table, d, pairs, order, RULES, EYE, next_id, t_ns, True)
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

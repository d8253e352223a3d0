"""The searches of the tracker find what a plain search finds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.free_view import FreeView
from core.tracking.boxes import find_near
from core.tracking.ego_motion import common_shift
from core.tracking.intervals import at_value, index_intervals
from core.tracking.observed import crosses, find_spans
from core.tracking.tables import TRACK, detections_of

pytestmark = pytest.mark.nojit


def random_detections(rng: np.random.Generator, n: int) -> np.ndarray:
    """(N,) DETECTION around the origin."""
    a = rng.uniform(-8.0, 8.0, (n, 2))
    b = a + rng.uniform(-2.0, 2.0, (n, 2))
    top = rng.uniform(-3.0, 0.0, n)
    planes = np.column_stack([a, b, top, top + rng.uniform(0.2, 2.0, n)]).astype(np.float32)
    return detections_of(planes, np.full(n, 0.1, np.float32), np.zeros(n, np.uint8), np.zeros(n, np.int32))


def test_overlapping_boxes() -> None:
    rng = np.random.default_rng(1)
    d, others = random_detections(rng, 40), random_detections(rng, 60)
    x, y = np.sort([others["ax_m"], others["bx_m"]], axis=0), np.sort([others["ay_m"], others["by_m"]], axis=0)
    boxes = np.array([x[0], x[1], y[0], y[1], others["top_m"], others["bottom_m"]])
    listed, found = np.empty(60, np.int64), 0
    for one in d:
        near = listed[: find_near(one, boxes, 0.5, 0.25, listed)].tolist()
        assert near == sorted(near)
        for n in range(60):
            apart = (
                x[0, n] > max(one["ax_m"], one["bx_m"]) + 0.5
                or x[1, n] < min(one["ax_m"], one["bx_m"]) - 0.5
                or y[0, n] > max(one["ay_m"], one["by_m"]) + 0.5
                or y[1, n] < min(one["ay_m"], one["by_m"]) - 0.5
                or boxes[4, n] >= one["bottom_m"] + 0.25
                or boxes[5, n] <= one["top_m"] - 0.25
            )
            assert (n in near) != apart
        found += len(near)
    assert 20 < found < 2000


def test_every_detection_that_crosses_a_ray_is_found() -> None:
    """From the middle of the detections, so that some lie behind the camera."""
    rng = np.random.default_rng(2)
    d = random_detections(rng, 80)
    edges, nothing = np.array([2.5, 3.5]), np.zeros((0, 0), np.float32)
    view = FreeView(0.3, 0.2, 0.001, edges, edges, nothing, nothing, np.zeros((0, 0), np.uint8), math.inf, 0, 0, 0, 0)
    spans, found = np.empty((2, 80)), 0
    find_spans(d, view, spans)
    index = index_intervals(spans[0], spans[1])
    for azimuth in np.linspace(-math.pi, math.pi, 37):
        turn = math.remainder(azimuth - 3.0, math.tau)
        first, end = at_value(index, turn)
        crossing = [i for i in index.items[first:end] if crosses(spans, i, turn)]
        c, s = math.cos(azimuth), math.sin(azimuth)
        for i, one in enumerate(d):
            ax, ay, bx, by = one["ax_m"] - 0.3, one["ay_m"] - 0.2, one["bx_m"] - 0.3, one["by_m"] - 0.2
            side_a, side_b = c * ay - s * ax, c * by - s * bx
            if side_a * side_b > 0.0:
                continue
            far = (c * ax + s * ay) + side_a / (side_a - side_b) * (c * (bx - ax) + s * (by - ay))
            if far >= 0.0:
                assert i in crossing, (i, azimuth)
                found += 1
    assert found > 20


def test_the_index_lists_all_intervals_that_hold_a_value_in_order() -> None:
    rng = np.random.default_rng(3)
    low = rng.uniform(-5.0, 5.0, 200)
    high = low + rng.exponential(1.0, 200)
    index = index_intervals(low, high)
    for value in (*rng.uniform(-6.0, 12.0, 50), low[7], high[7], low.min(), high.max()):
        first, end = at_value(index, value)
        listed = index.items[first:end]
        assert list(listed) == sorted(set(listed.tolist()))
        assert set(np.flatnonzero((low <= value) & (value <= high))) <= set(listed.tolist())


def test_the_index_of_no_interval_and_of_equal_places() -> None:
    first, end = at_value(index_intervals(np.zeros(0), np.zeros(0)), 0.5)
    assert first == end
    index = index_intervals(np.full(3, 2.0), np.full(3, 2.0))
    first, end = at_value(index, 2.0)
    assert index.items[first:end].tolist() == [0, 1, 2]
    assert at_value(index, math.nan) == at_value(index, -math.inf)


def test_the_common_shift_of_three_walls() -> None:
    walls = np.array([[8, -4, 8, 4, -3, 0], [0, -4, 8, -4, -3, 0], [8, 4, 0, 4, -3, 0]], np.float32)
    d = detections_of(walls, np.full(3, 0.05, np.float32), np.zeros(3, np.uint8), np.zeros(3, np.int32))
    tracks = np.zeros(3, TRACK)
    for name, value in (
        ("tx", d["tx"]),
        ("ty", d["ty"]),
        ("top_m", d["top_m"] - 0.1),
        ("bottom_m", d["bottom_m"] - 0.1),
    ):
        tracks[name] = value
    tracks["x_m"], tracks["y_m"] = 0.5 * (d["ax_m"] + d["bx_m"]) - 0.05, 0.5 * (d["ay_m"] + d["by_m"]) + 0.02
    pairs = np.array([[0, 0, 1], [1, 1, 1], [2, 2, 1], [0, 1, 1], [1, 2, 2]], np.int32)
    scores = np.array([2.0, 2.0, 2.0, 1.0, 9.0])
    assert common_shift(d, tracks, pairs, scores, 0.25) == pytest.approx((0.05, -0.02, 0.1), abs=2e-3)
    assert common_shift(d, tracks, pairs[:0], scores[:0], 0.25) == (0.0, 0.0, 0.0)

"""Margins of tracks reach as near as their newest detections do; their covariance stays one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.tracking.line import begin_line, predict_line, variance_at
from core.tracking.snapshot import TrackSnapshot
from core.tracking.tables import TRACK, detections_of
from core.tracking.tracker import Tracker

from .tracked import SMALL, frame
from .worlds import wall


def nearest_m(s: TrackSnapshot, y: float) -> float:
    """How near the tracks with their margins come to the camera at y, along x."""
    found = []
    for (ax, ay, bx, by, *_), margin_m in zip(s.planes.tolist(), s.margin_m.tolist(), strict=True):
        share = (y - ay) / (by - ay)
        if -1e-3 <= share <= 1.0 + 1e-3:
            found.append(ax + share * (bx - ax) - margin_m)
    return min(found)


@pytest.mark.nojit
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_margins_reach_every_detection_of_the_newest_frame(seed: int) -> None:
    """Also where another detection moves the line of the track afterwards, and where two tracks are merged."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(seed)
    for k in range(30):
        cuts = np.sort(rng.uniform(-3.5, 3.5, 2))
        walls, x = [], 8.0 + rng.normal(0.0, 0.06, 3)
        for n, (low, high) in enumerate(zip([-4.0, *cuts], [*cuts, 4.0], strict=True)):
            if high - low > 0.2:
                walls.append(wall(x[n], low + 0.05, x[n], high - 0.05))
        f = frame(walls, k)
        margins = rng.uniform(0.05, 0.3, len(f.model.planes)).astype(np.float32)
        f = dataclasses.replace(f, model=dataclasses.replace(f.model, margin_m=margins))
        s = tracker.observe(f)
        for (ax, ay, _, by, *_), margin_m in zip(f.model.planes.tolist(), margins.tolist(), strict=True):
            for share in (0.02, 0.5, 0.98):
                assert nearest_m(s, ay + share * (by - ay)) <= ax - margin_m + 2e-3, k


def test_the_margin_of_a_short_track_reaches_its_newest_detection_also_when_it_is_hidden() -> None:
    tracker = Tracker(SMALL)
    for k in range(20):
        tracker.observe(frame([wall(4.0, -0.2, 4.0, 0.2)], k))
    tracker.observe(frame([wall(3.8, -0.19, 3.8, 0.19)], 20))
    s = tracker.observe(frame([wall(2.0, -1.0, 2.0, 1.0)], 21))
    n = int(np.argmax(s.planes[:, 0]))
    assert s.planes[n, 0] - s.margin_m[n] <= 3.8 - 0.05 + 1e-3


def test_the_covariance_of_a_line_stays_positive_while_nothing_is_observed() -> None:
    """The variance of the slope has a limit. That of the place must not lose what the limit takes."""
    t = np.zeros(1, TRACK)[0]
    planes = np.array([wall(8.0, -0.05, 8.0, 0.05)], np.float32)
    d = detections_of(planes, np.full(1, 0.1, np.float32), np.zeros(1, np.uint8), np.zeros(1, np.int32))[0]
    begin_line(t, d)
    t["s0_m"], t["s1_m"] = 3.0, 3.1
    for _ in range(100):
        predict_line(t, 100.0)  # the slope turns by 10 degrees each time
        assert t["p00"] * t["p11"] >= t["p01"] ** 2
        assert variance_at(t, 3.05) > 0.0

"""One rectangle stands for two detections only where both cover most of it, and leave no large corner empty."""

from __future__ import annotations

import pytest

from core.tracking.tracker import Tracker

from .tracked import SMALL, frame
from .worlds import wall


@pytest.mark.parametrize("sign", [-1.0, 1.0], ids=["left", "right"])
@pytest.mark.parametrize("up", [-1.0, 1.0], ids=["upper", "lower"])
@pytest.mark.parametrize(
    ("wide_y", "tall_y", "tall_first"),
    [
        ((-4.0, 4.0), (-4.0, 3.2), False),
        ((-4.0, 4.0), (-4.0, 3.2), True),
        ((-1.5, 1.5), (-1.5, 0.8), False),
    ],
    ids=["continues", "continues the taller one", "covers"],
)
def test_a_track_covers_no_corner_that_neither_of_its_detections_reaches(
    wide_y: tuple[float, float], tall_y: tuple[float, float], tall_first: bool, up: float, sign: float
) -> None:
    """Under a parapet, beside a wall that reaches the ground, a corner of 0.7 or 0.8 m by 3 m is open. The rectangle around both
    is mostly covered, but that of a single frame would hold no empty square of 0.5 m. The same above a low wall."""
    walls = [(wide_y, -1.0), (tall_y, 2.0)]
    tracker = Tracker(SMALL)
    for k, (span, far_m) in enumerate(reversed(walls) if tall_first else walls):
        a, b = sorted(sign * y for y in span)
        top, bottom = sorted((-4.0 * up, far_m * up))
        s = tracker.observe(frame([wall(6.0, a, 6.0, b, top, bottom)], k))
    y = sign * (wide_y[1] - 0.2)
    there = [p for p in s.planes.tolist() if min(p[1], p[3]) <= y <= max(p[1], p[3])]
    assert there
    assert max(max(up * p[4], up * p[5]) for p in there) < 1.0


@pytest.mark.nojit
@pytest.mark.parametrize("behind_m", [0.25, 0.35])
def test_a_track_that_a_detection_covers_makes_a_longer_track_no_taller(behind_m: float) -> None:
    """The detection continues a long track, and covers a taller one behind a part of it."""
    tracker, left, right = Tracker(SMALL), wall(6.0, -4.0, 6.0, 0.0, -4.0, 0.0), wall(6.0, 0.0, 6.0, 4.0, -4.0, 0.0)
    tracker.observe(frame([wall(6.0, -4.0, 6.0, 4.0, -4.0, 0.0)], 0))
    tracker.observe(frame([left, wall(6.0 + behind_m, 0.0, 6.0 + behind_m, 4.0, -4.9, 0.0)], 1))
    s = tracker.observe(frame([left, right], 2))
    assert min(p[4] for p in s.planes.tolist() if min(p[1], p[3]) <= -2.0) == pytest.approx(-4.0)


def test_a_corner_that_is_narrow_does_not_divide_a_track() -> None:
    tracker = Tracker(SMALL)
    for k, (y, bottom_m) in enumerate(((4.0, -1.0), (3.7, 2.0))):
        s = tracker.observe(frame([wall(6.0, -4.0, 6.0, y, -4.0, bottom_m)], k))
    assert len(s.ids) == 1

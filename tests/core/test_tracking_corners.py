"""One rectangle stands for two detections only where both cover most of it, and leave no large corner empty."""

from __future__ import annotations

import pytest

from core.tracking.tracker import Tracker

from .tracked import SMALL, frame
from .worlds import wall

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("sign", [-1.0, 1.0], ids=["left", "right"])
@pytest.mark.parametrize(
    ("upper_y", "tall_y"),
    [((-4.0, 4.0), (-4.0, 3.2)), ((-1.5, 1.5), (-1.5, 0.8))],
    ids=["continues", "covers"],
)
def test_a_track_covers_no_corner_that_neither_of_its_detections_reaches(
    upper_y: tuple[float, float], tall_y: tuple[float, float], sign: float
) -> None:
    """Under a parapet, beside a wall that reaches the ground, a corner of 0.7 or 0.8 m by 3 m is open. The rectangle around both
    is mostly covered, but that of a single frame would hold no empty square of 0.5 m."""
    tracker = Tracker(SMALL)
    for k, (span, bottom_m) in enumerate(((upper_y, -1.0), (tall_y, 2.0))):
        a, b = sorted(sign * y for y in span)
        s = tracker.observe(frame([wall(6.0, a, 6.0, b, -4.0, bottom_m)], k))
    y = sign * (upper_y[1] - 0.2)
    bottoms = [p[5] for p in s.planes.tolist() if min(p[1], p[3]) <= y <= max(p[1], p[3])]
    assert bottoms
    assert max(bottoms) < 1.0


def test_a_corner_that_is_narrow_does_not_divide_a_track() -> None:
    tracker = Tracker(SMALL)
    for k, (y, bottom_m) in enumerate(((4.0, -1.0), (3.7, 2.0))):
        s = tracker.observe(frame([wall(6.0, -4.0, 6.0, y, -4.0, bottom_m)], k))
    assert len(s.ids) == 1

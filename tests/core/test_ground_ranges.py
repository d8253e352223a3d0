"""The ranges at which the ground was measured, from sampled points in known places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.stages.ground import NO_GROUND, POINT
from core.stages.ground_ranges import with_ranges
from core.types import Ground

pytestmark = pytest.mark.nojit
EDGES_T = np.linspace(-0.5, 0.5, 6)
"""Five directions; the middle one is ahead."""
GROUND = Ground(
    seen=True, height_m=2.0, slope_x=0.02, slope_y=-0.05, tolerance_m=0.25, noise_per_m=0.05, blind_beyond_m=10.0
)


def point(x_m: float, t: float = 0.0, off_m: float = 0.0, voted: bool = True) -> tuple[float, float, float, bool]:
    """A sample at forward distance x and tangent t, so far below the plane."""
    y_m = t * x_m
    return x_m, y_m, GROUND.height_m + GROUND.slope_x * x_m + GROUND.slope_y * y_m + off_m, voted


def ranges(*samples: tuple[float, float, float, bool], ground: Ground = GROUND) -> list[tuple[float, float]]:
    points = np.zeros(len(samples), POINT)
    for at, (x, y, z, voted) in zip(points, samples, strict=True):
        at["x"], at["y"], at["z"], at["level"] = x, y, z, float(voted)
    found = with_ranges(ground, points, EDGES_T)
    return [(round(a, 3), round(b, 3)) for a, b in zip(found.seen_from_m, found.seen_to_m, strict=True)]


NOTHING = (0.0, 0.0)


def test_each_direction_has_the_nearest_and_the_farthest_sample_as_horizontal_range() -> None:
    found = ranges(point(5.0), point(3.0), point(8.0, 0.05), point(4.0, -0.4))
    side_m, far_m = round(4.0 * math.hypot(1.0, 0.4), 3), round(8.0 * math.hypot(1.0, 0.05), 3)
    assert found == [(side_m, side_m), NOTHING, (3.0, far_m), NOTHING, NOTHING]


@pytest.mark.parametrize(
    ("sample", "counts"),
    [
        (point(9.9), True),
        (point(10.1), False),  # low obstacles look like ground there
        (point(4.0, voted=False), False),
        (point(4.0, off_m=0.24), True),
        (point(4.0, off_m=0.26), False),
        (point(4.0, off_m=-0.26), False),
        (point(8.0, off_m=0.39), True),  # the noise is 0.4 m
        (point(8.0, off_m=0.41), False),
        (point(9.0, 0.4, off_m=-0.3), True),
        (point(4.0, 0.51), False),
        (point(4.0, -0.51), False),
    ],
)
def test_samples_count_that_voted_on_the_plane_within_the_range_and_the_view(
    sample: tuple[float, float, float, bool], counts: bool
) -> None:
    assert (ranges(sample) != [NOTHING] * 5) is counts


def test_a_direction_between_two_has_the_part_that_both_share() -> None:
    left, right = (point(3.0, -0.2), point(6.0, -0.2)), (point(4.0, 0.2), point(8.0, 0.2))
    scale = math.hypot(1.0, 0.2)
    assert ranges(*left, *right)[1:4] == [
        (round(3.0 * scale, 3), round(6.0 * scale, 3)),
        (round(4.0 * scale, 3), round(6.0 * scale, 3)),
        (round(4.0 * scale, 3), round(8.0 * scale, 3)),
    ]
    assert ranges(*left)[2] == ranges(*right)[2] == NOTHING
    assert ranges(point(3.0, -0.2), point(4.0, -0.2), point(5.0, 0.2), point(8.0, 0.2))[2] == NOTHING


def test_without_a_ground_there_are_none() -> None:
    assert ranges(point(4.0), ground=NO_GROUND) == []

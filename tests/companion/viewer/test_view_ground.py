"""Pictures show no free space in the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.viewer.geometry import level_range_m, lowest_free_m
from core.types import Ground


@pytest.mark.parametrize("slope_x", [-0.3, -0.05, 0.0, 0.05])
@pytest.mark.parametrize("height_m", [0.2, 0.5, 2.0])
def test_range_at_the_camera_height_ends_where_the_ground_begins(slope_x: float, height_m: float) -> None:
    ground = Ground(seen=True, height_m=height_m, slope_x=slope_x, slope_y=0.02, tolerance_m=0.25, noise_per_m=0.02)
    for azimuth in (-0.6, 0.0, 0.4):
        (reach,) = level_range_m(ground, np.array([azimuth]))
        for r in np.arange(0.1, 12.0, 0.17):
            x, y = r * math.cos(azimuth), r * math.sin(azimuth)
            above = height_m + slope_x * x + 0.02 * y
            if height_m >= 0.25:  # a camera that is lower shows nothing
                assert (above >= max(0.25, 0.02 * r)) == (r <= reach)
            else:
                assert reach == 0.0


def test_without_ground_all_of_a_layer_is_drawn() -> None:
    assert np.isinf(level_range_m(Ground(seen=False), np.zeros(3))).all()
    assert np.isinf(lowest_free_m(Ground(seen=False), np.zeros(3))).all()


def test_side_view_ends_above_the_ground() -> None:
    ground = Ground(seen=True, height_m=2.0, slope_x=0.1, tolerance_m=0.25, noise_per_m=0.1)
    assert lowest_free_m(ground, np.array([0.0, 1.0, 5.0])) == pytest.approx([1.75, 1.85, 2.0])

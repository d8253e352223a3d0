"""Counting of free directions: handmade profiles against handmade points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.fidelity.recorded_directions import FreeCounts, count_directions, level_points
from core.frames import R_CAMFRD_OPTICAL
from core.types import CameraInfo, FreeProfile, Intrinsics

WALL_M = 5.0


def profile(from_m: float, to_m: float) -> FreeProfile:
    """Two directions, left and right, and one layer around the camera."""
    return FreeProfile(
        azimuth_edges_rad=np.array([-0.5, 0.0, 0.5], np.float32),
        layer_edges_m=np.array([-0.25, 0.25], np.float32),
        free_from_m=np.full((2, 1), from_m, np.float32),
        free_to_m=np.full((2, 1), to_m, np.float32),
        end=np.zeros((2, 1), np.uint8),
    )


def counted(from_m: float, to_m: float, *points: tuple[float, float, float]) -> FreeCounts:
    return count_directions(np.array(points), profile(from_m, to_m))


LEFT, RIGHT = (WALL_M, -1.0, 0.0), (WALL_M, 1.0, 0.0)


def test_a_direction_with_a_far_point_only_is_truly_free() -> None:
    assert counted(0.5, 4.0, LEFT, RIGHT) == FreeCounts(frames=1, truly_free=2, called=2, wrong=0)


def test_a_direction_without_a_point_is_not_judged() -> None:
    assert counted(0.5, 4.0, LEFT) == FreeCounts(frames=1, truly_free=1, called=1, wrong=0)


def test_free_space_that_ends_too_early_is_not_called_free() -> None:
    assert counted(0.5, 1.9, LEFT, RIGHT).called == 0


def test_a_point_in_the_free_space_is_wrong() -> None:
    counts = counted(0.5, 4.0, LEFT, RIGHT, (1.0, 0.2, 0.0))
    assert (counts.truly_free, counts.called, counts.wrong) == (1, 1, 1)


@pytest.mark.parametrize("point", [(0.4, 0.1, 0.0), (1.0, 0.2, 0.4)])
def test_a_point_before_the_free_space_or_in_another_layer_is_not_wrong(point: tuple[float, float, float]) -> None:
    assert counted(0.5, 4.0, LEFT, RIGHT, point).wrong == 0


def test_pixels_without_a_measurement_are_no_points() -> None:
    depth: NDArray[np.uint16] = np.zeros((16, 16), np.uint16)
    depth[0, 1], depth[8, 0] = 65535, 2000
    info = CameraInfo("front", Intrinsics(16, 16, 16.0, 16.0, 0.0, 0.0), max_range_m=20.0)
    np.testing.assert_allclose(level_points(depth, info, R_CAMFRD_OPTICAL), [[2.0, 0.0, 1.0]])

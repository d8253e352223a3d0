"""Summaries of hand-made rows; free space compared with the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fidelity.free_truth import false_free, in_free
from benchmarks.fidelity.goals import MEASURES, error_ratio, measure, plane_ratio, safe_range_m, summary
from benchmarks.fidelity.metrics import RANGE_BINS, RangeCounts, rays_of
from benchmarks.fidelity.result import Row
from core.types import FreeProfile
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import camera_info, render

from .hand_rows import made


def test_ratios_to_the_grid() -> None:
    row = made(0, mean_m=0.1)
    assert error_ratio(row) == pytest.approx(0.25)
    assert plane_ratio(row) == pytest.approx(0.25)
    assert math.isnan(error_ratio(replace(row, grids=[])))


def test_worst_median_share_of_all_rays_and_how_many_miss_the_goal() -> None:
    rows = [made(0, 1000, missed=0.01), made(1, 3000, missed=0.0), made(2, 1000, missed=0.002)]
    s = summary(measure("missed"), [*rows, made(3, valid=False, missed=0.9), made(4, missed=math.nan)], 0.05)
    assert s is not None
    assert (s.worst, s.where.case.seed, s.median) == (pytest.approx(1.0), 0, pytest.approx(0.2))
    assert s.pooled == pytest.approx(100.0 * (10 + 0 + 2) / 5000)
    assert (s.count, s.over) == (3, 2)
    assert summary(measure("missed"), [made(0, valid=False)]) is None


def test_goals_by_family() -> None:
    ratio = measure("mean error / grid 0.1 m")
    assert (ratio.goal("structured"), ratio.goal("unstructured")) == (0.2, 1.0)
    assert math.isnan(ratio.goal("thin"))
    assert measure("missed").goal("thin") == 0.05
    assert measure("phantom").goal("ground") == 0.5
    assert len({m.name for m in MEASURES}) == len(MEASURES)


def ranged(obstacle: dict[int, int], missed: dict[int, int], phantom: dict[int, int]) -> Row:
    def bins(counts: dict[int, int]) -> list[int]:
        return [counts.get(i, 0) for i in range(RANGE_BINS)]

    by_range = RangeCounts(obstacle=bins(obstacle), missed=bins(missed), phantom=bins(phantom), open_phantom=bins({}))
    return replace(made(0), by_range=by_range)


def test_safe_range_ends_where_rays_up_to_it_miss_the_goal_or_end() -> None:
    near = ranged({4: 10_000, 5: 10_000, 9: 5}, {}, {})
    assert safe_range_m([near]) == 6  # no rays in the seventh metre
    everywhere = dict.fromkeys(range(3, 20), 10000)
    assert safe_range_m([ranged(everywhere, {8: 31}, {})]) == 8  # 31 of 60 000 rays up to 9 m
    assert safe_range_m([ranged(everywhere, {8: 29}, {})]) == 20
    assert safe_range_m([ranged(everywhere, {}, {10: 401})]) == 10  # 401 of 80 000
    assert safe_range_m([ranged(everywhere, {8: 40}, {}), ranged(everywhere, {}, {})]) == 20  # 40 of 120 000
    assert safe_range_m([]) == 0


def profile() -> FreeProfile:
    """One direction from -0.1 to 0.1 rad, one layer from -1 to 1 m, free from 1 to 6 m."""
    one = np.ones((1, 1), np.float32)
    return FreeProfile(
        azimuth_edges_rad=np.array([-0.1, 0.1], np.float32),
        layer_edges_m=np.array([-1.0, 1.0], np.float32),
        free_from_m=one,
        free_to_m=6.0 * one,
        end=np.ones((1, 1), np.uint8),
    )


def test_points_in_what_is_called_free() -> None:
    points = np.array([[3, 0, 0], [3, 0, -1.5], [3, 1, 0], [0.5, 0, 0], [5.8, 0, 0], [6.5, 0, 0], [-3, 0, 0]], float)
    assert in_free(profile(), points, np.zeros(7)).tolist() == [True, False, False, False, True, False, False]
    assert in_free(profile(), points, np.full(7, 0.5)).tolist() == [True] + [False] * 6


def test_an_obstacle_in_claimed_free_space_is_found() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("wall", (5.0, -9.0), (5.0, 9.0), 9.0)
    frame = render(b.build(), camera_info(160, 120))
    rays = rays_of(frame, 0.0015)
    points = frame.truth.points_level_cam_m
    inside = (np.abs(points[..., 2]) < 1.0) & (np.abs(np.arctan2(points[..., 1], points[..., 0])) < 0.1)
    expected = (inside & rays.obstacle).sum() / rays.obstacle.sum()
    assert false_free(profile(), rays, points) == pytest.approx(expected, rel=0.05)
    shorter = replace(profile(), free_to_m=np.full((1, 1), 5.3, np.float32))
    assert false_free(shorter, rays, points) == 0.0  # the wall lies less than 0.5 m before its end

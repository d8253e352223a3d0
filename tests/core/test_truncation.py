"""A surface just before the range clip stands where it is, not where the near half of its noise is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.stages import strips as s
from core.stages.truncation import MEANS_LEFT, correct_truncation, untruncated_mean
from core.stages.view_geometry import SOURCE

from .columns import F
from .tables import Strips

pytestmark = pytest.mark.nojit
LEVEL = np.array([1.0, 0.0, 0.0])


def mean_left(whole: float) -> float:
    """Mean of what is left above 0 of a normal distribution about `whole`, by sums over small steps."""
    x = np.linspace(0.0, whole + 10.0, 200_001) if whole > -9.0 else np.array([0.0])
    weight = np.exp(-0.5 * (x - whole) ** 2)
    return float((x * weight).sum() / weight.sum())


@pytest.mark.parametrize("whole", [-0.9, -0.3, 0.0, 0.4, 1.0, 2.0, 3.0])
def test_the_mean_of_the_whole_from_that_of_what_is_left(whole: float) -> None:
    assert untruncated_mean(mean_left(whole), MEANS_LEFT) == pytest.approx(whole, abs=0.005)


def test_less_than_any_half_can_leave_is_the_least() -> None:
    assert untruncated_mean(0.0, MEANS_LEFT) == -1.0
    assert untruncated_mean(MEANS_LEFT[-1], MEANS_LEFT) == pytest.approx(3.5)


def source(axis: np.ndarray, clear_m: float) -> np.ndarray:
    return np.array([(60, 100, axis[0], axis[2], clear_m, 20.0, 0.3)], SOURCE)[0]


def moved(x_m: float, ke: float, clear_m: float, axis: np.ndarray = LEVEL, kind: int = s.SMOOTH) -> tuple[float, float]:
    """Where a strip at x_m and its near edge come to stand."""
    t = Strips()
    t.add(20, 10, 80, x_m, near_m=x_m - 0.1)
    t.build()
    t.strips["kind"][0] = kind
    correct_truncation(t.strips, t.n, t.view, source(axis, clear_m), ke)
    return F / float(t.strips["disparity_px"][0]), F / float(t.strips["near_px"][0])


@pytest.mark.parametrize("true_m", [10.0, 12.0, 13.0, 14.0, 15.0])
def test_a_wall_before_the_clip_comes_back_from_noisy_pixels(true_m: float) -> None:
    ke, clear_m = 0.005, 20.0 / 1.3
    inverse = 1.0 / true_m + ke * np.random.default_rng(5).standard_normal(20_000)
    left = inverse[inverse > 1.0 / clear_m]
    x, _ = moved(1.0 / left.mean(), ke, clear_m)
    assert x == pytest.approx(true_m, abs=0.05)
    if true_m >= 14.0:
        assert 1.0 / left.mean() < true_m - 0.15  # without it


def test_nothing_moves_beyond_the_clip_nor_nearer_and_far_from_it_nothing_moves() -> None:
    clear_m = 15.0
    for x_m in np.linspace(3.0, 14.999, 60):
        x, near = moved(float(x_m), 0.005, clear_m)
        assert x_m - 1e-4 <= x <= clear_m + 1e-4
        assert near < x
    assert moved(6.0, 0.005, clear_m) == pytest.approx((6.0, 5.9))


@pytest.mark.parametrize("kind", [s.ROUGH, s.IRREGULAR, s.MERGED])
def test_what_is_no_smooth_surface_stays(kind: int) -> None:
    """Its noise is not normal: a near side is no mean."""
    assert moved(14.0, 0.005, 15.0, kind=kind)[0] == pytest.approx(14.0)


def test_the_clip_is_one_of_depth_along_the_tilted_axis() -> None:
    pitch = math.radians(30.0)
    axis = np.array([math.cos(pitch), 0.0, math.sin(pitch)])  # nose down: the clip is nearer below, farther above
    t = Strips()
    t.add(20, 10, 14, 16.0)
    t.add(30, 80, 84, 12.0)
    t.build()
    per_forward = [
        axis[0] + axis[2] * 0.5 * float(t.view.tan_edge[r["top_row"]] + t.view.tan_edge[r["bottom_row"] + 1])
        for r in t.strips
    ]
    true_m = [0.97 * 15.0 / w for w in per_forward]  # as near to the clip along the axis
    left = [
        1.0 / m + 0.005 * w * (mean_left(_sigmas(w, m)) - _sigmas(w, m))
        for w, m in zip(per_forward, true_m, strict=True)
    ]
    t.strips["disparity_px"] = F * np.array(left)
    t.strips["near_px"] = t.strips["disparity_px"]
    correct_truncation(t.strips, t.n, t.view, source(axis, 15.0), 0.005)
    np.testing.assert_allclose(F / t.strips["disparity_px"], true_m, rtol=2e-3)


def _sigmas(per_forward: float, true_m: float) -> float:
    """How many sigma of its noise a surface stands before the clip at 15 m of depth, ke 0.005."""
    return (1.0 / true_m - per_forward / 15.0) / (0.005 * per_forward)

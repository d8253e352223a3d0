"""An error of the calibration that all depths share: no frame shows it, so margins and free space contain it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.stages.depth_bias import DepthBias, shorten_by_bias
from core.types import MOST_BIAS_PER_M, FrameModel, FreeEnd, FreeProfile
from drivers.simulation.scenes import SceneBuilder

from .views import INFO, VIEW, extract, flat_wall, level, seen

BIAS_PER_M = 0.004


def biased(depth_mm: NDArray[np.uint16], bias_per_m: float) -> NDArray[np.uint16]:
    """The image of a camera that measures every disparity too small, by bias_per_m in 1/Z."""
    with np.errstate(divide="ignore"):
        inverse = 1000.0 / depth_mm - bias_per_m
    good = (depth_mm > 0) & (inverse > 1.0 / 60.0)
    return np.where(good, np.rint(1000.0 / np.where(good, inverse, 1.0)), 0.0).astype(np.uint16)


def nearest_m(model: FrameModel) -> float:
    """Distance of the nearest plane across the heading, less its margin."""
    return float((model.planes[:, [0, 2]].min(axis=1) - model.margin_m).min())


@pytest.mark.parametrize("distance_m", [3.0, 6.0, 10.0])
def test_a_wall_that_is_measured_too_far_is_within_its_margin(distance_m: float) -> None:
    depth_mm = biased(flat_wall(VIEW, distance_m), BIAS_PER_M)
    unaware = extract(depth_mm, VIEW, level())
    assert nearest_m(unaware) > distance_m  # this is what the bias is for
    aware = extract(depth_mm, replace(VIEW, bias_per_m=BIAS_PER_M), level())
    assert nearest_m(aware) <= distance_m
    assert nearest_m(aware) == pytest.approx(distance_m, abs=0.05 + 0.1 * BIAS_PER_M * distance_m**2)


def test_free_space_before_a_wall_that_is_measured_too_far_ends_before_it() -> None:
    """Free ranges end at whole rings of 0.5 m: that at 10 m lies behind the wall and before what is measured of it."""
    depth_mm = biased(flat_wall(VIEW, 9.9), BIAS_PER_M)
    info = replace(VIEW, bias_per_m=BIAS_PER_M)
    for camera, wrong in ((VIEW, True), (info, False)):
        free = extract(depth_mm, camera, level()).free
        stopped = (free.end == FreeEnd.OBSTACLE) & (free.free_to_m > free.free_from_m)
        assert stopped.any()
        beyond = (free.free_to_m > 9.9 / np.cos(inner_edge_rad(free))[:, None] + 1e-3) & stopped
        assert bool(beyond.any()) is wrong


def inner_edge_rad(free: FreeProfile) -> NDArray[np.float64]:
    """(D,) the azimuth of each direction that is nearest to the heading, by its size."""
    first, last = free.azimuth_edges_rad[:-1].astype(float), free.azimuth_edges_rad[1:].astype(float)
    return np.where(first * last < 0.0, 0.0, np.minimum(np.abs(first), np.abs(last)))


def corridor_view() -> NDArray[np.uint16]:
    """Two long walls at 2 m on either side."""
    s = SceneBuilder("corridor")
    for y in (-2.0, 2.0):
        s.wall("wall", (-5.0, y), (40.0, y), 6.0, base=-3.0)
    return seen(s).depth_mm


def test_a_wall_beside_the_way_gets_the_error_across_it_not_along_the_ray() -> None:
    """At 15 m the bias is 0.9 m along the ray, but 0.12 m across the wall: the passage stays open."""
    depth_mm, info = corridor_view(), replace(VIEW, bias_per_m=BIAS_PER_M)
    without, model = extract(depth_mm, VIEW, level()), extract(depth_mm, info, level())
    np.testing.assert_array_equal(model.planes, without.planes)
    long = np.abs(model.planes[:, 0] - model.planes[:, 2]) > 4.0
    assert long.any()
    ax, ay, bx, by = model.planes[long][:, :4].astype(float).T
    across_m = np.abs(ax * by - ay * bx) / np.hypot(bx - ax, by - ay)
    far_m = np.maximum(ax, bx)
    added = (model.margin_m - without.margin_m)[long]
    assert added == pytest.approx(BIAS_PER_M * far_m * across_m, rel=0.01)
    assert (added < 0.25 * BIAS_PER_M * far_m**2)[far_m > 10.0].all()
    assert (far_m > 10.0).any()


def test_free_space_beside_a_wall_that_is_measured_too_far_ends_before_it() -> None:
    free = extract(biased(corridor_view(), BIAS_PER_M), replace(VIEW, bias_per_m=BIAS_PER_M), level()).free
    wall_m = 2.0 / np.maximum(np.sin(inner_edge_rad(free)), 1e-6)
    seen_wall = wall_m < 15.0
    assert (free.free_to_m > free.free_from_m)[seen_wall].any()
    assert (free.free_to_m <= wall_m[:, None] + 1e-3)[seen_wall].all()


def test_without_a_bias_nothing_changes() -> None:
    layers = np.array([-0.5, 0.0, 0.5, 1.0], np.float32)
    free_to = np.array([[3.0, np.inf, 0.0]], np.float32)
    shorten_by_bias(DepthBias(0.0, 1.0, 0.0), layers, free_to)
    assert free_to.tolist() == [[3.0, math.inf, 0.0]]
    free_to = np.array([[3.0, 8.0, 0.0]], np.float32)
    shorten_by_bias(DepthBias(0.01, 1.0, 0.0), layers, free_to)
    assert free_to[0].tolist() == pytest.approx([3.0 / 1.03, 8.0 / 1.08, 0.0])


@pytest.mark.parametrize("pitch_deg", [-30.0, -20.0, 20.0])
@pytest.mark.parametrize("distance_m", [4.0, 8.0])
def test_a_tilted_camera_has_the_error_of_the_depth_not_of_the_forward_distance(
    pitch_deg: float, distance_m: float
) -> None:
    """Below a camera that looks down the depth of a wall is greater than its forward distance."""
    pitch = math.radians(pitch_deg)
    bias_per_m = 2.0 * BIAS_PER_M
    depth_mm = biased(flat_wall(VIEW, distance_m, pitch), bias_per_m)
    info = replace(VIEW, bias_per_m=bias_per_m)
    model = extract(depth_mm, info, level(pitch))
    truth = distance_m + 0.01  # steps of a millimetre in depth, half a pixel of a levelled cell
    assert nearest_m(extract(depth_mm, VIEW, level(pitch))) > truth
    for plane, margin_m in zip(model.planes, model.margin_m, strict=True):
        assert min(plane[0], plane[2]) - margin_m <= truth
    free = model.free
    stopped = (free.end == FreeEnd.OBSTACLE) & (free.free_to_m > free.free_from_m)
    assert (
        free.free_to_m[stopped] <= (truth / np.cos(inner_edge_rad(free))[:, None] * np.ones_like(stopped))[stopped]
    ).all()


@pytest.mark.parametrize("bias_per_m", [-0.001, MOST_BIAS_PER_M + 0.001, math.nan, math.inf])
def test_an_impossible_bias_is_refused_with_its_range(bias_per_m: float) -> None:
    with pytest.raises(ValueError, match=r"bias_per_m=.*, expected 0..0.3"):
        replace(INFO, bias_per_m=bias_per_m)

"""Sectors of the obstacle message: which of them are clear, unseen, or hold an obstacle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.polar_histogram import SECTORS, SectorState, scan, segment_distances
from companion.autopilot.view_free import View, above_ground_share, ended_by_obstacle, points_free
from companion.pipeline.transform import LevelTransform
from core.types import FrameModel, FreeEnd, FreeProfile, Ground

from ..sector_models import AVOID, HERE, model, wall_at


@pytest.mark.parametrize(("beyond_m", "steps"), [(-0.1, None), (0.05, 0), (0.2, 0), (0.3, 1), (0.45, 1), (0.55, 2)])
def test_free_space_reaches_to_the_last_sample_that_is_free(beyond_m: float, steps: int | None) -> None:
    """Samples begin at near_m. beyond_m: free range less near_m; steps: from near_m on; None: nothing is free."""
    found = scan([View(model(free_to_m=AVOID.near_m + beyond_m), HERE)], AVOID)
    want_m = 0.0 if steps is None else AVOID.near_m + steps * AVOID.step_m
    np.testing.assert_allclose(found.free_m, want_m)


def test_the_heights_of_the_band_are_the_middles_of_its_slices() -> None:
    avoid = replace(AVOID, slices=4, band_above_m=1.0, band_below_m=0.6)
    heights: set[float] = set()

    def recall(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        heights.update(np.round(z, 6).tolist())
        return np.zeros(len(x), bool)

    found = scan(
        [View(model(free_to_m=13.0, view_deg=72.0), HERE)], avoid, recall
    )  # two thirds of the sectors at its border
    assert heights == {-0.8, -0.4, 0.0, 0.4}
    assert found.state[0] == SectorState.CLEAR


@pytest.mark.parametrize(
    ("ends_m", "to_deg", "ends_at", "state"),
    [
        (4.0, 3.0, FreeEnd.OBSTACLE, "CLEAR"),
        (8.0, 3.0, FreeEnd.OBSTACLE, "UNSEEN"),
        (4.0, 7.0, FreeEnd.OBSTACLE, "UNSEEN"),
        (4.0, 3.0, FreeEnd.UNKNOWN, "UNSEEN"),
    ],
)
def test_a_sector_beside_a_plane_is_clear_only_where_the_profile_ends_at_that_plane(
    ends_m: float, to_deg: float, ends_at: FreeEnd, state: str
) -> None:
    """The profile of sector 1 ends from its border on, at the pole's distance or farther."""
    found = model(wall_at(0.0, 4.0), free_to_m=13.0, view_deg=72.0)
    free_to, end = found.free.free_to_m.copy(), found.free.end.copy()
    edges_deg = np.degrees(found.free.azimuth_edges_rad)
    at_pole = (edges_deg[:-1] < 1.0) & (edges_deg[1:] > -1.0)
    beside = (edges_deg[:-1] > 1.0) & (edges_deg[:-1] < to_deg)
    free_to[at_pole], free_to[beside] = 4.0, ends_m
    end[at_pole], end[beside] = FreeEnd.OBSTACLE, ends_at
    found = replace(found, free=replace(found.free, free_to_m=free_to, end=end))
    sectors = scan([View(found, HERE)], AVOID)
    assert sectors.state[0] == SectorState.OBSTACLE
    assert sectors.state[1] == SectorState[state]


@pytest.mark.parametrize("along_rays", [True, False])
def test_a_range_is_free_from_its_begin_to_its_end(along_rays: bool) -> None:
    """Through what was seen free, the way there was seen free, but only if the ray is followed."""
    at_m = np.array([1.4, 1.6, 3.9, 4.1])
    free = points_free(View(model(free_to_m=4.0), HERE), at_m, np.zeros(4), np.zeros(1), along_rays=along_rays)
    assert free[0].tolist() == [along_rays, True, True, False]


def test_from_within_the_margin_of_the_ground_only_rising_rays_stay_above_it() -> None:
    """As of a vehicle that stands, with a camera 0.1 m above the ground."""
    view = View(replace(model(free_to_m=4.0), ground=Ground(seen=True, height_m=0.1, tolerance_m=0.25)), HERE)
    x, y = np.array([5.0]), np.zeros(1)
    assert [float(above_ground_share(view, x, y, z, x)[0]) for z in (-1.0, 0.0, 1.0)] == [math.inf, 0.0, 0.0]


def test_heights_outside_of_the_profile_do_not_end_at_its_obstacles() -> None:
    """Nothing was looked for there."""
    found = model(free_to_m=4.0)
    found = replace(found, free=replace(found.free, end=np.full((36, 3), FreeEnd.OBSTACLE, np.uint8)))
    z, at_m = np.array([-3.5, -2.5, 0.0, 2.5, 3.5]), np.full(5, 5.0)
    ended = ended_by_obstacle(View(found, HERE), at_m, np.zeros(5), z, np.ones(5))
    assert ended.tolist() == [False, True, True, True, False]


def test_a_ray_beside_a_plane_that_meets_the_ground_does_not_count() -> None:
    """Rising ground takes the two lowest heights of sector 1, one of them at the distance of the pole in sector 0. A ray at
    the border that ends there has met the ground, not the pole: the height was seen in no ray, and the sector is not clear."""
    found = model(wall_at(0.0, 4.0), free_to_m=13.0, view_deg=72.0)
    free_to, end = found.free.free_to_m.copy(), found.free.end.copy()
    edges_deg = np.degrees(found.free.azimuth_edges_rad)
    at_pole = (edges_deg[:-1] < 1.0) & (edges_deg[1:] > -1.0)
    free_to[at_pole], end[at_pole] = 4.0, FreeEnd.OBSTACLE
    found = replace(found, free=replace(found.free, free_to_m=free_to, end=end))
    assert scan([View(found, HERE)], AVOID).state[1] == SectorState.CLEAR
    rising = Ground(seen=True, height_m=0.87, slope_x=-0.015, tolerance_m=0.25)
    sectors = scan([View(replace(found, ground=rising), HERE)], AVOID)
    assert sectors.state[1] == SectorState.UNSEEN
    assert sectors.lacking[1, -2].all()


@given(st.integers(0, 2**32 - 1))
def test_segments_against_walking_along_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-8.0, 8.0, (1, 2)), rng.uniform(-8.0, 8.0, (1, 2))
    along = a + np.linspace(0.0, 1.0, 20_001)[:, None] * (b - a)
    azimuth, distance = np.arctan2(along[:, 1], along[:, 0]), np.hypot(along[:, 0], along[:, 1])
    expected, least = np.full(SECTORS, np.inf), np.full(SECTORS, np.inf)
    np.minimum.at(expected, np.round(azimuth / math.radians(5.0)).astype(int) % SECTORS, distance)
    for beside in (-1.1e-3, 0.0, 1.1e-3):  # sectors overlap by a hair
        np.minimum.at(least, np.round((azimuth + beside) / math.radians(5.0)).astype(int) % SECTORS, distance)
    found = segment_distances(a, b)[0][0]
    hit = np.isfinite(expected)
    assert np.isfinite(found[hit]).all()  # nothing is lost
    assert (found[hit] <= expected[hit] + 1e-6).all()
    assert (found >= least - 1e-2).all()


def test_a_plane_through_the_vehicle_is_at_no_distance() -> None:
    found = segment_distances(np.array([[-1.0, 0.0]]), np.array([[1.0, 0.0]]))[0][0]
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert found[36] == pytest.approx(0.0, abs=1e-9)


def test_only_what_reaches_into_the_band_counts() -> None:
    low = (5.0, -1.0, 5.0, 1.0, AVOID.band_below_m + 0.1, 4.0)
    high = (5.0, -1.0, 5.0, 1.0, -4.0, -AVOID.band_above_m - 0.1)
    beam = (5.0, -1.0, 5.0, 1.0, -AVOID.band_above_m - 1.0, -AVOID.band_above_m + 0.01)
    stump = (5.0, -1.0, 5.0, 1.0, AVOID.band_below_m - 0.01, 4.0)
    assert np.isinf(scan([View(model(low, high), HERE)], AVOID).distance_m).all()
    for plane in (beam, stump):
        assert scan([View(model(plane, free_to_m=4.5), HERE)], AVOID).state[0] == SectorState.OBSTACLE


def test_margin_and_radius_come_off_the_distance() -> None:
    found = scan([View(model(wall_at(0.0, 5.0), margin=0.5), HERE)], AVOID)
    assert found.distance_m[0] == pytest.approx(5.0 - 0.5 - 0.3, abs=1e-6)


def test_what_was_seen_free_to_the_end_is_clear_and_nothing_else_is() -> None:
    found = scan([View(model(free_to_m=13.0, view_deg=80.0), HERE)], AVOID)
    degrees = np.arange(SECTORS) * 5.0
    away = np.minimum(degrees, 360.0 - degrees)
    assert (found.state[away <= 35.0] == SectorState.CLEAR).all()
    assert (found.state[away >= 45.0] == SectorState.UNSEEN).all()


@pytest.mark.parametrize("free_to_m", [0.0, 1.0, 6.0, 11.9])
def test_free_but_not_to_the_end_is_not_clear(free_to_m: float) -> None:
    found = scan([View(model(free_to_m=free_to_m), HERE)], AVOID)
    assert (found.state == SectorState.UNSEEN).all()
    assert (found.free_m <= free_to_m).all()
    assert found.free_m[0] >= (free_to_m - AVOID.step_m if free_to_m > AVOID.near_m else 0.0)


@pytest.mark.parametrize(("free_from_m", "clear"), [(2.0, True), (4.0, True), (5.0, False), (8.0, False)])
def test_what_was_seen_through_from_afar_on_was_seen_through_on_the_way(free_from_m: float, clear: bool) -> None:
    """A layer of 2 m wholly in view from 4 m on was seen 1.25 m high at 2.5 m, which is enough of the band; from 5 m on,
    1 m, which is not."""
    whole = model(free_to_m=13.0)
    begins, ends = np.zeros((36, 3), np.float32), np.zeros((36, 3), np.float32)
    begins[:, 1], ends[:, 1] = free_from_m, 13.0
    later = replace(whole, free=replace(whole.free, free_from_m=begins, free_to_m=ends))
    found = scan([View(later, HERE)], AVOID)
    assert (found.state == (SectorState.CLEAR if clear else SectorState.UNSEEN)).all()
    ended = replace(later.free, free_to_m=begins)
    found = scan([View(replace(later, free=ended), HERE)], AVOID)
    assert (found.free_m == 0.0).all()  # nothing was seen free


def test_a_ray_may_leave_by_the_layer_below() -> None:
    """Of the middle layer all is in view from 6 m on, of the lower one from 2 m on: a camera that looks down. What lies low
    and near is then seen through the lower one."""
    whole = model(free_to_m=13.0)
    begins = np.tile(np.array([20.0, 6.0, 2.0], np.float32), (36, 1))
    later = replace(whole, free=replace(whole.free, free_from_m=begins, free_to_m=np.full((36, 3), 13.0, np.float32)))
    free = points_free(View(later, HERE), np.array([2.5]), np.array([0.0]), np.array([-0.72, -0.3, 0.3, 0.72]), True)
    assert free[:, 0].tolist() == [False, True, True, True]
    blocked = replace(later.free, free_to_m=np.tile(np.array([20.0, 13.0, 2.2], np.float32), (36, 1)))
    free = points_free(
        View(replace(later, free=blocked), HERE), np.array([2.5]), np.array([0.0]), np.array([0.72]), True
    )
    assert not free.any()  # the lower layer ends before the ray comes to it


def over_ground(
    height_m: float, noise_per_m: float = 0.0, tolerance_m: float = 0.25, slope_x: float = 0.0
) -> FrameModel:
    """The lower layer, 1 to 3 m below the camera, is free from 8 m on: as far down as the ground lets it be judged."""
    whole = model(free_to_m=13.0)
    begins = np.tile(np.array([20.0, 20.0, 8.0], np.float32), (36, 1))
    ground = Ground(seen=True, height_m=height_m, slope_x=slope_x, tolerance_m=tolerance_m, noise_per_m=noise_per_m)
    return replace(whole, free=replace(whole.free, free_from_m=begins), ground=ground)


def test_a_ray_that_ends_on_the_ground_shows_nothing_behind_it() -> None:
    """The ray to 0.9 m down at 3 m meets the ground, 1.6 m down, at 5.3 m; the lower layer was seen free from 8 m on only,
    where the same ray would run below the ground."""
    x, y, z = np.array([3.0, 6.0]), np.zeros(2), np.array([0.9])
    assert points_free(View(over_ground(9.0), HERE), x, y, z, True).tolist() == [[True, True]]
    assert points_free(View(over_ground(1.6), HERE), x, y, z, True).tolist() == [[False, True]]
    # of rising ground the second ray, 1.2 m down at 8 m, comes too near as well
    assert points_free(View(over_ground(1.6, slope_x=-0.05), HERE), x, y, z, True).tolist() == [[False, False]]


def test_what_lies_within_the_noise_of_the_ground_is_not_free() -> None:
    """The profile does not judge heights within the noise of the ground, nor within its tolerance."""
    x, y, z = np.array([10.0]), np.zeros(1), np.array([1.1, 1.4, 1.8])
    assert points_free(View(over_ground(2.0), HERE), x, y, z)[:, 0].tolist() == [True, True, False]
    assert points_free(View(over_ground(2.0, 0.07), HERE), x, y, z)[:, 0].tolist() == [True, False, False]
    assert points_free(View(over_ground(2.0, 0.0, 0.65), HERE), x, y, z)[:, 0].tolist() == [True, False, False]


@given(
    st.floats(1.0, 12.0), st.floats(-0.8, 0.8), st.floats(0.5, 8.0), st.floats(0.5, 13.0), st.sampled_from([0, 1, 2])
)
def test_seen_through_against_walking_along_the_ray(
    range_m: float, height_m: float, begins_m: float, ends_m: float, row: int
) -> None:
    whole = model(free_to_m=13.0)
    begins, ends = np.zeros((36, 3), np.float32), np.zeros((36, 3), np.float32)
    begins[:, row], ends[:, row] = begins_m, ends_m
    view = View(replace(whole, free=replace(whole.free, free_from_m=begins, free_to_m=ends)), HERE)
    free = bool(points_free(view, np.array([range_m]), np.array([0.0]), np.array([height_m]), True)[0, 0])
    on = np.linspace(range_m, 20.0, 40_001)
    height = height_m * on / range_m
    top, bottom = view.model.free.layer_edges_m[row : row + 2]
    through = [
        ((height >= top - e) & (height <= bottom + e) & (on >= begins_m - e) & (on <= ends_m + e)).any()
        for e in (-1e-3, 1e-3)
    ]  # within by a hair, and beyond by a hair
    assert free or not through[0]
    assert through[1] or not free


def test_height_counts_from_the_camera() -> None:
    """The same layer, of a camera 0.6 m above the vehicle's middle: at 2.5 m its rays are too high."""
    whole = model(free_to_m=13.0)
    to = np.zeros((36, 3), np.float32)
    to[:, 1] = 13.0
    free = replace(whole.free, free_from_m=np.full((36, 3), 3.5, np.float32), free_to_m=to)
    higher = replace(free, layer_edges_m=free.layer_edges_m - np.float32(0.6))
    above = View(replace(whole, free=higher), LevelTransform(0.0, (0.0, 0.0, -0.6)))
    assert (scan([above], AVOID).state == SectorState.UNSEEN).all()
    assert (scan([View(replace(whole, free=free), HERE)], AVOID).state == SectorState.CLEAR).all()


def test_an_invalid_model_reports_nothing() -> None:
    blind = replace(model(wall_at(0.0, 5.0), free_to_m=13.0), valid=False)
    found = scan([View(blind, HERE)], AVOID)
    assert (found.state == SectorState.UNSEEN).all()
    assert (scan([], AVOID).state == SectorState.UNSEEN).all()


def test_a_band_seen_in_part_is_not_clear() -> None:
    """A third of the height unseen is more than the share that may be."""
    whole = model(free_to_m=13.0)
    layers = np.array([-3.0, -0.27, 1.0, 3.0], np.float32)
    to = whole.free.free_to_m.copy()
    to[:, 0] = 0.0
    part = replace(whole, free=replace(whole.free, layer_edges_m=layers, free_to_m=to))
    assert (scan([View(part, HERE)], AVOID).state == SectorState.UNSEEN).all()


def seen_but_at(*unseen: int) -> View:
    """A view that is free to 13 m all around in layers as high as the slices of the band, 0.16 m, but for these layers."""
    free_to = np.full((36, 10), 13.0, np.float32)
    free_to[:, list(unseen)] = 0.0
    profile = FreeProfile(
        azimuth_edges_rad=np.linspace(-math.pi, math.pi, 37).astype(np.float32),
        layer_edges_m=np.linspace(-0.8, 0.8, 11).astype(np.float32),
        free_from_m=np.where(free_to > 0.0, 1.5, 0.0).astype(np.float32),
        free_to_m=free_to,
        end=np.full((36, 10), FreeEnd.MAX_RANGE, np.uint8),
    )
    return View(replace(model(wall_at(0.0, 8.0)), free=profile), HERE)


@pytest.mark.parametrize(
    ("unseen", "seen"),
    [((), True), ((0,), True), ((0, 9), True), ((0, 1), False), ((8, 9), False), ((4,), False), ((4, 5), False)],
)
def test_only_the_outermost_height_of_the_band_may_be_unseen_over_a_whole_sector(
    unseen: tuple[int, ...], seen: bool
) -> None:
    """Without two of ten heights 80 % of the rays are left."""
    clear = scan([seen_but_at(*unseen)], AVOID).state[5:-5]
    assert (clear == (SectorState.CLEAR if seen else SectorState.UNSEEN)).all()
    every = scan([seen_but_at(*unseen)], replace(AVOID, clear_share=1.0)).state[5:-5]
    assert (every == (SectorState.UNSEEN if unseen else SectorState.CLEAR)).all()


@pytest.mark.parametrize(("unseen", "state"), [(range(5), "CLEAR"), (range(7), "UNSEEN"), (range(10), "UNSEEN")])
def test_earlier_free_space_completes_only_a_sector_of_which_enough_is_seen_now(unseen: range, state: str) -> None:
    """All of the rest was seen free before."""
    found = scan([seen_but_at(*unseen)], AVOID, recall=lambda x, y, z: np.ones(len(x), bool))
    assert (found.state[5:-5] == SectorState[state]).all()


@pytest.mark.parametrize(("unseen", "state"), [((0,), "OBSTACLE"), ((0, 1), "UNSEEN"), ((8, 9), "UNSEEN")])
def test_the_way_to_an_obstacle_is_seen_at_the_same_heights(unseen: tuple[int, ...], state: str) -> None:
    assert SectorState(scan([seen_but_at(*unseen)], AVOID).state[0]).name == state


def test_two_cameras_together_see_more_and_an_obstacle_of_either_counts() -> None:
    right = LevelTransform(math.pi / 2, (0.0, 0.0, 0.0))
    first = model(free_to_m=13.0, view_deg=80.0)
    second = model(wall_at(90.0, 4.0), free_to_m=13.0, view_deg=80.0)
    turned = replace(second.free, azimuth_edges_rad=second.free.azimuth_edges_rad + np.float32(math.pi / 2))
    found = scan([View(first, HERE), View(replace(second, free=turned), right)], AVOID)
    assert found.state[0] == SectorState.CLEAR
    assert found.state[18] == SectorState.OBSTACLE
    assert found.state[12] == SectorState.CLEAR
    assert found.state[36] == SectorState.UNSEEN


def test_free_seen_from_another_place_is_looked_up_from_there() -> None:
    """The camera stood 3 m behind: what it saw free to 13 m ends at 10 m from here, ahead and not behind."""
    behind = LevelTransform(0.0, (-3.0, 0.0, 0.0))
    found = scan([View(model(free_to_m=13.0, view_deg=80.0), behind)], AVOID)
    assert found.state[0] == SectorState.UNSEEN
    assert found.free_m[0] == pytest.approx(10.0, abs=AVOID.step_m)

"""The ground of analytic pictures, with tilts and slopes; and pictures that only seem to show one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import strips as strip_table
from core.stages.ground import (
    NO_GROUND,
    POINT,
    GroundCamera,
    GroundSamples,
    find_ground,
    ground_settings,
    height_bins,
    vote,
)
from core.stages.ground_threshold import drop_ground_noise, ground_limit, ground_threshold
from core.stages.settings import view_settings
from core.stages.view_geometry import view_geometry
from core.types import FAR_MM, CameraInfo, FreeEnd, Ground, Intrinsics
from drivers.simulation.source import camera_info

from . import naive
from .columns import view as level_view
from .views import VIEW, extract, flat_wall, level, marks_of, noisy, pixel_grid, to_mm

P = Params()


def ground_image(
    info: CameraInfo, height_m: float, pitch: float = 0.0, roll: float = 0.0, slope_x: float = 0.0, slope_y: float = 0.0
) -> np.ndarray:
    """Depth of the plane z = height + slope_x x + slope_y y in level_cam."""
    k, R = info.intrinsics, level(pitch, roll)
    u, v = pixel_grid(k)
    x, y, z = np.moveaxis(np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ R.T, -1, 0)
    with np.errstate(divide="ignore"):
        depth = height_m / (z - slope_x * x - slope_y * y)
    return to_mm(np.where((depth > 0) & (depth < info.max_range_m), depth, np.inf))


def find(
    depth: np.ndarray, info: CameraInfo, R: np.ndarray, ke: float = 0.0015, seed: float = math.nan, p: Params = P
) -> Ground:
    return find_ground(marks_of(depth, info, ke), info, R, ke, seed, p, np.zeros(p.ground_max_samples, POINT))


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (-0.5, 0.0), (0.2, 0.0), (-0.2, 0.5), (-0.17, -0.17)])
@pytest.mark.parametrize("height", [0.5, 1.2, 2.0])
def test_flat_ground_is_recovered(pitch: float, roll: float, height: float) -> None:
    depth = noisy(ground_image(VIEW, height, pitch, roll), 0.0015, 1)
    g = find(depth, VIEW, level(pitch, roll))
    assert g.seen
    assert g.height_m == pytest.approx(height, rel=0.02)
    assert math.hypot(g.slope_x, g.slope_y) < 0.012
    assert g.share > 0.8
    assert g.blind_beyond_m == pytest.approx(P.min_obstacle_height_m / (P.ground_sigmas * 0.0015 * g.height_m))


@pytest.mark.parametrize("ke", [0.0015, 0.005])
@pytest.mark.parametrize("pitch", [-0.15, 0.0, 0.15])
@pytest.mark.parametrize("height", [0.05, 0.06, 0.08, 0.1, 0.12])
def test_a_floor_a_few_centimetres_under_the_camera_is_the_ground(height: float, pitch: float, ke: float) -> None:
    """A small vehicle before take-off: its floor must not come out as a wall."""
    g = find(noisy(ground_image(VIEW, height, pitch), ke, 1), VIEW, level(pitch), ke)
    assert g.seen
    assert g.height_m == pytest.approx(height, abs=0.01)


@pytest.mark.parametrize("ke", [0.0015, 0.005])
@pytest.mark.parametrize("distance_m", [0.4, 0.7, 1.5, 6.0])
def test_the_rows_of_a_wall_just_below_the_horizon_are_no_floor(distance_m: float, ke: float) -> None:
    for seed in range(5):
        assert find(noisy(flat_wall(VIEW, distance_m), ke, seed), VIEW, level(), ke) is NO_GROUND


@pytest.mark.parametrize(("slope_x", "slope_y"), [(0.03, 0.0), (-0.03, 0.02), (0.0, -0.04)])
def test_sloping_ground_is_recovered_with_its_signs(slope_x: float, slope_y: float) -> None:
    g = find(ground_image(VIEW, 2.0, -0.3, 0.1, slope_x, slope_y), VIEW, level(-0.3, 0.1))
    assert g.seen
    assert (g.slope_x, g.slope_y) == pytest.approx((slope_x, slope_y), abs=0.006)
    assert g.height_m == pytest.approx(2.0, abs=0.05)


def test_a_missing_ground_is_reported() -> None:
    wall = flat_wall(VIEW, 6.0)
    assert find(wall, VIEW, level()) is NO_GROUND
    assert find(np.zeros_like(wall), VIEW, level()) is NO_GROUND
    steep = ground_image(VIEW, 2.0, -0.3, 0.0, slope_x=-0.4)  # a ramp of 22 degrees is an obstacle
    got = find(steep, VIEW, level(-0.3))
    assert not got.seen or abs(got.slope_x) <= P.ground_max_slope + 1e-9


def test_a_table_with_the_floor_below_it_is_not_the_ground() -> None:
    """A large table top at 0.8 m below the camera over a floor at 1.6 m of which more than 5 % is seen."""
    info = camera_info(320, 240, ke_per_m=0.0015)
    floor, table = ground_image(info, 1.6, -0.5), ground_image(info, 0.8, -0.5)
    depth = floor.copy()
    depth[60:, 40:280] = table[60:, 40:280]
    g = find(depth, info, level(-0.5))
    assert g.seen
    assert g.height_m == pytest.approx(1.6, abs=0.05)


def wall_over_two_floors() -> np.ndarray:
    """A wall 4 m ahead, and in a few columns below it a floor at 2 m and one at 1.5 m, which has a few more pixels.

    Each may be the ground, since less than 5 % of the pixels lie below the upper one."""
    k, R = VIEW.intrinsics, level(-0.4)
    u, v = pixel_grid(k)
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ R.T
    depth, below = flat_wall(VIEW, 4.0, -0.4), rays[..., 2] > 0.3 * rays[..., 0]
    depth[below] = 0
    for columns, height in (((u >= 20) & (u < 30) & (v < 200), 2.0), ((u >= 260) & (u < 270), 1.5)):
        depth[below & columns] = ground_image(VIEW, height, -0.4)[below & columns]
    return depth


def test_the_last_height_decides_between_two_floors_with_similar_votes() -> None:
    depth = wall_over_two_floors()
    for last_m, expected_m in ((math.nan, 1.5), (1.5, 1.5), (2.0, 2.0)):
        assert find(depth, VIEW, level(-0.4), seed=last_m).height_m == pytest.approx(expected_m, abs=0.02)


@pytest.mark.parametrize(
    "change",
    [
        {"ground_height_step": 0.02},
        {"ground_height_step": 0.15},
        {"ground_min_height_m": 0.5, "ground_max_height_m": 3.0},
        {"ground_column_step": 11, "ground_row_step": 1},
        {"ground_max_samples": 1000},
        {"ground_fit_rounds": 8, "ground_fit_floor_m": 0.1},
        {"ground_pair_climb": 0.4, "ground_pair_parts": 5},
    ],
)
def test_the_ground_does_not_hang_on_how_it_is_looked_for(change: dict[str, float]) -> None:
    depth = noisy(ground_image(VIEW, 2.0, -0.2, 0.1), 0.0015, 1)
    g = find(depth, VIEW, level(-0.2, 0.1), p=Params(**change))
    assert g.seen
    assert g.height_m == pytest.approx(2.0, rel=0.02)


def test_a_ground_higher_or_lower_than_considered_is_none() -> None:
    depth = ground_image(VIEW, 2.0, -0.2)
    assert not find(depth, VIEW, level(-0.2), p=Params(ground_max_height_m=1.5)).seen
    shallow = ground_image(VIEW, 0.5, -0.2)
    assert find(shallow, VIEW, level(-0.2)).seen
    assert not find(shallow, VIEW, level(-0.2), p=Params(ground_min_height_m=0.8)).seen


@pytest.mark.parametrize("size", [(848, 480), (1280, 720), (1600, 1200)])
def test_large_pictures_are_sampled_all_over(size: tuple[int, int]) -> None:
    """The right half falls off to the side: a fit of the left half alone would not see that."""
    info = camera_info(*size)
    depth = ground_image(info, 2.0, -0.4, slope_y=0.04)
    depth[:, : size[0] // 2] = np.where(np.arange(size[1])[:, None] % 2 == 0, depth[:, : size[0] // 2], 0)
    deep = ground_image(info, 3.5, -0.4)
    depth[:, int(0.8 * size[0]) :] = deep[:, int(0.8 * size[0]) :]  # a fifth of the picture lies 1.5 m lower
    g = find(depth, info, level(-0.4))
    assert not g.seen or g.height_m > 3.0


@pytest.mark.nojit
@given(st.floats(0.5, 8.0), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.integers(0, 2**32 - 1))
def test_the_ground_threshold_against_its_definition(height: float, slope_x: float, slope_y: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    info = CameraInfo("test", Intrinsics(40, 30, 30.0, 30.0, 19.5, 14.5))
    view = view_geometry(info, level(-0.3, 0.2), P)
    ground = Ground(
        seen=True, height_m=height, slope_x=slope_x, slope_y=slope_y, noise_per_m=P.ground_sigmas * 0.005 * height
    )
    threshold = ground_threshold(ground, view, P)
    for _ in range(20):
        q, u = round(view.f_px * view.lsb_per_px / rng.uniform(1.0, 20.0)), int(rng.integers(0, view.cols))
        x = view.f_px * view.lsb_per_px / q  # there is one limit for each code, so a code's own distance is asked for
        y = x * (u - view.cu) / view.f_px
        tolerance = min(max(4 * 0.005 * x * height, 0.25), 0.9 * 0.6)
        for above, expected in ((tolerance + 0.03, False), (tolerance - 0.03, True), (-5.0, True)):
            z = height + slope_x * x + slope_y * y - above
            assert bool(z / x - threshold.shift[u] > ground_limit(q, threshold)) == expected
    threshold = ground_threshold(NO_GROUND, view, P)
    assert all(np.isinf(ground_limit(q, threshold)) for q in (2, 1000, 65535))
    assert (threshold.shift == 0).all()


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (-0.4, 0.3)])
def test_flat_ground_is_no_obstacle_at_any_range(pitch: float, roll: float) -> None:
    model = extract(noisy(ground_image(VIEW, 3.0, pitch, roll), 0.0015, 2), VIEW, level(pitch, roll))
    assert model.ground.seen
    assert len(model.planes) == 0
    assert model.stats.ground_px > 5000


def test_a_kerb_below_the_least_height_is_ground_and_a_box_above_it_is_not() -> None:
    for tall, count in ((0.15, 0), (0.9, 1)):
        depth = ground_image(VIEW, 2.0, -0.2)
        k, R = VIEW.intrinsics, level(-0.2)
        u, v = pixel_grid(k)
        rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ R.T
        face = 5.0 / rays[..., 0]
        hit = (np.abs(face * rays[..., 1]) < 0.8) & (face * rays[..., 2] > 2.0 - tall) & (face * rays[..., 2] < 2.0)
        depth[hit] = to_mm(face)[hit]
        model = extract(depth, VIEW, R)
        assert model.ground.height_m == pytest.approx(2.0, abs=0.05)
        assert len(model.planes) == count


def wall_without_ground(pitch: float, seed: int) -> np.ndarray:
    """A wall 11 m ahead from 3 m above the camera to 1.9 m below it, with nothing below or behind, in noise of 0.01."""
    wall, k = flat_wall(VIEW, 11.0, pitch), VIEW.intrinsics
    u, v = pixel_grid(k)
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ level(pitch).T
    low = 11.0 * rays[..., 2] / np.maximum(rays[..., 0], 1e-6)
    return noisy(np.where((low > -3.0) & (low < 1.9), wall, 0).astype(np.uint16), 0.01, seed)


def test_the_lower_part_of_a_wall_is_no_ground_however_noisy() -> None:
    """Noise hides that a low band of it is upright; all of it together shows that it does not recede from row to row."""
    info = camera_info(320, 240, ke_per_m=0.01)
    invented = 0
    for seed in range(12):
        depth = wall_without_ground(-0.5, seed)
        invented += find(depth, info, level(-0.5), 0.01, p=Params(ground_recede_share=0.0)).seen
        assert find(depth, info, level(-0.5), 0.01) is NO_GROUND
    assert invented > 0
    model = extract(depth, info, level(-0.5))
    assert model.planes[:, 5].max() > 1.5  # down to its foot


@pytest.mark.parametrize("ke", [0.0015, 0.01])
def test_ground_in_front_of_a_wall_recedes_enough(ke: float) -> None:
    info = camera_info(320, 240, ke_per_m=ke)
    for pitch in (0.0, 0.17):
        for seed in range(3):
            depth = np.minimum(ground_image(VIEW, 2.0, pitch), flat_wall(VIEW, 8.0, pitch))
            depth[depth == 0] = flat_wall(VIEW, 8.0, pitch)[depth == 0]
            g = find(noisy(depth, ke, seed), info, level(pitch), ke)
            assert g.seen
            assert g.height_m == pytest.approx(2.0, abs=0.5)


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.floats(-0.4, 0.2))
def test_the_pairs_of_pixels_against_their_definition(seed: int, pitch: float) -> None:
    """Each sampled pixel with the one a wall's climb above it: by how much z/x and 1/x differ."""
    rng = np.random.default_rng(seed)
    info = CameraInfo("test", Intrinsics(20, 24, 24.0, 24.0, 9.5, 11.5))
    k, R = info.intrinsics, level(pitch)
    image = rng.integers(1500, 9000, (24, 20)).astype(np.uint16)
    image[rng.random(image.shape) < 0.2] = rng.choice([0, FAR_MM])
    tuning, points = ground_settings(P)[0], np.zeros(P.ground_max_samples, POINT)
    samples = GroundSamples(2, 2, np.zeros(height_bins(P), np.int32), points)
    n, _ = vote(image, GroundCamera(R, np.array([k.fx, k.fy, k.cx, k.cy]), 0.005), tuning, samples)
    at = [(u, v) for u in range(1, 20, 2) for v in range(1, 24, 2) if image[v, u] not in (0, FAR_MM)]
    assert n == len(at)

    def place(u: int, v: int) -> np.ndarray:
        return R @ np.array([(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0]) * (image[v, u] / 1000.0)

    for (u, v), got in zip(at, points[:n], strict=True):
        x, y, z = place(u, v)
        assert [got.x, got.y, got.z] == pytest.approx([x, y, z], rel=1e-5, abs=1e-5)
        want = (0.0, 0.0)
        if z >= P.ground_min_height_m and x > 0.0:
            climb_min = min(P.ground_pair_climb_min_m, 2.0 * z / 3.0)
            climb = min(max(P.ground_pair_climb * z, climb_min), P.ground_pair_climb_max_m)
            above = v - int(max(4, min(8, climb * k.fy * 1000.0 / float(image[v, u]))))
            if above >= 0 and image[above, u] not in (0, FAR_MM) and place(u, above)[0] > 0.0:
                x2, _, z2 = place(u, above)
                want = (z / x - z2 / x2, 1.0 / x - 1.0 / x2)
        assert (got.tangent_step, got.inverse_step) == pytest.approx(want, rel=1e-3, abs=1e-5)


@pytest.mark.nojit
def test_samples_without_room_change_no_point() -> None:
    """Where the table of points is full, further samples vote but leave the last point as it is."""
    info = CameraInfo("test", Intrinsics(20, 24, 24.0, 24.0, 9.5, 11.5))
    k, R = info.intrinsics, level(-0.4)
    image = noisy(ground_image(info, 1.5, -0.4), 0.0015, 1)
    found = []
    for room in (P.ground_max_samples, 9):
        points, votes = np.zeros(room, POINT), np.zeros(height_bins(P), np.int32)
        camera = GroundCamera(R, np.array([k.fx, k.fy, k.cx, k.cy]), 0.005)
        vote(image, camera, ground_settings(P)[0], GroundSamples(2, 2, votes, points))
        found.append((points[:9].tolist(), votes.tolist()))
    assert found[0] == found[1]
    assert sum(found[0][1]) > 9


@pytest.mark.nojit
@given(st.floats(3.0, 12.0), st.floats(-0.03, 0.03), st.integers(0, 2**32 - 1))
def test_what_stands_out_of_the_grounds_noise_against_its_definition(height: float, slope: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    g, ke = level_view(cols=6, rows=60), 0.01
    ground = Ground(seen=True, height_m=height, slope_x=slope)
    shift = rng.uniform(-0.01, 0.01, 6).astype(np.float32)
    tan_mid = (0.5 * (g.tan_edge[1:] + g.tan_edge[:-1])).astype(np.float32)
    flat = g.f_px * (tan_mid[None, :] - slope - shift[:, None]) / height + rng.normal(0.0, ke * g.f_px, (6, 60))
    codes = np.clip(flat * g.lsb_per_px, 2, 65535).astype(np.uint16)
    codes[rng.random((6, 60)) < 0.1] = 0
    codes[rng.random((6, 60)) < 0.1] = 1
    strips = np.zeros(40, strip_table.STRIP)
    strips["column"] = np.sort(rng.integers(0, 6, 40))
    strips["top_row"] = rng.integers(0, 55, 40)
    strips["bottom_row"] = np.minimum(59, strips["top_row"] + rng.integers(0, 30, 40))
    strips["kind"] = rng.choice([strip_table.SMOOTH, strip_table.MERGED], 40, p=[0.9, 0.1])
    strips["disparity_px"] = g.f_px / rng.uniform(2.0, 20.0, 40)
    want = [
        strip.kind == strip_table.MERGED
        or 4 * ke * height * g.f_px / float(strip.disparity_px) <= 0.9 * 0.6
        or naive.stands_out(
            codes[strip.column],
            strip.top_row,
            strip.bottom_row,
            tan_mid,
            shift[strip.column],
            (height, slope),
            ke,
            g.f_px,
            g.lsb_per_px,
            P,
        )
        for strip in strips
    ]
    kept = strips[want].copy()
    view, settings = g._replace(tan_mid=tan_mid), view_settings(g, ke, P)[0]
    threshold = ground_threshold(ground, view, P)._replace(shift=shift)
    n = drop_ground_noise(strips, 40, codes, view, threshold, settings, np.zeros(40, np.uint8))
    np.testing.assert_array_equal(strips[:n], kept)


def box_on_the_ground(height: float, pitch: float, distance: float, tall: float, wide: float = 4.0) -> np.ndarray:
    """The ground with a box on it, its face square to the camera's heading."""
    depth, k, R = ground_image(VIEW, height, pitch), VIEW.intrinsics, level(pitch)
    u, v = pixel_grid(k)
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ R.T
    face = distance / rays[..., 0]
    low = face * rays[..., 2]
    hit = (np.abs(face * rays[..., 1]) < 0.5 * wide) & (low > height - tall) & (low < height)
    depth[hit] = to_mm(face)[hit]
    return depth


@pytest.mark.parametrize("height", [4.0, 7.0, 10.0])
@pytest.mark.parametrize("ke", [0.0015, 0.005])
def test_the_noise_of_the_ground_is_no_obstacle_from_high_above(height: float, ke: float) -> None:
    info = camera_info(320, 240, ke_per_m=ke)
    for seed in (3, 4):
        model = extract(noisy(ground_image(VIEW, height, -0.5), ke, seed), info, level(-0.5))
        assert model.ground.seen
        assert model.ground.height_m == pytest.approx(height, rel=0.05)
        assert len(model.planes) == 0


def test_a_wall_stands_out_of_the_noise_of_the_ground_and_keeps_its_foot() -> None:
    info = camera_info(320, 240, ke_per_m=0.005)
    model = extract(noisy(box_on_the_ground(7.0, -0.5, 10.0, 5.0), 0.005, 5), info, level(-0.5))
    assert model.ground.seen
    assert len(model.planes) > 0
    assert model.planes[:, 0].min() == pytest.approx(10.0, abs=0.8)
    assert model.planes[:, 5].max() > 7.0 - 1.0  # four sigma of height are 1.4 m there


def test_beyond_where_the_ground_may_hide_an_obstacle_its_layer_is_unknown() -> None:
    """4 m up, with noise of 0.005, an obstacle of 0.6 m drowns beyond 7.5 m: nothing there is free down to the ground."""
    info = camera_info(320, 240, ke_per_m=0.005)
    depth = noisy(ground_image(VIEW, 4.0, -0.3), 0.005, 6)
    depth[depth == 0] = FAR_MM  # a sensor that reports the sky
    model = extract(depth, info, level(-0.3))
    assert model.ground.seen
    blind = model.ground.blind_beyond_m
    assert blind == pytest.approx(7.5, rel=0.1)
    f = model.free
    edges = f.layer_edges_m
    feet = [i for i in range(len(edges) - 1) if edges[i] < 3.5 <= edges[i + 1]]  # the lowest layer above the tolerance
    ahead = np.abs(0.5 * (f.azimuth_edges_rad[1:] + f.azimuth_edges_rad[:-1])) < 0.3
    assert (f.free_to_m[ahead][:, feet] <= blind / math.cos(0.32)).all()
    assert (f.free_to_m[ahead][:, feet] > 5.0).any()
    assert (f.end[ahead][:, feet] == FreeEnd.UNKNOWN).any()
    above = [i for i in range(len(edges) - 1) if edges[i] < 1.0 <= edges[i + 1]]
    assert (f.free_to_m[ahead][:, above] > 10.0).all()

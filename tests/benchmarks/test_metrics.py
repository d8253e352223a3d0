"""Each figure on hand-made models with known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.fidelity.metrics import (
    Rays,
    distances,
    judge,
    missed_rays,
    open_stopped_rays,
    range_counts,
    rays_of,
    recall,
    score,
    stops,
)
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import PERFECT, SensorModel
from drivers.simulation.source import Rendered, camera_info, render

INFO = camera_info(160, 120, ke_per_m=0.0015)
SKY_WALL = (8.0, -3.0, 8.0, 3.0, -8.0, 0.0)
"""The wall of `wall_frame` in level_cam."""


def wall_frame(sensor: SensorModel = PERFECT, **pose: float) -> Rendered:
    """A wall 8 m ahead, 6 m wide and from the camera's height up to 8 m above it; ground 2 m below."""
    b = SceneBuilder("test")
    b.ground()
    b.wall("wall", (8.0, -3.0), (8.0, 3.0), 8.0, base=2.0, thickness=0.01)
    return render(b.build(), INFO, sensor=sensor, **pose)


def rect(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, np.float64).reshape(-1, 6)


def rays(frame: Rendered, ke: float = 0.0015) -> Rays:
    return rays_of(frame, ke)


def test_distance_to_a_finite_rectangle_over_its_face_its_edge_and_its_corner() -> None:
    plane = rect((0.0, 0.0, 4.0, 0.0, -2.0, 0.0))
    points = np.array([[2.0, 3.0, -1.0], [-3.0, 4.0, -1.0], [2.0, 0.0, 5.0], [7.0, 0.0, -6.0], [1.0, 0.0, -0.5]])
    np.testing.assert_allclose(distances(points, plane), [3.0, 5.0, 5.0, 5.0, 0.0])
    assert np.isinf(distances(points, rect())).all()


def test_distances_take_the_nearest_of_many_and_agree_with_the_obvious_way() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    planes = rng.uniform(-5.0, 5.0, (60, 6))
    planes[:, 5] = planes[:, 4] + rng.uniform(0.1, 3.0, 60)
    planes[7, 2:4] = planes[7, 0:2]
    points = rng.uniform(-8.0, 8.0, (400, 3))
    slow = np.full(400, np.inf)
    for a_x, a_y, b_x, b_y, top, bottom in planes:
        a, edge = np.array([a_x, a_y]), np.array([b_x - a_x, b_y - a_y])
        t = np.clip((points[:, :2] - a) @ edge / max(edge @ edge, 1e-300), 0.0, 1.0)
        flat = np.linalg.norm(points[:, :2] - a - t[:, None] * edge, axis=1)
        slow = np.minimum(slow, np.hypot(flat, points[:, 2] - np.clip(points[:, 2], top, bottom)))
    np.testing.assert_allclose(distances(points, planes), slow, rtol=1e-12)


def test_distances_of_points_side_by_side_agree_with_each_alone() -> None:
    """Runs of points share the planes they look at; a single point looks at all."""
    rng = np.random.Generator(np.random.PCG64(4))
    planes = rng.uniform(-6.0, 6.0, (300, 6))
    planes[:, 2:4] = planes[:, 0:2] + rng.uniform(-0.4, 0.4, (300, 2))
    planes[:, 5] = planes[:, 4] + 0.5
    points = np.cumsum(rng.uniform(-0.03, 0.031, (700, 3)), axis=0)
    points[350:] += [3.0, -2.0, 1.0]  # an edge within a run
    alone = [float(distances(point[None], planes)[0]) for point in points]
    np.testing.assert_allclose(distances(points, planes), alone, rtol=1e-12)


@pytest.mark.parametrize(("roll", "pitch", "yaw"), [(0.0, 0.0, 0.0), (0.5, 0.0, 0.3), (-0.2, -0.4, 2.0)])
def test_rays_stop_at_planes_seen_from_both_sides_under_any_attitude(roll: float, pitch: float, yaw: float) -> None:
    frame = wall_frame(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    ahead = frame.R_level_optical @ [0.0, 0.0, 1.0]
    for plane in ((6.0, -9.0, 6.0, 9.0, -9.0, 9.0), (6.0, 9.0, 6.0, -9.0, -9.0, 9.0)):
        depth, which = stops(rect((30.0, -9.0, 30.0, 9.0, -9.0, 9.0), plane), INFO.intrinsics, frame.R_level_optical)
        assert depth[60, 80] == pytest.approx(6.0 / ahead[0], rel=0.02)
        assert which[60, 80] == 1


def test_perfect_model_of_a_wall_has_no_fault() -> None:
    frame = wall_frame()
    s = score(frame, rays(frame), rect(SKY_WALL))
    assert s.obstacle_rays > 3000
    assert s.mean_m == pytest.approx(0.0, abs=1e-9)
    assert (s.missed, s.phantom, s.phantom_open, s.open_stopped) == (0.0, 0.0, 0.0, 0.0)
    assert s.planes == 1


def test_shifted_model_costs_its_shift_and_is_missed_only_beyond_the_tolerance() -> None:
    frame = wall_frame()
    for shift, missed in ((-0.4, 0.0), (0.4, 0.0), (0.8, 1.0)):
        moved = rect((8.0 + shift, -9.0, 8.0 + shift, 9.0, -20.0, 2.0))
        s = score(frame, rays(frame), moved)
        assert s.mean_m == pytest.approx(abs(shift))
        assert s.p95_m == pytest.approx(abs(shift))
        assert s.missed == missed
    # 2 sigma takes over from 0.5 m: at ke = 0.01 it is 1.28 m
    assert score(frame, rays(frame, 0.01), rect((9.2, -9.0, 9.2, 9.0, -20.0, 2.0))).missed == 0.0


def test_margin_pulls_the_model_nearer() -> None:
    frame = wall_frame()
    s = score(frame, rays(frame), rect((8.8, -9.0, 8.8, 9.0, -20.0, 2.0)), np.array([0.5]))
    assert s.missed == 1.0
    assert s.missed_margin == 0.0


def test_half_a_wall_misses_half_its_rays_and_the_empty_model_all() -> None:
    frame = wall_frame()
    half = score(frame, rays(frame), rect((8.0, -3.0, 8.0, 0.0, -8.0, 0.0)))
    assert half.missed == pytest.approx(0.5, abs=0.01)
    assert half.mean_m == pytest.approx(0.75, rel=0.02)  # half of the points 0..3 m away, the others 0
    nothing = score(frame, rays(frame), rect())
    assert nothing.missed == 1.0
    assert math.isinf(nothing.mean_m)
    assert nothing.open_stopped == 0.0


def test_phantom_in_front_of_a_wall_only_beyond_a_metre() -> None:
    frame = wall_frame()
    for x, phantom in ((7.1, 0.0), (5.0, 1.0)):
        s = score(frame, rays(frame), rect((x, -9.0, x, 9.0, -20.0, 2.0)))
        assert s.phantom == phantom
        assert s.missed == 0.0
    # at ke = 0.01 three sigma are 1.92 m
    assert score(frame, rays(frame, 0.01), rect((6.3, -9.0, 6.3, 9.0, -20.0, 2.0))).phantom < 0.2


def test_sky_beside_the_wall_is_stopped_but_phantom_only_beyond_the_halo() -> None:
    frame = wall_frame()
    r = rays(frame)
    wide = score(frame, r, rect((8.0, -3.9, 8.0, 3.9, -8.0, 0.0)))
    assert wide.phantom_open == 0.0
    assert wide.open_stopped > 0.01
    far = score(frame, r, rect(SKY_WALL, (8.0, 4.2, 8.0, 6.0, -8.0, -0.01)))
    depth, which = stops(rect(SKY_WALL, (8.0, 4.2, 8.0, 6.0, -8.0, -0.01)), INFO.intrinsics, frame.R_level_optical)
    beside = (which == 1).sum() / r.open.sum()
    assert np.isfinite(depth).any()
    assert far.phantom_open == pytest.approx(beside)
    assert far.open_stopped == pytest.approx(beside)


def test_plane_over_open_ground_is_a_phantom_and_one_just_behind_a_ray_is_not() -> None:
    frame = wall_frame()
    lying = score(frame, rays(frame), rect(SKY_WALL, (3.0, -1.0, 3.0, 1.0, 0.5, 2.0)))
    assert lying.phantom_open > 0.01
    assert lying.open_stopped >= lying.phantom_open
    assert lying.phantom == 0.0


def test_open_rays_are_stopped_by_what_stands_before_the_ground_however_low() -> None:
    """Of a strip 0.1 m high at 4 m, rows 113 to 115 of the ground meet it: f h / (v - cy) = 4.0 .. 4.21 m."""
    frame = wall_frame()
    r = rays(frame)
    low = rect(SKY_WALL, (4.0, -9.0, 4.0, 9.0, 1.9, 2.0))
    s = score(frame, r, low)
    assert s.open_stopped * s.open_rays == pytest.approx(3 * 160)
    assert s.open_stopped_early == 0.0
    assert s.phantom_open == 0.0  # none is stopped more than a metre before the ground


def test_early_stops_are_more_than_half_a_metre_or_two_sigma_before_the_ground() -> None:
    frame = wall_frame()
    r = rays(frame)
    ground = r.open & np.isfinite(r.range_m)
    just = np.where(ground, r.range_m - 0.45, np.inf)
    assert not open_stopped_rays(r, just, early=True).any()
    np.testing.assert_array_equal(open_stopped_rays(r, just), ground)
    far = np.where(ground, r.range_m - np.nan_to_num(r.sigma_m) * 2 - 0.6, np.inf)
    np.testing.assert_array_equal(open_stopped_rays(r, far, early=True), ground)


def test_a_ray_is_missed_by_its_own_length_not_by_depth() -> None:
    """A wall taken for 0.45 m farther is missed where that is more than 0.5 m along the ray."""
    frame = wall_frame()
    r = rays(frame)
    moved = rect((8.45, -9.0, 8.45, 9.0, -20.0, 2.0))
    oblique = r.obstacle & (r.per_depth > 0.5 / 0.45)
    assert 0 < oblique.sum() < r.obstacle.sum()
    np.testing.assert_array_equal(judge(frame, r, moved).missed, oblique)


def test_two_sigma_are_missed_by_noise_squared_in_depth() -> None:
    """At ke = 0.01 and 8 m, 2 sigma are 1.28 m for every ray alike, since noise and misfit both lie along it."""
    frame = wall_frame()
    r = rays(frame, 0.01)
    assert score(frame, r, rect((9.27, -19.0, 9.27, 19.0, -30.0, 2.0))).missed == 0.0
    assert score(frame, r, rect((9.29, -19.0, 9.29, 19.0, -30.0, 2.0))).missed == 1.0


def test_ninety_five_percent_of_the_distances() -> None:
    """Half of a wall of 6 m is modelled: distances grow from 0 to 3 m over the other half."""
    frame = wall_frame()
    s = score(frame, rays(frame), rect((8.0, -3.0, 8.0, 0.0, -8.0, 0.0)))
    assert s.p95_m == pytest.approx(2.7, abs=0.06)


def test_a_stop_beside_another_obstacle_is_no_phantom() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("far", (14.0, -20.0), (14.0, 20.0), 9.0)
    b.pole("pole", 6.0, -1.0, 0.2, 9.0)
    frame = render(b.build(), INFO)
    r = rays(frame)
    for beside, phantom in ((1.0, False), (1.2, True)):  # from its axis, 0.1 m more than from its side
        strip = rect((6.0, -1.0 + beside, 6.0, -0.96 + beside, -9.0, 0.0))
        verdict = judge(frame, r, strip)
        stopped = r.obstacle & np.isfinite(verdict.stop_m)
        assert stopped.sum() > 20
        np.testing.assert_array_equal(verdict.phantom & r.obstacle, stopped & phantom)


def test_beyond_the_range_the_noise_is_that_of_the_stop() -> None:
    """Sky and ground far away are judged alike: at ke = 0.01 a stop at 10 m may be 3 m from a true surface."""
    b = SceneBuilder("test")
    b.ground()
    b.pole("pole", 10.0, -3.4, 0.4, 20.0)
    frame = render(b.build(), INFO)
    r = rays(frame, 0.01)
    far = r.open & (np.isinf(r.range_m) | (r.range_m > 40.0))
    assert (far & np.isfinite(r.range_m)).any()
    for y, phantom in ((-0.6, False), (0.2, True)):
        verdict = judge(frame, r, rect((10.0, y, 10.0, y + 0.1, -20.0, 0.5)))
        stopped = far & np.isfinite(verdict.stop_m)
        assert stopped.sum() > 20
        np.testing.assert_array_equal(verdict.phantom & far, stopped & phantom)


def test_phantoms_are_counted_where_no_ground_is() -> None:
    """Of a scene without ground all rays beside the things are open, and a plane among them is a phantom."""
    frame = render("no_ground", INFO)
    r = rays(frame)
    assert not frame.truth.drawn_ground.any()
    s = score(frame, r, rect((4.0, -0.4, 4.0, 0.4, 0.5, 2.0)))
    expected = np.isfinite(stops(rect((4.0, -0.4, 4.0, 0.4, 0.5, 2.0)), INFO.intrinsics, frame.R_level_optical)[0])
    assert s.phantom_open == pytest.approx((expected & r.open).sum() / r.open.sum())
    assert s.phantom_open > 0.02


def test_rays_by_range_add_up_and_lie_in_their_metre() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.pole("near", 5.4, -1.0, 0.3, 9.0)
    b.pole("far", 9.4, 2.0, 0.3, 9.0)
    frame = render(b.build(), INFO)
    r = rays(frame)
    verdict = judge(frame, r, rect((5.25, -1.3, 5.25, -0.7, -9.0, 2.0), (3.5, 0.5, 3.5, 0.6, 1.0, 2.0)))
    counts = range_counts(r, verdict)
    assert sum(counts.obstacle) == r.obstacle.sum()
    assert sum(counts.missed) == verdict.missed.sum() > 0
    assert sum(counts.missed[:9]) == 0  # the near pole is kept, the far one stands between 9.4 and 12 m of range
    assert counts.open_phantom[3] == sum(counts.open_phantom) == (verdict.phantom & r.open).sum() > 0
    assert sum(counts.phantom) == 0


def test_range_clip_blind_band_and_low_objects_are_no_obstacle_rays() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("far", (19.5, -9.0), (19.5, 0.0), 6.0)
    b.box("low", 6.0, 1.0, 1.0, 1.0, 0.5)
    b.pole("pole", 9.0, 2.0, 0.5, 5.0)
    frame = render(b.build(), INFO)
    label = frame.truth.label(frame.scene)
    assert set(np.unique(label[rays(frame, 0.0015).obstacle])) == {2}  # 3 sigma at 20 m are 1.8 m
    assert set(np.unique(label[rays(frame, 0.0002).obstacle])) == {0, 2}
    assert not (rays(frame).open & (label == 1)).any()
    blind = rays_of(frame, 0.0015, blind_left_px=20)
    assert not (blind.obstacle | blind.open)[:, :20].any()
    assert blind.open[:, 20:].any()


def test_missed_counts_only_obstacle_rays() -> None:
    frame = wall_frame()
    r = rays(frame)
    assert missed_rays(r, np.full(r.range_m.shape, np.inf)).sum() == r.obstacle.sum()


def test_missed_among_measured_rays_leaves_out_the_holes() -> None:
    frame = wall_frame(SensorModel(dropout_share=0.3), seed=1)
    r = rays(frame)
    assert (r.obstacle & ~r.measured).sum() > 500
    hole_model = rect((8.0, -3.0, 8.0, 0.0, -8.0, 0.0))
    s = score(frame, r, hole_model)
    assert 0.0 < s.missed_measured < 1.0
    assert s.missed_measured != s.missed


def test_recall_of_a_kept_and_a_lost_pole_and_of_one_replaced_by_something_nearer() -> None:
    b = SceneBuilder("test")
    b.ground()
    for name, x, y in (("kept", 6.0, -1.5), ("lost", 8.0, 0.0), ("wrong", 10.0, 3.0)):
        b.pole(name, x, y, 0.3, 6.0)
    frame = render(b.build(), INFO)
    planes = rect((5.85, -1.9, 5.85, -1.1, -9.0, 2.0), (6.0, 1.0, 6.0, 3.0, -9.0, 2.0))
    found = {f.name: f for f in recall(frame, rays(frame), planes)}
    assert [found[n].kept for n in ("kept", "lost", "wrong")] == [1.0, 0.0, 0.0]
    assert found["kept"].distance_m == pytest.approx(5.86, abs=0.03)
    assert found["kept"].width_px == pytest.approx(0.3 / 6.0 * 112.5, abs=1.0)


def test_figures_without_rays_of_their_kind_are_nan() -> None:
    frame = render("open", INFO)
    s = score(frame, rays(frame), rect())
    assert math.isnan(s.missed)
    assert math.isnan(s.phantom)
    assert math.isnan(s.mean_m)
    assert s.phantom_open == 0.0

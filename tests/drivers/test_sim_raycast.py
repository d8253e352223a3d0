"""Exact depths: every solid against its closed form, and against a slow sampling of points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.types import CameraInfo
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import camera_info, look, render

INFO = camera_info(161, 121)


def centre(depth: np.ndarray) -> float:
    return float(depth[60, 80])


def ray(info: CameraInfo, u: float, v: float) -> np.ndarray:
    k = info.intrinsics
    return np.array([(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0])


def scene(build: str, *args: object, **kwargs: object) -> Scene:
    b = SceneBuilder("test")
    getattr(b, build)("thing", *args, **kwargs)
    return b.build()


def test_depth_of_a_frontal_wall_is_its_distance_in_every_pixel() -> None:
    r = render(scene("wall", (8.0, -50.0), (8.0, 50.0), 50.0), INFO)
    seen = np.isfinite(r.truth.depth_m)
    np.testing.assert_allclose(r.truth.depth_m[seen], 8.0, atol=1e-9)
    assert seen[:60].all()


def test_depth_is_along_the_axis_not_the_range() -> None:
    r = render(scene("wall", (8.0, -50.0), (8.0, 50.0), 50.0), INFO, yaw_rad=0.4)
    for u in (0, 40, 160):
        d = R_CAMFRD_OPTICAL @ ray(INFO, u, 10)
        north = math.cos(0.4) * d[0] - math.sin(0.4) * d[1]
        assert r.truth.depth_m[10, u] == pytest.approx(8.0 / north)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.3), (-0.3, -0.5), (0.2, 0.3)])
def test_ground_depth_for_any_tilt(roll: float, pitch: float) -> None:
    b = SceneBuilder("test")
    b.ground()
    r = render(b.build(), INFO, roll_rad=roll, pitch_rad=pitch, position_ned_m=(3.0, -2.0, -2.5))
    R = rotation_from_euler(roll, pitch, 0.0) @ R_CAMFRD_OPTICAL
    for v in range(0, 121, 20):
        for u in range(0, 161, 20):
            down = float((R @ ray(INFO, u, v))[2])
            expected = 2.5 / down if down > 1e-9 else math.inf
            assert r.truth.depth_m[v, u] == pytest.approx(expected, rel=1e-9)
    assert np.nanmax(np.abs(r.truth.height_m)) < 1e-6


def test_sloping_ground() -> None:
    b = SceneBuilder("test")
    b.ground(slope_x=-0.1, slope_y=0.05)
    truth = render(b.build(), INFO).truth
    # z = -0.1 x on the axis' vertical plane: 2 m above it, the ray (1, t) meets 2 + t x = 2 - 0.1 x + ...
    t = float(ray(INFO, 80, 120)[1])
    assert truth.depth_m[120, 80] == pytest.approx(2.0 / (t + 0.1))
    assert np.nanmax(np.abs(truth.height_m)) < 1e-6
    assert not truth.obstacle(0.01).any()


def test_sphere() -> None:
    r = render(scene("sphere", 9.0, 0.0, 2.0, 1.5), INFO)
    assert centre(r.truth.depth_m) == pytest.approx(7.5)
    d = ray(INFO, 95, 50)
    b, a = 9.0 * d[2], float(d @ d)
    assert r.truth.depth_m[50, 95] == pytest.approx((b - math.sqrt(b * b - a * (81.0 - 2.25))) / a)
    share = np.isfinite(r.truth.depth_m).mean()
    radius_px = INFO.intrinsics.fx * math.tan(math.asin(1.5 / 9.0))
    assert share == pytest.approx(math.pi * radius_px**2 / (161 * 121), rel=0.03)


def test_vertical_cylinder() -> None:
    r = render(scene("pole", 8.0, 0.0, 2.0, 30.0), INFO)
    assert centre(r.truth.depth_m) == pytest.approx(7.0)
    width = int(np.isfinite(r.truth.depth_m[60]).sum())
    assert width == pytest.approx(2 * INFO.intrinsics.fx * math.tan(math.asin(1.0 / 8.0)), abs=1.5)
    np.testing.assert_allclose(r.truth.depth_m[0:60, 80], 7.0, atol=1e-9)


def test_cylinder_seen_end_on_shows_its_cap() -> None:
    r = render(scene("cylinder", (6.0, 0.0, -2.0), (9.0, 0.0, -2.0), 0.5), INFO)
    seen = np.isfinite(r.truth.depth_m)
    np.testing.assert_allclose(r.truth.depth_m[seen], 6.0, atol=1e-9)
    assert seen.sum() == pytest.approx(math.pi * (0.5 / 6.0 * INFO.intrinsics.fx) ** 2, rel=0.1)


def test_disc_is_seen_from_both_sides_and_not_edge_on() -> None:
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)):
        r = render(scene("disc", (5.0, 0.0, -2.0), normal, 0.8), INFO)
        assert centre(r.truth.depth_m) == pytest.approx(5.0)
    edge = render(scene("disc", (5.0, 0.0, -2.0), (0.0, 0.0, 1.0), 0.8), INFO)
    assert not np.isfinite(edge.truth.depth_m).any()


def test_nearer_solid_hides_the_farther() -> None:
    b = SceneBuilder("test")
    b.pole("near", 4.0, 0.0, 0.5, 10.0)
    b.wall("far", (9.0, -20.0), (9.0, 20.0), 10.0)
    truth = render(b.build(), INFO).truth
    label = truth.label(b.build())
    assert label[60, 80] == 0
    assert label[60, 20] == 1
    assert centre(truth.depth_m) == pytest.approx(3.75)


def test_nose_up_sees_the_wall_lower_and_roll_right_raises_the_right_of_the_ground() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.wall("wall", (8.0, -3.0), (8.0, 3.0), 2.5)
    level, up = (render(b.build(), INFO, pitch_rad=p).truth for p in (0.0, 0.2))
    top_row = [int(np.argmax(np.isfinite(t.depth_m[:, 80]))) for t in (level, up)]
    assert top_row[1] - top_row[0] == pytest.approx(INFO.intrinsics.fy * 0.2, abs=3)
    rolled = render(b.build(), INFO, roll_rad=0.3).truth
    ground_rows = (rolled.solid == 0).sum(axis=0)
    assert ground_rows[150] > ground_rows[10] + 20


def test_bounds_never_cut_a_solid_that_reaches_behind_the_camera() -> None:
    """A wall alongside, from behind the camera to in front of it, seen through any yaw, against its plane."""
    b = SceneBuilder("test")
    b.wall("wall", (-30.0, -1.5), (30.0, -1.5), 40.0, base=-20.0)
    for yaw in np.linspace(-3.0, 3.0, 13):
        truth = render(b.build(), INFO, yaw_rad=float(yaw), roll_rad=0.2).truth
        R = rotation_from_euler(0.2, 0.0, float(yaw)) @ R_CAMFRD_OPTICAL
        v, u = np.mgrid[:121, :161]
        k = INFO.intrinsics
        d = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ R.T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(d[..., 1] < 0.0, -1.5 / d[..., 1], np.inf)
            north, down = t * d[..., 0], t * d[..., 2] - 2.0
        expected = np.where((np.abs(north) < 29.99) & (down > -19.99) & (down < 19.99), t, np.inf)
        inside = np.isfinite(expected)
        np.testing.assert_allclose(truth.depth_m[inside], expected[inside], rtol=1e-9)
        assert not np.isfinite(truth.depth_m[d[..., 1] > 0.0]).any()


def test_level_points_agree_with_heights() -> None:
    r = render("mixture", INFO, roll_rad=0.3, pitch_rad=-0.3, yaw_rad=1.2, position_ned_m=(2.0, -8.0, -2.0))
    seen = np.isfinite(r.truth.depth_m)
    assert seen.mean() > 0.3
    np.testing.assert_allclose(2.0 - r.truth.points_level_cam_m[seen][:, 2], r.truth.height_m[seen], atol=1e-9)
    forward = r.R_level_optical[:, 2]
    assert forward[1] == pytest.approx(0.0, abs=1e-12)
    assert forward[0] > 0.0


def test_empty_scene_is_nothing_everywhere() -> None:
    truth = look(SceneBuilder("test").build(), INFO, R_CAMFRD_OPTICAL, np.zeros(3))
    assert np.isinf(truth.depth_m).all()
    assert (truth.label(SceneBuilder("test").build()) == -1).all()
    assert not truth.obstacle().any()

"""Whole frames of known scenes: walls, windows, poles, spheres, at every tilt."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import FrameModel, PlaneFlags
from drivers.simulation.scene_library import make_scene
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import SensorModel
from drivers.simulation.source import Rendered, camera_info

from ..nightly import examples
from .views import VIEW, extract, first_hit, flat_wall, level, noisy, seen

TILTS = [(0.0, 0.0), *((math.radians(p), math.radians(r)) for p in (-30, -10, 10, 30) for r in (-30, -10, 10, 30))]


def main_plane(model: FrameModel) -> np.ndarray:
    return model.planes[int(np.argmax(model.support_px))].astype(float)


@pytest.mark.parametrize("tilt", TILTS)
def test_a_wall_is_one_plane_at_its_distance_at_every_tilt(tilt: tuple[float, float]) -> None:
    """The tolerance: millimetre steps and half a pixel of a levelled cell, below 2 cm at 8 m; plus noise where it is."""
    clean = extract(flat_wall(VIEW, 8.0, *tilt), VIEW, level(*tilt))
    assert len(clean.planes) == 1
    assert main_plane(clean)[[0, 2]] == pytest.approx([8.0, 8.0], abs=0.03)
    rough = extract(noisy(flat_wall(VIEW, 8.0, *tilt), 0.0015, 1), VIEW, level(*tilt))
    # the corners of a leaning picture are slivers: some become planes of their own, none a metre off (Ws/2)
    assert len(rough.planes) <= 10
    assert np.abs(rough.planes[:, [0, 2]] - 8.0).max() < 1.0
    ends = main_plane(rough)[[0, 2]]
    # sigma of one pixel is 0.1 m; the mean of thousands is far better, the near side may take safe_distance
    assert ends == pytest.approx([8.0, 8.0], abs=0.12)


@pytest.mark.parametrize("turn_deg", [-60, -30, 15, 45, 75])
def test_a_slanted_wall_keeps_its_line(turn_deg: float) -> None:
    turn = math.radians(turn_deg)
    s = SceneBuilder("slanted")
    along = np.array([math.sin(turn), math.cos(turn)])
    a, b = np.array([6.0, 0.0]) - 20 * along, np.array([6.0, 0.0]) + 20 * along
    s.wall("wall", (float(a[0]), float(a[1])), (float(b[0]), float(b[1])), 20.0, base=-10.0)
    r = seen(s)
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    normal = np.array([math.cos(turn), -math.sin(turn)])
    # the same places are farther from the line the more noise they could have: walls reach out to 18 m here
    for p in model.planes.astype(float):
        for end in (p[0:2], p[2:4]):
            assert abs(normal @ end - 6.0 * math.cos(turn)) < 0.15 + 0.0015 * float(end @ end)
    assert len(model.planes) <= 3


def test_free_space_is_on_the_right_of_every_plane() -> None:
    r = seen_street()
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    assert len(model.planes) > 5
    a, b = model.planes[:, 0:2].astype(float), model.planes[:, 2:4].astype(float)
    to_camera = -a
    right_of = np.column_stack([-(b - a)[:, 1], (b - a)[:, 0]])  # level axes: x forward, y right
    assert (np.sum(right_of * to_camera, axis=1) > 0).all()


def seen_street() -> Rendered:
    return seen(make_scene("street", 1))


@pytest.mark.parametrize("ke", [0.0, 0.0015])
def test_the_window_of_the_paper_stays_open_and_the_slit_is_filled(ke: float) -> None:
    info = camera_info(640, 480)
    s = SceneBuilder("window")
    s.wall("facade", (6.5, -6.0), (6.5, 6.0), 5.5, ((4.5, 1.0, 2.9, 2.1), (9.0, 1.8, 1.2, 0.6)))
    s.wall("back wall", (14.0, -14.0), (14.0, 14.0), 9.0)
    s.ground()
    r = seen(s, info, sensor=SensorModel(ke_per_m=ke, sky_is_far=True))
    model = extract(r.depth_mm, info, r.R_level_optical)
    window_y, window_z = -6.0 + 4.5 + 1.45, 2.0 - 2.05  # its middle, from a camera 2 m up

    def hit(y: float, z: float) -> float:
        """Forward distance of the first plane on the ray through (6.5, y, z)."""
        best = math.inf
        for ax, ay, bx, by, top, bottom in model.planes.astype(float):
            det = (bx - ax) * y - (by - ay) * 6.5
            if abs(det) < 1e-9:
                continue
            share = (ay * 6.5 - ax * y) / det
            x = ax + share * (bx - ax)
            if 0 <= share <= 1 and x > 0 and top <= z * x / 6.5 <= bottom:
                best = min(best, x)
        return best

    # without noise 2.7 by 2.0 m and more stay open; with it the middle does, all that a vehicle of Ws by Hs needs
    half_y, half_z = (1.3, 0.95) if ke == 0.0 else (1.0, 0.7)
    for dy in (-half_y, 0.0, half_y):
        for dz in (-half_z, 0.0, half_z):
            assert hit(window_y + dy, window_z + dz) > 12.0
    for dy in (-1.6, 1.6):  # and no more than it is
        assert hit(window_y + dy, window_z) == pytest.approx(6.5, abs=0.4)
    for dz in (-1.3, 1.3):
        assert hit(window_y, window_z + dz) == pytest.approx(6.5, abs=0.4)
    assert hit(-6.0 + 9.6, 2.0 - 2.1) == pytest.approx(6.5, abs=0.4)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.4)])
def test_a_pole_of_twelve_centimetres_is_kept_at_eight_metres(tilt: tuple[float, float]) -> None:
    info = camera_info(640, 480)
    s = SceneBuilder("pole")
    s.ground()
    s.pole("pole", 8.0, 0.6, 0.12, 5.0)
    r = seen(s, info, pitch_rad=tilt[0], roll_rad=tilt[1], sensor=SensorModel(ke_per_m=0.0015, sky_is_far=True))
    model = extract(r.depth_mm, info, r.R_level_optical)
    reach = first_hit(model, math.atan2(0.6, 8.0), 0.0)
    assert reach == pytest.approx(math.hypot(8.0, 0.6) - 0.06, abs=0.4)


def test_a_sphere_and_a_cylinder_are_surrounded() -> None:
    """Rays that meet them stop at them, give or take the margin; rays half a metre past their outline do not."""
    s = SceneBuilder("shapes")
    s.sphere("sphere", 6.0, -1.8, 2.0, 1.0)
    s.cylinder("cylinder", (7.0, 2.2, 0.0), (7.0, 2.2, -4.0), 0.8)
    r = seen(s)
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    assert first_hit(model, math.atan2(-1.8, 6.0), 0.0) == pytest.approx(math.hypot(6.0, 1.8) - 1.0, abs=0.3)
    assert first_hit(model, math.atan2(2.2, 7.0), 0.0) == pytest.approx(math.hypot(7.0, 2.2) - 0.8, abs=0.3)
    assert first_hit(model, math.atan2(-1.8, 6.0) - math.asin(1.5 / 6.2), 0.0) == math.inf
    assert first_hit(model, 0.03, 0.0) == math.inf


@given(st.floats(0.3, 1.9), st.floats(4.0, 9.0), st.floats(-1.0, 1.0), st.integers(0, 2**31))
@examples(0.4)
def test_no_plane_lies_farther_behind_what_protrudes_than_the_safe_distance_and_its_margin(
    out: float, distance: float, y: float, seed: int
) -> None:
    """A box on a wall, any depth: rays that hit the box are stopped no later than safe_distance plus noise behind it."""
    s = SceneBuilder("box on a wall")
    s.wall("wall", (distance, -30.0), (distance, 30.0), 20.0, base=-10.0)
    s.box("box", distance - out / 2, y, out, 1.4, 1.6, base=1.2)
    r = seen(s, sensor=SensorModel(ke_per_m=0.001, sky_is_far=True), seed=seed % 1000)
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    near = distance - out
    for share in (-0.7, 0.0, 0.7):
        azimuth = math.atan2(y + share * 0.7, near)
        x = first_hit(model, azimuth, 0.0) * math.cos(azimuth)
        assert x <= near + 0.28 + 4 * 0.001 * near**2
        assert x >= near - 0.3 - 4 * 0.001 * near**2


def test_flags_show_what_the_image_border_cut_and_what_was_inferred() -> None:
    whole = extract(flat_wall(VIEW, 6.0), VIEW)
    every = PlaneFlags.CUT_LEFT | PlaneFlags.CUT_RIGHT | PlaneFlags.CUT_TOP | PlaneFlags.CUT_BOTTOM
    assert PlaneFlags(int(whole.flags[0])) == every | PlaneFlags.UNKNOWN_BEHIND
    s = SceneBuilder("island")
    s.box("box", 6.5, 0.0, 1.0, 2.0, 2.0, base=1.0)
    r = seen(s)
    island = extract(r.depth_mm, VIEW, r.R_level_optical)
    assert all(not PlaneFlags(int(f)) & every for f in island.flags)
    depth = np.zeros((240, 320), np.uint16)
    depth[60:180, 100:220] = 6000
    depth[100:125, 120:200] = 0  # 0.67 m high and never measured
    filled = extract(depth, VIEW)
    assert any(PlaneFlags(int(f)) & PlaneFlags.INFERRED for f in filled.flags)
    assert first_hit(filled, 0.0, 6.0 * (112 - 119.5) / 225) == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize(("scene", "least", "most"), [("street", 0.0, 0.1), ("trees", 0.5, 1.0)])
def test_trees_are_irregular_and_walls_are_not(scene: str, least: float, most: float) -> None:
    """One irregular strip was enough: 85 % of the pixels of a street lay on planes with the flag."""
    r = seen(make_scene(scene), sensor=SensorModel(ke_per_m=0.0015, sky_is_far=True), position_ned_m=(0.0, 0.0, -2.0))
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    irregular = (model.flags & PlaneFlags.IRREGULAR) > 0
    assert least <= model.support_px[irregular].sum() / model.support_px.sum() <= most


def test_counts_add_up() -> None:
    r = seen_street()
    model = extract(r.depth_mm, VIEW, r.R_level_optical, keep_strips=True)
    s = model.stats
    assert s.measured_share + s.unknown_share + s.far_share == pytest.approx(1.0)
    assert (s.planes, s.prisms) == (len(model.planes), len(model.prisms))
    assert s.clusters == len(np.unique(model.cluster))
    assert model.strips is not None
    assert extract(r.depth_mm, VIEW, r.R_level_optical).strips is None
    assert (model.strips.top_m < model.strips.bottom_m).all()
    assert set(np.unique(model.cluster)) <= set(np.unique(model.strips.cluster))
    planes_in_prisms = set().union(*(p.plane.tolist() for p in model.prisms))
    assert planes_in_prisms == set(range(len(model.planes)))


@pytest.mark.parametrize("step", [2, 4, 8])
def test_pooled_columns_keep_a_pole(step: int) -> None:
    s = SceneBuilder("pole")
    s.pole("pole", 6.0, 0.5, 0.1, 6.0)
    s.wall("wall", (10.0, -20.0), (10.0, 20.0), 20.0, base=-10.0)
    r = seen(s)
    model = extract(r.depth_mm, VIEW, r.R_level_optical, column_step=step)
    assert first_hit(model, math.atan2(0.5, 6.0), 0.0) == pytest.approx(6.0, abs=0.3)


@pytest.mark.parametrize("min_range_m", [0.001, 0.01, 0.3])
def test_a_camera_that_measures_very_near_measures_far_walls_as_well(min_range_m: float) -> None:
    info = camera_info(640, 480, ke_per_m=0.0005, min_range_m=min_range_m)
    model = extract(flat_wall(info, 9.37), info, level())
    assert model.valid
    assert len(model.planes) == 1
    assert model.planes[0, [0, 2]] == pytest.approx(9.37, abs=0.05)

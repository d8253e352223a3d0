"""The builder's solids stand where they were put, and the named scenes hold what they promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.simulation.scene_library import SCENES, SLIT_M, WINDOW_M, make_scene
from drivers.simulation.scenes import Scene, SceneBuilder
from drivers.simulation.source import camera_info, render

INFO = camera_info(160, 120)


@pytest.mark.parametrize("name", [n for n in SCENES if n != "open"])
def test_scene_shows_obstacles_and_is_the_same_for_the_same_seed(name: str) -> None:
    first, again, other = make_scene(name, 3), make_scene(name, 3), make_scene(name, 4)
    np.testing.assert_array_equal(first.rows, again.rows)
    np.testing.assert_array_equal(first.halfspaces, again.halfspaces)
    truth = render(first, INFO).truth
    assert truth.obstacle()[truth.depth_m < 20.0].any()
    same = np.array_equal(first.corners, other.corners)
    assert same == (name in ("no_ground", "tunnel"))


def test_open_scene_holds_no_obstacle() -> None:
    truth = render("open", INFO).truth
    assert not truth.obstacle(0.01).any()
    assert truth.drawn_ground[60:].all()


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="street"):
        make_scene("nowhere")


def test_window_and_slit_are_open_and_of_their_size() -> None:
    scene = make_scene("window", 1)
    assert len(scene.openings) == 2
    for opening, (width, height) in zip(scene.openings, (WINDOW_M, SLIT_M), strict=True):
        assert math.dist(opening.a_m, opening.b_m) == pytest.approx(width)
        assert opening.bottom_m - opening.top_m == pytest.approx(height)
        middle = [(opening.a_m[i] + opening.b_m[i]) / 2 for i in (0, 1)]
        level = (opening.top_m + opening.bottom_m) / 2
        info = camera_info(201, 151)
        truth = render(scene, info, position_ned_m=(0.0, middle[1], level)).truth
        wall = scene.names.index("facade")
        through = truth.label(scene) != wall
        pixel = (middle[0] + 0.25) / info.intrinsics.fx  # the reveal's far edge bounds the view
        assert through[75, 100]
        assert _run(through[75], 100) * pixel == pytest.approx(width, abs=2 * pixel)
        assert _run(through[:, 100], 75) * pixel == pytest.approx(height, abs=2 * pixel)


def _run(row: np.ndarray, at: int) -> int:
    first = last = at
    while row[first - 1]:
        first -= 1
    while row[last + 1]:
        last += 1
    return last - first + 1


def test_wall_has_its_face_on_the_line_and_its_body_behind() -> None:
    b = SceneBuilder("test")
    b.wall("wall", (5.0, -3.0), (5.0, 3.0), 4.0, thickness=1.0)
    assert render(b.build(), INFO).truth.depth_m[40, 80] == pytest.approx(5.0)
    b = SceneBuilder("test")
    b.wall("wall", (5.0, 3.0), (5.0, -3.0), 4.0, thickness=1.0)
    assert render(b.build(), INFO).truth.depth_m[40, 80] == pytest.approx(4.0)


def heights(scene: Scene, x: float, y: float) -> float:
    """Height of the scene's top at (x, y), seen from straight above."""
    info = camera_info(17, 17)
    r = render(scene, info, pitch_rad=-math.pi / 2, position_ned_m=(x, y, -30.0))
    return float(r.truth.height_m[8, 8])


def test_gable_ramp_and_trapezoid_from_above() -> None:
    b = SceneBuilder("test")
    b.ground()
    b.gable("house", 0.0, 0.0, 10.0, 6.0, 3.0, 5.0, math.pi / 2)
    b.ramp("ramp", 20.0, 0.0, 8.0, 2.0, 2.0)
    b.trapezoid("frustum", 40.0, 0.0, 4.0, 2.0, 3.0)
    scene = b.build()
    assert heights(scene, 0.0, 4.0) == pytest.approx(5.0)  # on the ridge, which runs east
    assert heights(scene, 1.5, 4.0) == pytest.approx(4.0)
    assert heights(scene, 0.0, 5.5) == pytest.approx(0.0)
    assert heights(scene, 18.0, 0.0) == pytest.approx(0.5)
    assert heights(scene, 22.0, 0.5) == pytest.approx(1.5)
    assert heights(scene, 40.0, 0.5) == pytest.approx(3.0)
    assert heights(scene, 41.5, 0.5) == pytest.approx(1.5)


def test_rays_pass_between_the_leaves_of_a_tree_and_stop_at_its_trunk() -> None:
    b = SceneBuilder("test", structured=False)
    b.tree("tree", 7.0, 0.0, 5.0, 1.5, 400, np.random.Generator(np.random.PCG64(1)))
    r = render(b.build(), camera_info(320, 240))
    seen = np.isfinite(r.truth.depth_m)
    fx = r.info.intrinsics.fx
    u = np.abs(np.arange(320) - r.info.intrinsics.cx) / fx * 7.0
    v = (np.arange(240) - r.info.intrinsics.cy) / fx * 7.0 + 5.0 * 0.68 - 2.0
    crown = (u[None, :] / 1.2) ** 2 + (v[:, None] / 1.28) ** 2 < 1.0
    assert 0.3 < seen[crown].mean() < 0.95
    assert np.ptp(r.truth.depth_m[seen]) > 0.5
    trunk_row = int(r.info.intrinsics.cy + 1.5 / 7.0 * fx)
    assert seen[trunk_row].sum() == pytest.approx(2 * 0.175 / 7.0 * fx, abs=2)


def test_stone_is_about_as_wide_as_asked_and_irregular() -> None:
    b = SceneBuilder("test", structured=False)
    b.stone("stone", 8.0, 0.0, 2.0, np.random.Generator(np.random.PCG64(2)))
    truth = render(b.build(), camera_info(320, 240)).truth
    columns = np.isfinite(truth.depth_m).any(axis=0).sum()
    assert 1.4 < columns / 225.0 * 8.0 < 2.6
    assert np.ptp(truth.depth_m[np.isfinite(truth.depth_m)]) > 0.3

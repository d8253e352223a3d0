"""Directions, outlines and false stops of rendered stereo: parts by hand, then the chain from images to the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_air.directions import judge_directions, plane_ranges, truth
from benchmarks.open_air.false_stops import main
from benchmarks.open_air.joint_figures import JointFigures, figures_of
from benchmarks.open_air.outlines import upright_outline
from benchmarks.open_air.views import View, every_match, profile_of, scene_of, see
from core.extractor import Extractor
from core.params import Params
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import camera_info, render
from drivers.simulation.stereo.stereo_profiles import StereoCamera, StereoProfile


def counts(view: View, profile: StereoProfile, noises: tuple[float, ...] = (1.0,)) -> JointFigures:
    total = JointFigures()
    for seen in see(view, noises, StereoCamera(profile), Extractor(Params())):
        total.add(figures_of(seen))
    return total


def test_planes_stop_horizontal_rays_at_their_height_only() -> None:
    planes = np.array([[5.0, -2.0, 5.0, 2.0, -1.0, 1.0], [3.0, -2.0, 3.0, 2.0, -4.0, -1.0]])
    azimuth = np.radians([0.0, 20.0, 30.0])
    assert plane_ranges(planes, azimuth)[0] == pytest.approx([5.0, 5.0 / np.cos(azimuth[1]), np.inf])
    assert np.isinf(plane_ranges(planes, azimuth)[1]).all()


def test_a_direction_is_free_where_no_solid_stands_within_ten_metres() -> None:
    s = SceneBuilder("box")
    s.ground()
    s.box("near", 6.0, 0.0, 1.0, 1.0, 4.0)
    s.box("far", 12.0, 5.0, 1.0, 1.0, 4.0)
    s.box("low", 6.0, -4.0, 1.0, 1.0, 1.0)
    frame = render(s.build(), camera_info())
    azimuth = np.arctan2([[0.0], [5.0], [-4.0]], [[6.0], [12.0], [6.0]])
    assert truth(frame, azimuth).tolist() == [False, True, True]


def test_the_outline_is_the_two_columns_inside_of_each_end() -> None:
    mask = np.zeros((5, 20), np.bool_)
    mask[1:4, 6:14] = True
    outline = upright_outline(mask)
    assert np.flatnonzero(outline[2]).tolist() == [6, 7, 12, 13]
    assert not outline[0].any()


def test_a_plane_that_stands_for_a_thing_is_no_false_stop() -> None:
    """Two posts 1.5 m apart: the gap is filled, which closes free directions, by something that is there."""
    s = SceneBuilder("posts")
    s.ground()
    s.pole("post", 6.0, -0.5, 0.3, 4.0)
    s.pole("post", 6.0, 0.5, 0.3, 4.0)
    frame = render(s.build(), camera_info())
    model, _ = Extractor(Params()).extract(frame.depth_mm, frame.info, frame.R_level_optical)
    d = judge_directions(frame, model)
    assert (d.truly_free & d.closed).any()
    assert d.false_stops == 0


def test_an_open_field_under_a_clear_sky_is_not_closed() -> None:
    """Every match accepted, planes stand where nothing is; with the rules on none does."""
    profile = profile_of("zed")
    before, after = (counts(View(scene="field"), p) for p in (every_match(profile), profile))
    assert before.directions == after.directions > 20
    assert before.false_stops > 0.1 * before.directions
    assert after.false_stops == 0
    assert after.sky_near == 0
    assert after.measured_px > 0.3 * after.pixels


def test_a_blank_box_keeps_its_outline_in_the_model() -> None:
    profile = profile_of("zed")
    before, after = (counts(View(scene="container_8m"), p, (0.5, 1.5)) for p in (every_match(profile), profile))
    kept = [sum(o.kept for o in c.outlines) / sum(o.pixels for o in c.outlines) for c in (before, after)]
    assert kept[1] > 0.9 > kept[0]
    assert after.false_stops == 0 < before.false_stops
    assert after.missed <= 0.01 * after.judged


@pytest.mark.slow
def test_equal_edges_of_two_pillars_are_no_near_obstacle() -> None:
    """The edge of a blank pillar matches that of another one in a few rows, as if a thing stood at 3 m."""
    profile = profile_of("long")
    before, after = (
        counts(
            View(scene="white_pillars", profile="long", sky="hazy", seed=2),
            replace(profile, match=replace(profile.match, shared=1.0, patch_per_px=n)),
            (0.5,),
        )
        for n in (0.0, profile.match.patch_per_px)
    )
    assert before.false_stops > 0 == after.false_stops
    kept = [sum(o.kept for o in c.outlines) for c in (before, after)]
    assert kept[1] >= kept[0] > 0
    assert after.missed <= before.missed


@pytest.mark.slow
def test_two_equal_edges_do_not_share_one_of_the_right_image() -> None:
    """The left edge of a near pillar is hidden before a far one, and matches the left edge of that over 150 rows."""
    profile, view = profile_of("long"), View(scene="white_pillars", profile="long")
    before, after = (counts(view, replace(profile, match=replace(profile.match, shared=n)), (0.5,)) for n in (1.0, 0.5))
    assert before.false_stops >= 3
    assert after.false_stops == 0
    kept = [sum(o.kept for o in c.outlines) for c in (before, after)]
    assert kept[1] >= kept[0] > 0
    assert after.missed <= before.missed


@pytest.mark.slow
def test_trees_stay_and_their_sky_is_free_of_planes() -> None:
    after = counts(View(scene="field_with_trees", sky="clouds"), profile_of("zed"))
    assert after.judged > 5000
    assert after.missed <= 0.001 * after.judged
    assert after.false_stops <= 0.02 * after.directions


def test_a_scene_under_a_sky_is_made_once() -> None:
    assert scene_of("field", 0, "hazy") is scene_of("field", 0, "hazy")
    with pytest.raises(ValueError, match="no stereo profile 'kinect'; there are: zed"):
        profile_of("kinect")


def test_the_command_prints_its_tables(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenes", "hand", "--skies", "clear", "--heights", "2", "--noise", "1.0"]) == 0
    out = capsys.readouterr().out
    assert "| hand | 1 | 0 |" in out
    assert "| clear, noise 1 | 1 |" in out

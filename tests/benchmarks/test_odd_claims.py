"""Random scenes of things that stereo measures badly, and the pixels of things in claimed space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.open_air.odd_claims import parse, thickness_px, wrong_pixels
from benchmarks.open_air.odd_scenes import FAMILIES, odd_scene
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL
from core.params import Params
from core.types import CameraInfo, ExtractorState, Intrinsics
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import look, render

INFO = CameraInfo("front", Intrinsics(320, 240, 225.0, 225.0, 159.5, 119.5), max_range_m=20.0, ke_per_m=0.001)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_each_family_stands_in_view_and_its_seed_repeats_it(family: str) -> None:
    seen = 0
    for seed in range(4):
        odd = odd_scene(family, np.random.default_rng(seed))
        again = odd_scene(family, np.random.default_rng(seed))
        assert np.array_equal(odd.scene.scene.rows, again.scene.scene.rows)
        truth = look(odd.scene.scene, INFO, R_CAMFRD_OPTICAL, np.array([0.0, 0.0, -odd.height_m]))
        seen += int((truth.label(odd.scene.scene) >= 0).any())
    assert seen >= 3


def test_a_pole_in_a_claimed_cell_is_wrong_and_one_behind_it_is_not() -> None:
    builder = SceneBuilder("pole")
    builder.ground()
    builder.pole("pole", 6.0, 0.0, 0.3, 5.0)
    frame = render(builder.build(), INFO)
    model, _ = Extractor(Params()).extract(frame.depth_mm, INFO, frame.R_level_optical, state=ExtractorState())
    assert not wrong_pixels(frame, model, Params()).any()
    claimed = replace(model, free=replace(model.free, free_to_m=np.full_like(model.free.free_to_m, 12.0)))
    wrong = wrong_pixels(frame, claimed, Params())
    pole = frame.truth.obstacle()
    assert wrong[pole].mean() > 0.3
    assert not wrong[~pole].any()


def test_the_thickness_of_a_bar_is_its_width() -> None:
    bar = np.zeros((40, 60), np.bool_)
    bar[10:15] = True
    assert thickness_px(bar, bar) == pytest.approx(5.0, abs=1.0)


def test_the_families_of_the_command_line_exist() -> None:
    assert set(parse([]).families) == set(FAMILIES)

"""The scenes: every name makes one, the same each time, with something to see and the camera in the open."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.scenes.catalogue import (
    FAMILIES,
    HELD_OUT_SEEDS,
    SCENES,
    TUNING_SEEDS,
    another_seed,
    camera_pose,
    family_of,
    make_scene,
)
from benchmarks.scenes.parts import Line, across
from benchmarks.scenes.structured import CORRIDOR_M, SLIT_M, STRUCTURED, WINDOW_M
from benchmarks.scenes.thin import GROUND, THIN
from benchmarks.scenes.unstructured import UNSTRUCTURED
from drivers.simulation.source import camera_info, render

FIXED = ("open", "no_ground", "tunnel")
"""Scenes of which only the camera moves with the seed."""


def test_half_of_the_seeds_are_held_out() -> None:
    assert len(TUNING_SEEDS) == len(HELD_OUT_SEEDS)
    assert not set(TUNING_SEEDS) & set(HELD_OUT_SEEDS)
    for half in (TUNING_SEEDS, HELD_OUT_SEEDS):
        assert {another_seed(half[70], by) for by in range(100)} == set(half)


def test_every_scene_is_in_one_family_and_each_large_family_has_at_least_twelve() -> None:
    assert len(set(SCENES)) == len(SCENES)
    assert {family_of(name) for name in SCENES} == set(FAMILIES)
    assert min(len(FAMILIES["structured"]), len(FAMILIES["unstructured"])) >= 12
    assert family_of("nowhere") == "other"
    for family, made in (
        ("structured", STRUCTURED),
        ("unstructured", UNSTRUCTURED),
        ("thin", THIN),
        ("ground", GROUND),
    ):
        assert set(made) <= set(FAMILIES[family])


SOME = [name if k % 4 == 0 else pytest.param(name, marks=pytest.mark.slow) for k, name in enumerate(SCENES)]
"""All scenes; those that only the nightly run makes are marked."""


@pytest.mark.parametrize("name", SOME)
def test_a_scene_is_made_by_its_seed_and_named_after_itself(name: str) -> None:
    one, other = make_scene(name, 3), make_scene(name, 4)
    again = make_scene.__wrapped__(name, 3)
    assert one.name == name
    assert one.kinds.tobytes() == again.kinds.tobytes()
    assert one.rows.tobytes() == again.rows.tobytes()
    assert one.halfspaces.tobytes() == again.halfspaces.tobytes()
    same = one.rows.tobytes() == other.rows.tobytes() and one.halfspaces.tobytes() == other.halfspaces.tobytes()
    assert same == (name in FIXED)
    assert camera_pose(name, 3, 2.0) != camera_pose(name, 4, 2.0)


@pytest.mark.parametrize("name", SOME)
def test_the_camera_stands_in_the_open_and_sees_what_the_scene_is_for(name: str) -> None:
    for height in (0.7, 2.0, 10.0):
        position, yaw = camera_pose(name, 5, height)
        seen = render(make_scene(name, 5), camera_info(64, 48), position_ned_m=position, yaw_rad=yaw).truth
        solid = np.isfinite(seen.depth_m) & ~seen.drawn_ground
        if solid.any():
            assert seen.depth_m[solid].min() > 0.8
        if height == 2.0 and name not in ("open", "mounds", "low_things"):
            assert seen.obstacle()[seen.depth_m < 15.0].any()
        if name in ("open", "mounds"):
            assert not seen.obstacle().any()


def test_the_camera_stays_below_a_ceiling_and_level_with_objects_without_ground() -> None:
    assert camera_pose("hall", 1, 10.0)[0][2] == -5.6
    assert camera_pose("tunnel", 1, 10.0)[0][2] == -2.2
    assert camera_pose("street", 1, 10.0)[0][2] == -10.0
    assert camera_pose("no_ground", 1, 10.0)[0][2] == -2.0


@pytest.mark.parametrize(("name", "sizes"), [("paper_window", (WINDOW_M, SLIT_M)), ("paper_corridor", (CORRIDOR_M,))])
def test_the_openings_of_the_paper_have_their_sizes_for_any_seed(
    name: str, sizes: tuple[tuple[float, float], ...]
) -> None:
    for seed in range(4):
        openings = make_scene(name, seed).openings
        assert len(openings) == len(sizes)
        for opening, (width, height) in zip(openings, sizes, strict=True):
            assert math.dist(opening.a_m, opening.b_m) == pytest.approx(width)
            assert opening.bottom_m - opening.top_m == pytest.approx(height)


def test_places_along_a_line_and_behind_it() -> None:
    straight = across(8.0, 3.0, 0.0)
    assert straight.at(0.0) == pytest.approx((8.0, -3.0))
    assert straight.at(6.0, 1.0) == pytest.approx((9.0, 3.0))
    turned = across(8.0, 3.0, 0.4, 1.0)
    assert turned.at(3.0) == pytest.approx((8.0, 1.0))
    assert turned.at(6.0)[0] == pytest.approx(8.0 - 3.0 * math.sin(0.4))
    assert Line(1.0, 2.0, 0.0).at(3.0, 4.0) == pytest.approx((4.0, -2.0))


def test_a_name_that_does_not_exist_is_reported_with_those_that_do() -> None:
    with pytest.raises(ValueError, match=r"no scene 'nowhere'; there are: .*street"):
        make_scene("nowhere", 0)

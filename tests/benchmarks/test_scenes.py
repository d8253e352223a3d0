"""The seam of the scenes: every name makes a scene, the same each time, and no seed serves both purposes."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scenes import FAMILIES, HELD_OUT_SEEDS, SCENES, TUNING_SEEDS, family_of, make_scene


def test_half_of_the_seeds_are_held_out() -> None:
    assert len(TUNING_SEEDS) == len(HELD_OUT_SEEDS)
    assert not set(TUNING_SEEDS) & set(HELD_OUT_SEEDS)


def test_every_scene_is_in_one_family() -> None:
    assert len(set(SCENES)) == len(SCENES)
    assert {family_of(name) for name in SCENES} == set(FAMILIES)
    assert family_of("nowhere") == "other"


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_made_by_its_seed(name: str) -> None:
    one, again, other = make_scene(name, 3), make_scene(name, 3), make_scene(name, 4)
    np.testing.assert_array_equal(one.rows, again.rows)
    np.testing.assert_array_equal(one.halfspaces, again.halfspaces)
    if name not in ("open", "no_ground", "tunnel"):
        differs = one.rows.shape != other.rows.shape or one.halfspaces.shape != other.halfspaces.shape
        assert differs or (one.rows != other.rows).any() or (one.halfspaces != other.halfspaces).any()


def test_a_name_that_does_not_exist_is_told_with_those_that_do() -> None:
    with pytest.raises(ValueError, match=r"no scene 'nowhere'; there are: .*street"):
        make_scene("nowhere", 0)

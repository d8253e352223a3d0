"""Coverage by range: a plane behind the true wall covers it where its margin reaches that far."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tracking.margins import EDGES_M, Counts, counts, run
from benchmarks.tracking.sequences import exposures, hovering
from drivers.simulation.scenes import Scene, SceneBuilder


def scene() -> Scene:
    s = SceneBuilder("wall")
    s.wall("wall", (9.0, -20.0), (9.0, 20.0), 5.0)
    return s.build()


@pytest.fixture(scope="module")
def shown() -> Counts:
    e = next(iter(exposures(hovering(scene()), 1, 0.0015, width=160)))
    plane = np.array([[9.3, -20.0, 9.3, 20.0, -5.0, 3.0]])
    return counts(e, plane, np.array([0.4]), 0.0015)


def test_what_the_margin_is_needed_for(shown: Counts) -> None:
    bins = shown.points > 0
    assert EDGES_M[:-1][bins].min() == 8.0
    assert shown.covered[0][bins] == pytest.approx(0.0)
    assert shown.covered[1][bins] == pytest.approx(0.0)
    assert shown.covered[2][bins] == pytest.approx(shown.points[bins])


def test_the_margin_and_the_clearance_that_it_takes(shown: Counts) -> None:
    near = shown.merged(8.0, 10.0)
    assert near.met[0] == near.points[0] > 0
    assert near.margin_m[0] / near.met[0] == pytest.approx(0.4)
    assert near.short_m[0] / near.met[0] == pytest.approx(0.4 - 0.31, abs=0.02)


def test_a_sequence_counts_each_scored_frame_for_both_models() -> None:
    found = run(hovering(scene()), 5, 0.0015, "white", 4)
    assert found["frame"].points.sum() == found["tracks"].points.sum() > 0
    assert found["tracks"].covered[2].sum() >= 0.99 * found["tracks"].points.sum()

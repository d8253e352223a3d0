"""Lemma 1, both algorithms and Eq. 17 on strips laid by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.paper.cases import EXACT, frames_of
from benchmarks.paper.geometry import algorithm_1, corners_of, deleted, drift, lemma_distance, line_errors, torn_share
from core.types import StripTable
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.source import Rendered


def wall(pitch_deg: float) -> Rendered:
    s = SceneBuilder("wall")
    s.ground()
    s.wall("wall", (8.0, -12.0), (8.0, 12.0), 4.0)
    return frames_of(s.build(), EXACT, 0, pitch_deg=pitch_deg, count=1)[0]


def strips(rows: list[tuple[int, float, float, float, float, int]]) -> StripTable:
    """rows: column, x, y, top, bottom, cluster."""
    u, x, y, top, bottom, cluster = (np.array(c) for c in zip(*rows, strict=True))
    zero = np.zeros(len(u), np.int32)
    f = np.float32
    return StripTable(
        u=u.astype(np.int32),
        row_top=zero,
        row_bottom=zero,
        x_m=x.astype(f),
        y_m=y.astype(f),
        top_m=top.astype(f),
        bottom_m=bottom.astype(f),
        support_px=zero,
        cluster=cluster.astype(np.int32),
    )


def test_lemma_1_holds_nose_down_positive_and_columns_drift() -> None:
    frame = wall(-20.0)
    seen = frame.truth.obstacle(0.0)
    assert np.abs(lemma_distance(frame, math.radians(20.0))[seen] - 8.0).max() < 1e-6
    assert np.abs(lemma_distance(frame, math.radians(-20.0))[seen] - 8.0).max() > 1.0
    assert drift(frame, 4) > 0.5
    assert drift(wall(0.0), 4) < 1e-6


def test_algorithm_1_separates_what_meets_later_and_compares_the_last_strip_only() -> None:
    # two walls 3 m apart that close in: 1 m between them at last
    x = np.array([5.0, 8.0, 5.0, 7.0, 5.0, 6.0])
    y = np.zeros(6)
    assert algorithm_1(x, y) == [0, 1, 0, 1, 0, 0]
    # 5.5 m is nearer to the last strip of the second cluster
    assert algorithm_1(np.array([5.0, 8.0, 6.8, 6.2]), np.zeros(4)) == [0, 1, 1, 1]


def test_torn_neighbours_are_counted() -> None:
    table = strips(
        [
            (0, 5.0, 0.0, -1.0, 1.0, 0),
            (1, 5.0, 0.1, -1.0, 1.0, 0),
            (1, 6.0, 0.1, -1.0, 1.0, 1),
            (1, 5.0, 0.1, 3.0, 4.0, 2),
        ]
    )
    assert torn_share(table, table.cluster.tolist()) == pytest.approx(0.5)  # the third; the fourth is passable
    assert torn_share(table, [0, 0, 0, 1]) == 0.0
    assert math.isnan(torn_share(strips([(0, 5.0, 0.0, -1.0, 1.0, 0)]), [0]))


def test_the_text_deletes_pockets_the_listing_spikes_too() -> None:
    left, right = np.array([5.0, -0.5]), np.array([5.0, 0.5])
    spike = deleted(left, np.array([4.0, 0.0]), right)
    pocket = deleted(left, np.array([6.0, 0.0]), right)
    assert spike == (False, True, pytest.approx(1.0))
    assert pocket == (True, True, pytest.approx(-1.0))
    # a blunt pocket: less than a right angle is missing, and the listing keeps it
    assert deleted(left, np.array([5.1, 0.0]), right)[:2] == (True, False)
    # as wide as the vehicle
    assert deleted(2.0 * left, np.array([12.0, 0.0]), np.array([10.0, 1.1]))[:2] == (False, False)


def test_corners_are_three_neighbouring_columns_of_one_cluster() -> None:
    row = [(u, 5.0, 0.1 * u, -1.0, 1.0, 0) for u in (0, 1, 2, 4, 5)]
    found = corners_of(strips(row))
    assert len(found) == 1
    assert found[0][1].tolist() == pytest.approx([5.0, 0.1])
    apart = [(0, 5.0, 0.0, -1.0, 0.0, 0), (1, 5.0, 0.1, 0.5, 1.0, 0), (2, 5.0, 0.2, 0.5, 1.0, 0)]
    assert corners_of(strips(apart)) == []


def test_a_wall_along_the_view_diverges_without_its_second_moment() -> None:
    rng = np.random.Generator(np.random.PCG64(1))
    assert max(line_errors(0.0, 0.0, rng)) < 1e-6
    assert max(line_errors(math.radians(45.0), 0.0, rng)) < 1e-6
    printed, ours = line_errors(math.radians(90.0), 0.01, rng)
    assert ours < 0.02
    assert printed > 5.0 * ours

"""Clusters against the components of the whole graph."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.union_find import root_of

from . import naive
from .tables import Strips

pytestmark = pytest.mark.nojit


def partition(labels: list[int] | np.ndarray) -> set[frozenset[int]]:
    return {
        frozenset(int(i) for i in np.flatnonzero(np.asarray(labels) == c)) for c in set(np.asarray(labels).tolist())
    }


def check_places(t: Strips) -> None:
    g = t.view
    for row, place in zip(t.strips, t.place, strict=True):
        x = g.f_px / row.disparity_px
        assert place[0] == pytest.approx(x)
        assert place[1] == pytest.approx(x * (row.column - g.cu) / g.f_px, abs=1e-4)
        assert place[2] == pytest.approx(x * (row.top_row - 0.5 - g.cv) / g.f_px, abs=1e-4)
        assert place[3] == pytest.approx(x * (row.bottom_row + 0.5 - g.cv) / g.f_px, abs=1e-4)


@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.sampled_from([0.4, 1.0, 2.5]))
def test_clusters_are_the_components_of_the_graph_of_all_pairs(seed: int, n: int, ws: float) -> None:
    rng = np.random.default_rng(seed)
    t = Strips(cols=80)
    for u in np.sort(rng.integers(0, 80, n)):
        top = int(rng.integers(0, 90))
        t.add(int(u), top, min(99, top + int(rng.integers(0, 30))), float(rng.uniform(2.0, 12.0)))
    t.build()
    check_places(t)
    count = t.cluster(ws, 0.7)
    whole = naive.components(t.place.tolist(), ws, 0.7)
    got = t.cluster_of
    assert sorted(set(got.tolist())) == list(range(count))
    firsts = [int(np.flatnonzero(got == c)[0]) for c in range(count)]
    assert firsts == sorted(firsts)  # numbered in order of first appearance
    assert partition(got) == partition(whole)


def wall(t: Strips, columns: range, x_of: float, top: int = 20, bottom: int = 80) -> None:
    for u in columns:
        t.add(u, top, bottom, x_of)


@pytest.mark.parametrize("gap_columns", [5, 15, 25, 45])
def test_walls_apart_by_less_than_a_vehicle_are_one_object(gap_columns: int) -> None:
    """Two walls at 6 m with a gap of n columns of 6 cm: one cluster below Ws = 2 m."""
    t = Strips(cols=120)
    wall(t, range(30), 6.0)
    wall(t, range(30 + gap_columns, 110), 6.0)
    t.build()
    count = t.cluster()
    assert count == (1 if (gap_columns + 1) * 0.06 < 2.0 else 2)
    assert partition(t.cluster_of) == partition(naive.components(t.place.tolist(), 2.0, 1.0))


@pytest.mark.parametrize(("behind", "count"), [(1.5, 1), (2.5, 2)])
def test_a_pole_joins_the_wall_behind_it_when_no_vehicle_fits_between(behind: float, count: int) -> None:
    t = Strips(cols=60)
    for u in range(60):
        t.add(u, 20, 80, 6.0 - behind if u == 30 else 6.0)
    t.build()
    assert t.cluster() == count


def test_objects_one_above_the_other_join_only_below_a_passable_height() -> None:
    for gap_rows, count in ((10, 1), (40, 2)):  # 5 cm a row at 5 m
        t = Strips()
        for u in range(30):
            t.add(u, 5, 30, 5.0)
            t.add(u, 31 + gap_rows, 90, 5.0)
        t.build()
        assert t.cluster() == count


def test_two_arms_that_meet_at_the_end_are_one_cluster() -> None:
    """A V seen from its open side: the union comes with the last columns."""
    t = Strips(cols=60)
    for u in range(60):
        t.add(u, 10, 30, 12.0 - u * 0.05)
        t.add(u, 70, 90, 6.0 + u * 0.05)
    for u in range(59, 60):
        t.add(u, 31, 69, 9.0)
    t.build()
    assert t.cluster(4.0, 1.0) == len(set(naive.components(t.place.tolist(), 4.0, 1.0)))


def test_a_long_chain_of_unions_finds_its_root() -> None:
    n = 600
    parent = np.maximum(np.arange(n, dtype=np.int32) - 1, 0).astype(np.int32)
    assert root_of(parent, n - 1) == 0

"""Layers: their boundaries, the planes in them, and that no part of a plane is lost."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.stages.prisms import layered_prisms

pytestmark = pytest.mark.nojit


def planes(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, np.float32)


def prisms(rows: np.ndarray, join: float = 0.25, cluster: np.ndarray | None = None) -> tuple:
    own = np.zeros(len(rows), np.int32) if cluster is None else cluster
    return layered_prisms(rows, np.linspace(0.1, 0.2, len(rows)).astype(np.float32), own, join, 0.01)


def test_no_planes_no_prisms_and_one_plane_one_layer() -> None:
    assert len(prisms(np.zeros((0, 6), np.float32))) == 0
    (only,) = prisms(planes((5, -1, 6, 1, -2, 1)))
    assert (only.top_m, only.bottom_m, only.closed, only.plane.tolist()) == (-2.0, 1.0, False, [0])
    np.testing.assert_array_equal(only.vertices_m, [[5, -1], [6, 1]])


def test_a_high_wall_among_low_ones_makes_two_layers() -> None:
    """A staircase of five ends: the low layer is one profile of all, each high one a profile of its own."""
    y = np.arange(-3.0, 4.0)
    tops = (-1, -3, -1, -3, -1, -1)
    got = prisms(planes(*((5, a, 5, b, top, 1) for a, b, top in zip(y, y[1:], tops, strict=False))))
    layers = [(p.top_m, p.bottom_m, p.plane.tolist()) for p in got]
    assert layers == [(-3.0, -1.0, [1]), (-3.0, -1.0, [3]), (-1.0, 1.0, [0, 1, 2, 3, 4, 5])]
    low = got[2]
    np.testing.assert_array_equal(low.vertices_m, [[5, v] for v in y])
    assert low.margin_m == pytest.approx(0.2)


def test_where_layers_take_more_room_each_height_is_a_prism() -> None:
    """Two walls of two heights: three profiles as layers (56 bytes), two as they are (48)."""
    got = prisms(planes((5, -1, 5, 1, -3, 1), (5, 1, 4, 2, -1, 1)))
    assert [(p.top_m, p.bottom_m, p.plane.tolist()) for p in got] == [(-3.0, 1.0, [0]), (-1.0, 1.0, [1])]


def test_separate_planes_are_separate_profiles_with_their_clusters() -> None:
    got = prisms(planes((5, -3, 5, -1, -2, 1), (5, 1, 5, 3, -1, 2)), cluster=np.array([4, 7], np.int32))
    assert [(p.cluster, p.top_m, p.bottom_m) for p in got] == [(4, -2.0, 1.0), (7, -1.0, 2.0)]


def test_ends_that_differ_little_are_one_cut() -> None:
    got = prisms(planes((5, -1, 5, 1, -2.0, 1.0), (5, 1, 5, 3, -1.9, 0.9)))
    assert len(got) == 1
    assert (got[0].top_m, got[0].bottom_m) == (-2.0, 1.0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.sampled_from([0.0, 0.25, 1.0]))
def test_prisms_hold_every_plane_whole(seed: int, n: int, join: float) -> None:
    """Whatever the heights: each plane stands in layers without a gap from its top or above to its bottom or below."""
    rng = np.random.default_rng(seed)
    y = np.cumsum(rng.uniform(0.3, 2.0, n + 1)) - n / 2
    x = rng.uniform(4.0, 6.0, n + 1)
    top = rng.uniform(-3, 1, n)
    bottom = top + rng.uniform(0.001, 3, n)
    rows = np.column_stack([x[:-1], y[:-1], x[1:], y[1:], top, bottom]).astype(np.float32)
    got = prisms(rows, join)
    for k in range(n):
        mine = sorted((p.top_m, p.bottom_m) for p in got if k in p.plane)
        assert mine[0][0] <= rows[k, 4]
        assert mine[-1][1] >= rows[k, 5]
        assert mine[0][0] >= rows[k, 4] - join - 1e-5
        assert mine[-1][1] <= rows[k, 5] + join + 1e-5
        for (_, end), (start, _) in pairwise(mine):
            assert end == start
    for p in got:
        assert len(set(p.plane.tolist())) == len(p.plane)
        for edge, k in enumerate(p.plane):
            np.testing.assert_allclose(p.vertices_m[edge], rows[k, 0:2], atol=0.011)
            np.testing.assert_allclose(p.vertices_m[edge + 1], rows[k, 2:4], atol=0.011)

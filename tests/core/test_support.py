"""Which strips stay, how columns are ordered, where the image cut them, and their smoothed near edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import strips as s
from core import support
from core.level import view_geometry
from core.params import Params

from . import naive
from .columns import F
from .tables import Strips
from .views import INFO, level

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)


def random_strips(rng: np.random.Generator, n: int, cols: int = 20) -> Strips:
    t = Strips(cols)
    for u in np.sort(rng.integers(0, cols, n)):
        top = int(rng.integers(0, 80))
        t.add(
            int(u),
            top,
            top + int(rng.integers(0, 20)),
            rng.choice([4.0, 4.1, 5.0]) + 0.02 * rng.random(),
            int(rng.integers(1, 60)),
        )
    return t.build()


@given(SEED, st.integers(0, 60))
def test_columns_are_indexed_and_ordered_from_top_to_bottom(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    t = random_strips(rng, n)
    for u in range(t.cols):
        a, b = t.columns[u], t.columns[u + 1]
        assert (t.ints[a:b, s.U] == u).all()
        keys = [(int(r[s.TOP]), -float(f[s.D])) for r, f in zip(t.ints[a:b], t.floats[a:b], strict=True)]
        assert keys == sorted(keys)
    assert t.columns[0] == 0
    assert t.columns[-1] == n


@given(SEED, st.integers(1, 60), st.sampled_from([1, 7, 15]), st.sampled_from([0, 2, 4]))
def test_small_strips_stay_only_with_company(seed: int, n: int, least: int, reach: int) -> None:
    rng = np.random.default_rng(seed)
    t = random_strips(rng, n)
    rows = [
        (int(r[s.U]), int(r[s.TOP]), int(r[s.BOTTOM]), int(r[s.SUPPORT]), float(f[s.D]))
        for r, f in zip(t.ints, t.floats, strict=True)
    ]
    per_px = float(rng.choice([0.0, 10.0]))
    want = [i for i in range(n) if naive.carried(rows, i, 0.3, max(least * s.PX, int(per_px * rows[i][4])), reach)]
    before = t.ints.copy()
    kept = support.drop_unsupported(
        t.ints, t.floats, n, t.cols, 0.3, least * s.PX, per_px, reach, t.columns, np.zeros(n, np.uint8)
    )
    assert kept == len(want)
    np.testing.assert_array_equal(t.ints[:kept], before[want])


def keep(t: Strips, least: int = 7) -> list[int]:
    n = support.drop_unsupported(
        t.ints, t.floats, t.n, t.cols, 0.2, least * s.PX, 0.0, 4, t.columns, np.zeros(t.n, np.uint8)
    )
    return t.ints[:n, s.U].tolist()


def test_a_pole_and_a_wire_stay_and_a_mismatch_goes() -> None:
    t = Strips()
    t.add(3, 10, 60, 6.0, 40)  # a pole: in one column
    for u in range(20, 30):
        t.add(u, 40, 40, 6.0, 1)  # a wire: along one row
    t.add(40, 50, 51, 2.0, 2)
    t.add(41, 50, 51, 2.0, 2)  # two by two pixels: nowhere
    # the outermost two columns of the wire have too little on one side
    assert keep(t.build()) == [3, *range(22, 28)]


def test_the_noise_tail_of_a_wall_goes_and_what_stands_before_it_stays() -> None:
    t = Strips()
    for u in range(10, 20):
        t.add(u, 10, 90, 6.0, 80)
        t.add(u, 40, 42, 100.0 / (100.0 / 6.0 + 0.6), 3)  # three sigma nearer: the wall's own
        t.add(u, 60, 62, 4.0, 3)  # a cable
    kept = keep(t.build())
    assert kept == sorted([*range(10, 20), *range(10, 20)])


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.4, 0.2)])
def test_cuts_are_marked_where_the_picture_ends(roll: float, pitch: float) -> None:
    R = level(pitch, roll)
    g = view_geometry(INFO, R, Params())
    k = INFO.intrinsics
    inside = np.zeros((g.cols, g.rows), bool)
    for u in range(g.cols):
        for v in range(g.rows):
            at = naive.source_pixel(u, v, R, k, g.f_px, g.cu, g.cv)
            inside[u, v] = at is not None and 0 <= at[0] <= k.width - 1 and 0 <= at[1] <= k.height - 1
    rows = []
    for u in range(g.cols):
        seen = np.flatnonzero(inside[u])
        if len(seen) > 8:
            rows += [
                (u, seen[0], seen[-1], 3),
                (u, seen[0] + 3, seen[-1], 2),
                (u, seen[0], seen[-1] - 3, 1),
                (u, seen[0] + 3, seen[-1] - 3, 0),
            ]
    assert len(rows) > 60
    ints = np.zeros((len(rows), 9), np.int32)
    for i, (u, top, bottom, _) in enumerate(rows):
        ints[i, s.U], ints[i, s.TOP], ints[i, s.BOTTOM] = u, top, bottom
    support.mark_cuts(ints, len(rows), g.H, k.width, k.height)
    np.testing.assert_array_equal(ints[:, s.CUT], [r[3] for r in rows])


def test_the_near_edge_is_the_median_of_three_touching_columns() -> None:
    t = Strips(sigma_px=0.5)
    near = [5.0, 4.2, 5.0, 4.8, 4.6, 5.0]
    for u, x in enumerate(near):
        t.add(u, 10, 60, 5.0, near_m=x)
    t.build()
    support.smooth_near(t.ints, t.floats, t.n, t.cols, t.columns, np.zeros(t.n, np.float32))
    np.testing.assert_allclose(F / t.floats[:, s.NEAR], [5.0, 5.0, 4.8, 4.8, 4.8, 5.0], rtol=1e-5)


def test_a_pole_keeps_its_own_near_edge() -> None:
    t = Strips()
    for u in range(9):
        t.add(u, 10, 60, 3.0 if u == 4 else 8.0, near_m=2.9 if u == 4 else 7.9)
    t.build()
    support.smooth_near(t.ints, t.floats, t.n, t.cols, t.columns, np.zeros(t.n, np.float32))
    assert F / t.floats[4, s.NEAR] == pytest.approx(2.9)

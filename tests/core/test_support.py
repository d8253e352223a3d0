"""Which strips stay, how columns are ordered, where the image cut them, and their smoothed near edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import strips as s
from core.stages import support
from core.stages.settings import view_settings
from core.stages.view_geometry import view_geometry

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
        assert (t.strips["column"][a:b] == u).all()
        keys = [(int(r["top_row"]), -float(r["disparity_px"])) for r in t.strips[a:b]]
        assert keys == sorted(keys)
    assert t.columns[0] == 0
    assert t.columns[-1] == n


def settings(t: Strips, sigma_d: float, p: Params) -> np.ndarray:
    return view_settings(t.view, sigma_d / F, p)[0]


@given(SEED, st.integers(1, 60), st.sampled_from([1, 7, 15]), st.sampled_from([0, 2, 4]))
def test_small_strips_stay_only_with_company(seed: int, n: int, least: int, reach: int) -> None:
    rng = np.random.default_rng(seed)
    p = Params(
        min_support_px=least,
        support_columns=reach,
        min_support_m=float(rng.choice([0.0, 0.05, 0.2])),
        support_rows=int(rng.choice([0, 2, 5])),
        support_sigmas=float(rng.choice([2.0, 4.0])),
        support_relative=float(rng.choice([0.0, 0.05, 0.1])),
        support_large=int(rng.choice([1, 4])),
        support_tail_sigmas=float(rng.choice([1.0, 4.5])),
    )
    t = random_strips(rng, n)
    rows = [
        (int(r["column"]), int(r["top_row"]), int(r["bottom_row"]), int(r["support"]), float(r["disparity_px"]))
        for r in t.strips
    ]
    need = [max(least * s.PX, int(s.PX * p.min_support_m * row[4])) for row in rows]
    want = [i for i in range(n) if naive.carried(rows, i, 0.3, need[i], p)]
    before = t.strips.copy()
    kept = support.drop_unsupported(t.strips, n, t.cols, settings(t, 0.3, p), t.columns, np.zeros(n, np.uint8))
    assert kept == len(want)
    np.testing.assert_array_equal(t.strips[:kept], before[want])
    np.testing.assert_array_equal(t.columns, np.searchsorted(t.strips["column"][:kept], np.arange(t.cols + 1)))


def keep(t: Strips, least: int = 7) -> list[int]:
    p = Params(min_support_px=least, min_support_m=0.0)
    n = support.drop_unsupported(t.strips, t.n, t.cols, settings(t, 0.2, p), t.columns, np.zeros(t.n, np.uint8))
    return t.strips["column"][:n].tolist()


def test_a_pole_and_a_wire_stay_and_a_mismatch_goes() -> None:
    t = Strips()
    t.add(3, 10, 60, 6.0, 40)  # a pole: in one column
    for u in range(20, 30):
        t.add(u, 40, 40, 6.0, 1)  # a wire: along one row
    t.add(40, 50, 51, 2.0, 2)
    t.add(41, 50, 51, 2.0, 2)  # two by two pixels: nowhere
    # seven pixels are asked for: the outermost column of the wire finds six others on its one side
    assert keep(t.build()) == [3, *range(20, 30)]


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
    strips = np.zeros(len(rows), s.STRIP)
    for i, (u, top, bottom, _) in enumerate(rows):
        strips["column"][i], strips["top_row"][i], strips["bottom_row"][i] = u, top, bottom
    support.mark_cuts(strips, len(rows), g.H, k.width, k.height, Params().cut_rows)
    np.testing.assert_array_equal(strips["cut"], [r[3] for r in rows])


def test_an_end_is_cut_within_its_rows_of_the_border() -> None:
    k = INFO.intrinsics
    g = view_geometry(INFO, level(0.0, 0.0), Params())
    for rows in (1, 2, 4):
        strips = np.zeros(5, s.STRIP)
        strips["column"], strips["top_row"], strips["bottom_row"] = g.cols // 2, np.arange(5), k.height // 2
        support.mark_cuts(strips, 5, g.H, k.width, k.height, rows)
        assert strips["cut"].tolist() == [int(top < rows) for top in range(5)]

"""Parts that stand out of a plane and are too small to shift it become planes of their own, and nothing is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import outlier_split as standouts
from core.stages import planes as pl
from core.stages import strips as s
from core.stages.line_fit import add_point
from core.stages.segments import is_jump
from core.stages.settings import view_settings

from . import naive
from .columns import F
from .tables import Strips

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
P = Params()


class Measured:
    """Strips as measured planes a, b: each of the plane in `plane_of_strip`."""

    def __init__(self, table: Strips, lines: list[tuple[float, float]], plane_of_strip: np.ndarray) -> None:
        self.t, self.count, size = table, len(lines), 2 * table.n + 16
        self.planes, self.plane_of = np.zeros(size, pl.PLANE), np.zeros(size, np.int32)
        self.tables = pl.PlaneTables(self.planes, self.plane_of, np.zeros(size, np.int32))
        self.plane_of[: self.count] = np.arange(self.count)
        table.strips["track"] = plane_of_strip
        t = (table.strips["column"] - table.view.cu) / F
        inverse = table.strips["disparity_px"].astype(float) / F
        for k, (a, b) in enumerate(lines):
            own, plane = plane_of_strip == k, self.planes[k]
            plane.a, plane.b, plane.t0, plane.t1 = a, b, t[own].min() - 0.5 / F, t[own].max() + 0.5 / F
            for x, y in zip(t[own], inverse[own], strict=True):
                add_point(plane, x, y, 1.0)
        self.measure()

    def measure(self) -> None:
        settings = view_settings(self.t.view, 0.001, P)[0]
        settings.footprint_t = 0.0
        pl.measure_planes(self.t.list, self.t.view, settings, self.count, self.tables)

    def split(self, params: Params = P) -> int:
        """split_outliers; number of new planes."""
        before, t, settings = self.count, self.t, view_settings(self.t.view, 0.001, params)[0]
        self.count = standouts.split_outliers(t.list, t.view, settings, before, before, self.tables)
        self.measure()
        return self.count - before

    def of_strip(self) -> np.ndarray:
        return self.plane_of[self.t.strips["track"]]


def wall(leaves: dict[int, float], x_m: float = 5.0, rows: int = 60) -> Measured:
    """A wall square to the axis; in some columns a few rows of a leaf before it, taken for the wall's."""
    t = Strips(cols=80)
    for u in range(10, 70):
        if u in leaves:
            t.add(u, 20, 24, leaves[u], 5)
        t.add(u, 25, 24 + rows, x_m, rows)
    t.build()
    return Measured(t, [(1.0 / x_m, 0.0)], np.zeros(t.n, np.int64))


def test_a_leaf_before_a_wall_is_a_plane_of_its_own_and_leaves_the_wall_where_it_stands() -> None:
    m = wall({30: 4.0, 31: 4.0, 32: 4.02})
    assert m.planes[0].front_m == pytest.approx(1.0 - 0.28, abs=0.01)
    assert m.split() == 1
    pl.shift_to_near_side(m.count, m.planes, 0.05)
    assert pl.distance_at(m.planes[0], 0.0) == pytest.approx(5.0)
    leaf = m.planes[1]
    assert pl.distance_at(leaf, (31 - m.t.view.cu) / F) == pytest.approx(4.0, abs=0.02)
    assert leaf.t1 - leaf.t0 >= 3.0 / F
    assert m.of_strip().tolist().count(1) == 3
    assert m.planes[1].support == 15 * s.PX
    assert m.planes[1].inferred == 0


def test_leaves_apart_in_columns_or_in_depth_are_planes_apart() -> None:
    assert wall({20: 4.0, 21: 4.0, 50: 4.0}).split() == 2
    assert wall({20: 4.0, 21: 3.0}).split() == 2


def test_what_holds_more_of_a_plane_than_a_stray_part_shifts_it() -> None:
    """Half of a wall stands a metre out: that is no leaf, the whole plane comes forward."""
    m = wall(dict.fromkeys(range(10, 40), 4.0), rows=20)
    assert m.split() == 0
    assert m.planes[0].front_m == pytest.approx(1.0 - 0.28, abs=0.01)


def test_a_surface_that_scatters_is_shifted_as_a_whole() -> None:
    rng = np.random.default_rng(1)
    t = Strips(cols=80)
    for u in range(10, 70):
        t.add(u, 20, 79, 5.0 + rng.uniform(-0.7, 0.7))
    m = Measured(t.build(), [(0.2, 0.0)], np.zeros(t.n, np.int64))
    assert m.planes[0].front_m > 0.3
    assert m.split() == 0


def test_a_step_too_small_to_matter_makes_no_plane() -> None:
    assert wall({30: 4.68}).split() == 0  # 0.04 m beyond the safe distance
    assert wall({30: 4.5}).split() == 1


@given(SEED)
def test_every_near_edge_stays_within_the_safe_distance_of_its_plane(seed: int) -> None:
    """Splitting and shifting together keep what shifting alone promises; no strip is lost or changed."""
    rng = np.random.default_rng(seed)
    t = Strips(cols=80)
    for u in range(5, 75):
        t.add(u, 20, 50, 5.0 - (rng.uniform(0.0, 3.0) if rng.random() < 0.1 else 0.0), int(rng.integers(1, 30)))
        t.add(u, 52, 90, 6.0 - (rng.uniform(0.0, 1.0) if rng.random() < 0.5 else 0.0), int(rng.integers(1, 30)))
    t.build()
    before = t.strips.copy()
    m = Measured(t, [(0.2, 0.0), (1.0 / 6.0, 0.01)], (t.strips["top_row"] >= 52).astype(np.int64))
    m.split(Params(stand_out_share=float(rng.uniform(0.0, 0.3))))
    pl.shift_to_near_side(m.count, m.planes, 0.05)
    for name in ("disparity_px", "near_px", "sigma_px"):
        np.testing.assert_array_equal(t.strips[name], before[name])
    for row, k in zip(t.strips, m.of_strip(), strict=True):
        y_over_x = (row["column"] - t.view.cu) / F
        p = m.planes[k]
        behind = pl.distance_at(p, y_over_x) - F / float(row["near_px"])
        assert behind * math.hypot(1.0, y_over_x) <= P.safe_along_m + 1e-5
        assert p.t0 <= y_over_x <= p.t1
        assert p.top_m <= pl.distance_at(p, y_over_x) * float(t.view.tan_edge[row["top_row"]]) + 1e-9


@given(SEED)
def test_outliers_and_their_groups_against_trying_every_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = Strips(cols=60)
    for u in range(5, 55):
        for top in (10, 30, 50, 70)[: int(rng.integers(1, 5))]:
            out = rng.uniform(0.0, 2.0) if rng.random() < 0.2 else 0.0
            t.add(u, top, top + int(rng.integers(2, 21)), 5.0 - out, int(rng.integers(1, 60)))
    t.build()
    which = rng.integers(0, 2, t.n) if rng.random() < 0.5 else np.zeros(t.n, np.int64)
    which[:2] = 0, which.max()
    lines = [(0.2, 0.0), (0.21, 0.02)][: int(which.max()) + 1]
    m = Measured(t, lines, which)
    params = Params(stand_out_share=float(rng.uniform(0.0, 0.2)), stand_out_spreads=float(rng.uniform(0.0, 2.0)))
    excess = np.empty(t.n)
    for i, row in enumerate(t.strips):
        y_over_x = (row["column"] - t.view.cu) / F
        a, b = lines[which[i]]
        along = (1.0 / (a + b * y_over_x) - F / float(row["near_px"])) * math.hypot(1.0, y_over_x)
        cosine = (a + b * y_over_x) / (math.hypot(a, b) * math.hypot(1.0, y_over_x))
        excess[i] = max(along * cosine - P.safe_distance_m, (along - P.safe_along_m) * cosine)
    leaves: list[int] = []
    for k, (a, b) in enumerate(lines):
        own = np.flatnonzero(which == k)
        y_over_x = (t.strips["column"][own] - t.view.cu) / F
        inverse = t.strips["disparity_px"][own].astype(float) / F
        spread = math.sqrt(np.mean((inverse - a - b * y_over_x) ** 2)) / np.mean(inverse) ** 2
        strips = [(excess[i], int(t.strips["support"][i])) for i in own]
        least = naive.least_excess(strips, params.stand_out_share, params.stand_out_m, params.stand_out_spreads, spread)
        leaves += [int(i) for i in own if excess[i] > 0.0 and excess[i] >= least]
    leaves.sort()

    def meets(i: int, j: int) -> bool:
        return not is_jump(t.strips[leaves[i]], t.strips[leaves[j]])

    rows = [
        (int(t.strips["column"][i]), int(t.strips["top_row"][i]), int(t.strips["bottom_row"][i]), int(which[i]))
        for i in leaves
    ]
    expected = [[leaves[i] for i in group] for group in naive.runs(rows, P.link_gap_px, meets)]
    first = m.count
    assert m.split(params) == len(expected)
    found = m.of_strip()
    assert [np.flatnonzero(found == first + k).tolist() for k in range(len(expected))] == expected
    stay = np.setdiff1d(np.arange(t.n), leaves)
    np.testing.assert_array_equal(found[stay], which[stay])

"""Gaps of one column that the vehicle cannot pass are filled; what it can pass stays open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.params import Params
from core.stages import gap_filling as fill
from core.stages import strips as s
from core.stages.settings import view_settings

from .tables import Strips

pytestmark = pytest.mark.nojit
P = Params()
X = 5.0
"""At 5 m a row or column is 5 cm: Hs = 20 rows, Ws = 40 columns."""


def filled(t: Strips, hs: float = 1.0, ws: float = 2.0) -> int:
    """fill_columns; returns how many slits were filled."""
    settings = view_settings(t.view, 0.001, replace(P, passable_height_m=hs, passable_width_m=ws))[0]
    return fill.fill_columns(t.strips, int(t.cluster_of.max()) + 1, t.columns, settings)


def alive(t: Strips) -> list[tuple[int, int, int]]:
    """(column, top, bottom) of what is left."""
    return [(int(r["column"]), int(r["top_row"]), int(r["bottom_row"])) for r in t.strips if r["support"] > 0]


def pair(gap: int, lower_x: float = X, columns: int = 1) -> Strips:
    t = Strips()
    for u in range(columns):
        t.add(u, 10, 29, X)
        t.add(u, 30 + gap, 30 + gap + 19, lower_x)
    t.build()
    t.cluster()
    t.strips["cluster"] = 0
    return t


@pytest.mark.parametrize(("gap", "joined"), [(0, True), (5, True), (19, True), (20, False), (25, False)])
def test_a_gap_is_filled_when_it_is_lower_than_a_passable_height(gap: int, joined: bool) -> None:
    t = pair(gap)
    filled(t)
    assert alive(t) == ([(0, 10, 49 + gap)] if joined else [(0, 10, 29), (0, 30 + gap, 49 + gap)])
    assert t.strips["filled_rows"][0] == (gap if joined else 0)
    if joined:
        assert t.strips["support"][0] == 40 * s.PX


def test_between_surfaces_apart_in_depth_the_farther_one_grows() -> None:
    t = pair(5, lower_x=6.0)
    filled(t)
    assert alive(t) == [(0, 10, 29), (0, 30, 54)]
    assert t.strips["filled_rows"][1] == 5
    t = pair(5, lower_x=4.5)
    filled(t)
    assert alive(t) == [(0, 10, 34), (0, 35, 54)]
    np.testing.assert_allclose(t.view.f_px / t.strips["disparity_px"], [5.0, 4.5], rtol=1e-5)


def test_gaps_between_clusters_stay() -> None:
    t = pair(5)
    t.strips["cluster"][1] = 1
    filled(t)
    assert len(alive(t)) == 2


def test_several_gaps_of_one_column_fill_one_after_the_other() -> None:
    t = Strips()
    for top in (0, 15, 30, 45):
        t.add(0, top, top + 9, X)
    t.build().cluster()
    filled(t)
    assert alive(t) == [(0, 0, 54)]
    assert t.strips["filled_rows"][0] == 15


def test_the_space_under_a_bridge_stays_open() -> None:
    t = Strips()
    for u in range(60):
        t.add(u, 10, 20, X)
        if u in (*range(8), *range(52, 60)):
            t.add(u, 21, 90, X)  # its piers
    t.build().cluster()
    filled(t)
    assert len(alive(t)) < t.n  # piers join the deck above them
    assert all(bottom == 20 for u, _, bottom in alive(t) if 8 <= u < 52)


def opening(width: int, closed: bool = True, sill: bool = True) -> Strips:
    """A wall with an opening of `width` columns and 25 rows (1.25 m) in its middle."""
    t = Strips(cols=100)
    for u in range(100):
        inside = 40 <= u < 40 + width
        if not inside and not (u >= 40 + width and not closed):
            t.add(u, 5, 90, X)
        else:
            t.add(u, 5, 39, X)
            if sill:
                t.add(u, 65, 90, X)
    t.build().cluster()
    return t


@pytest.mark.parametrize(("width", "slit"), [(4, True), (20, True), (38, True), (41, False), (55, False)])
def test_an_opening_narrower_than_the_vehicle_is_filled(width: int, slit: bool) -> None:
    t = opening(width)
    assert filled(t) == (width if slit else 0)
    inside = [(top, bottom) for u, top, bottom in alive(t) if 40 <= u < 40 + width]
    assert inside == ([(5, 90)] * width if slit else [(5, 39), (65, 90)] * width)
    if slit:
        assert (t.strips["filled_rows"][(t.strips["filled_rows"] > 0)] == 25).all()


def test_an_opening_that_goes_on_to_the_side_stays() -> None:
    assert filled(opening(20, closed=False)) == 0


def test_a_narrow_opening_at_the_edge_of_what_is_seen_stays() -> None:
    """Twenty columns are less than Ws, but the width beyond the border is unknown."""
    t = Strips(cols=60)
    for u in range(60):
        if u < 40:
            t.add(u, 5, 90, X)
        else:
            t.add(u, 5, 39, X)
            t.add(u, 65, 90, X)
    t.build().cluster()
    assert filled(t) == 0


def test_a_notch_without_a_sill_is_no_slit() -> None:
    assert filled(opening(20, sill=False)) == 0


def test_more_openings_than_there_is_room_for_stay_open_and_within_bounds() -> None:
    t = Strips(cols=4)
    for u in range(4):
        for k in range(50):
            t.add(u, 2 * k, 2 * k, 100.0)  # 1 m a row: fifty gaps of 1 m in a column
    t.build()
    t.strips["cluster"] = 0
    filled(t, hs=0.9)
    assert len(alive(t)) >= 200 - 4 * fill.MAX_RUNS

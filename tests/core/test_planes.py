"""Planes: heights, near sides, merging, meeting, pockets and what covers what."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from core.buffers import Buffers
from core.params import Params
from core.stages import openings, refine
from core.stages import planes as pl
from core.stages import strips as s
from core.stages.depth_bias import DepthBias
from core.stages.evidence import Cover, Evidence
from core.stages.ground import NO_GROUND
from core.stages.model import PublishedPlanes, published_planes
from core.stages.openings import OpeningMasks
from core.stages.settings import view_settings
from core.stages.view_geometry import ViewGeometry
from core.types import Ground

from .columns import F, code, view
from .tables import CLOSED, Strips, ends, plane_table

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
P = Params()


OPEN_EVERYWHERE = CLOSED._replace(masks=np.ones_like(CLOSED.masks))
COVER = Cover(Evidence(np.zeros((20, 20), np.float32), F / 8, F / 8, 10.0, 10.0), CLOSED, np.zeros((2, 22), np.int32))
"""Nothing was measured, and there is no opening."""


def plain(params: Params = P, **changed: float) -> np.ndarray:
    """A record of VIEW_SETTINGS of a view with columns of one pixel, without footprints, with some fields changed."""
    settings = view_settings(view(), 0.001, params)[0]
    settings.half_column_t, settings.footprint_t = 0.5 / F, 0.0
    for name, value in changed.items():
        setattr(settings, name, value)
    return settings


def tables_for(planes: np.ndarray) -> pl.PlaneTables:
    """Tables in which each track belongs to the first plane."""
    return pl.PlaneTables(planes, np.zeros(len(planes), np.int32), np.zeros(len(planes), np.int32))


def whole_way(t: Strips, safe_m: float = 0.28, footprint: float = 0.0) -> tuple[np.ndarray, int]:
    """Tracks of a table of strips as measured planes."""
    count = t.track(hs=1.0)
    size = 2 * t.n + 16
    tables = tables_for(np.zeros(size, pl.PLANE))
    settings = plain(safe_distance_m=safe_m, footprint_t=footprint / F)
    pl.planes_from_tracks(count, t.tracks, settings, tables)
    pl.measure_planes(t.list, t.view, settings, count, tables)
    return tables.planes, count


def test_a_wall_measures_its_heights_its_ends_and_its_support() -> None:
    t = Strips(cols=60)
    for u in range(10, 50):
        t.add(u, 20, 79, 5.0, 30)
    t.build().cluster()
    planes, count = whole_way(t)
    assert count == 1
    p = planes[0]
    assert p.top_m == pytest.approx(5.0 * (20 - 50) / F)
    assert p.bottom_m == pytest.approx(5.0 * (80 - 50) / F)
    assert ends(p) == pytest.approx((5.0, 5.0 * (9.5 - 29.5) / F, 5.0, 5.0 * (49.5 - 29.5) / F), abs=1e-3)
    assert planes[0].support == 40 * 30 * s.PX
    assert (planes[0].columns, planes[0].rows) == (40, 40 * 60)
    assert p.front_m == pytest.approx(-0.28, abs=1e-3)
    higher, _ = whole_way(t, footprint=1.0)
    assert higher[0].top_m == pytest.approx(5.0 * (19 - 50) / F)


@given(SEED, st.floats(0.05, 1.5), st.floats(-0.3, 0.3))
@example(1, 1.5, 0.3)
@example(2, 1.5, -0.3)
def test_no_plane_stays_farther_behind_its_near_edges_than_the_safe_distance(seed: int, out: float, b: float) -> None:
    rng = np.random.default_rng(seed)
    t = Strips(cols=80)
    for u in range(10, 70):
        x = 1.0 / (0.2 + b * (u - 39.5) / F)
        t.add(u, 20, 80, x, near_m=x - out * rng.random())
    t.build().cluster()
    planes, count = whole_way(t)
    pl.shift_to_near_side(count, planes, 0.05)
    for r in t.strips:
        p = planes[r["track"]]
        y_over_x = (r["column"] - t.view.cu) / F
        near = F / float(r["near_px"])
        # perpendicular distance of the near edge in front of the plane a x + b y = 1
        front = (1.0 - near * (p.a + p.b * y_over_x)) / math.hypot(p.a, p.b)
        assert front <= 0.28 + 1e-6
        along = (pl.distance_at(p, y_over_x) - near) * math.hypot(1.0, y_over_x)
        assert along <= 0.5 + 1e-6


def test_a_plane_in_place_is_not_moved() -> None:
    planes = plane_table((5.0, -1.0, 5.0, 1.0, -1.0, 1.0))
    before = planes.copy()
    pl.shift_to_near_side(1, planes, 0.05)
    np.testing.assert_array_equal(planes, before)
    planes[0].front_m = 0.4
    pl.shift_to_near_side(1, planes, 0.05)
    assert pl.distance_at(planes[0], 0.1) == pytest.approx(4.6)


@pytest.mark.parametrize(("top", "bottom"), [(0.4, 1.8), (-2.0, -0.5), (-1.0, 1.0)])
def test_a_plane_that_comes_nearer_still_stops_all_its_rays(top: float, bottom: float) -> None:
    """Seen from above, a bush that is moved nearer at the same height would let the rays to its top pass over it."""
    planes = plane_table((5.0, -1.0, 5.0, 1.0, top, bottom))
    planes[0].front_m = 1.0
    pl.shift_to_near_side(1, planes, 0.05)
    x = pl.distance_at(planes[0], 0.0)
    assert x == pytest.approx(4.0)
    assert planes[0].top_m / x <= top / 5.0 + 1e-12
    assert planes[0].bottom_m / x >= bottom / 5.0 - 1e-12
    assert planes[0].top_m <= top
    assert planes[0].bottom_m >= bottom


def test_distance_where_the_line_never_crosses_the_ray() -> None:
    planes = plane_table((5.0, 1.0, 10.0, 1.0, -1.0, 1.0))
    assert pl.distance_at(planes[0], 0.1) == pytest.approx(10.0)
    assert pl.distance_at(planes[0], -0.1) == pl.MOST_M


def test_a_rough_strip_is_not_pushed_behind_itself_by_its_neighbours() -> None:
    """Twigs half a metre in front of a wall, over which a median has spread the wall's distance."""
    for kind, front in ((s.SMOOTH, -0.28), (s.ROUGH, 0.5 - 2 * 0.005 - 0.28)):
        t = Strips(cols=60, sigma_px=0.02)
        for u in range(10, 50):
            t.add(u, 20, 79, 5.0, 30)
        t.build().cluster()
        planes, count = whole_way(t)
        assert count == 1
        t.strips["kind"][20] = kind
        t.strips["disparity_px"][20] = F / 4.5
        settings = plain()
        pl.measure_planes(t.list, t.view, settings, 1, tables_for(planes))
        assert planes[0].front_m == pytest.approx(front, abs=0.01)


def published(
    count: int, planes: np.ndarray, ground: Ground = NO_GROUND, bias_per_m: float = 0.0
) -> PublishedPlanes | None:
    bias = DepthBias(bias_per_m, 1.0, 0.0)
    return published_planes(planes[:count], ground, view(), bias, view_settings(view(), 0.001, P))


def test_hidden_planes_are_not_published_and_the_others_keep_their_order() -> None:
    planes = plane_table(*((x, -1.0, x, 1.0, -1.0, 1.0) for x in (5.0, 6.0, 7.0, 8.0)))
    planes["cluster"][:4], planes["support"][:4] = (0, 1, 2, 3), (160, -1, 320, -1)
    message = published(4, planes)
    assert message is not None
    rows, margin, _, flags, support_px, cluster = message
    assert rows[:, 0].tolist() == pytest.approx([5.0, 7.0], abs=1e-4)
    assert (support_px.tolist(), cluster.tolist()) == ([10, 20], [0, 2])
    assert len(margin) == len(flags) == 2
    ground = Ground(seen=True, height_m=0.5)
    message = published(2, planes, ground)
    assert message is not None
    rows = message[0]
    assert rows[:, 5].tolist() == pytest.approx([0.5 + P.ground_tolerance_m] * 2, abs=1e-4)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["a", "b", "t0", "t1", "top_m", "bottom_m", "front_m"])
def test_where_a_plane_is_not_finite_none_is_published(name: str, number: float) -> None:
    planes = plane_table((5.0, -1.0, 5.0, 1.0, -1.0, 1.0), (7.0, -1.0, 7.0, 1.0, -1.0, 1.0))
    assert published(2, planes) is not None
    planes[name][1] = number
    assert published(2, planes) is None


# ---- refine -----------------------------------------------------------------------------------------------------


def test_two_walls_meet_in_their_corner() -> None:
    planes = plane_table((6.0, -2.0, 6.0, 1.9, -1, 1), (5.9, 2.0, 3.0, 2.0, -1, 1))
    refine.extend_to_corners(2, planes, plain(reach_t=40 / F), COVER)
    assert ends(planes[0])[2:] == pytest.approx((6.0, 2.0))
    assert ends(planes[1])[:2] == pytest.approx((6.0, 2.0))


def test_walls_do_not_meet_over_an_opening() -> None:
    planes = plane_table((6.0, -2.0, 6.0, 1.9, -1, 1), (5.9, 2.0, 3.0, 2.0, -1, 1))
    before = planes.copy()
    refine.extend_to_corners(2, planes, plain(reach_t=40 / F), COVER._replace(openings=OPEN_EVERYWHERE))
    np.testing.assert_array_equal(planes, before)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("nearest_m", "meet"), [(math.inf, True), (6.2, True), (9.0, False)])
def test_walls_do_not_meet_over_what_was_measured_behind_them(nearest_m: float, meet: bool, side: int) -> None:
    """As under a lintel: the cell of the view between the two walls is not measured, shows the longer wall, or shows what is
    3 m behind it. side: 1 where that wall is the left one."""
    left, right = (6.0, -2.0, 6.0, 1.6), (5.9, 2.0, 3.0, 2.0)
    if side < 0:
        left, right = (3.0, -2.0, 5.9, -2.0), (6.0, -1.6, 6.0, 2.0)
    planes, nearest = plane_table((*left, -1, 1), (*right, -1, 1)), np.zeros((20, 20), np.float32)
    before = planes.copy()
    nearest[13 if side > 0 else 6, 10] = 1.0 / nearest_m
    cover = COVER._replace(evidence=COVER.evidence._replace(nearest=nearest))
    refine.extend_to_corners(2, planes, plain(reach_t=40 / F), cover)
    if meet:
        assert ends(planes[0])[2:] == pytest.approx((6.0, 2.0 * side))
        assert ends(planes[1])[:2] == pytest.approx((6.0, 2.0 * side))
    else:
        np.testing.assert_array_equal(planes, before)


@pytest.mark.parametrize("change", ["far", "cluster", "heights", "parallel"])
def test_walls_that_do_not_meet_keep_their_ends(change: str) -> None:
    second = [5.9, 2.0, 3.0, 2.0, -1.0, 1.0]
    if change == "far":
        second[0] = 5.0
    if change == "heights":
        second[4:] = [1.5, 3.0]
    if change == "parallel":
        second[:4] = [6.0, 2.0, 6.0, 3.0]
    planes = plane_table((6.0, -2.0, 6.0, 1.9, -1, 1), tuple(second))
    planes[1].cluster = int(change == "cluster")
    before = planes.copy()
    refine.extend_to_corners(2, planes, plain(reach_t=40 / F), COVER)
    np.testing.assert_array_equal(planes, before)


def test_an_end_is_cut_back_only_where_the_other_takes_over_its_height() -> None:
    """A high wall that overshoots a low one by 20 cm keeps its end: no other plane covers its upper part."""
    for high, kept in ((-3.0, True), (-1.0, False)):
        planes = plane_table((6.0, -2.0, 6.0, 2.2, high, 1), (5.9, 2.0, 3.0, 2.0, -1, 1))
        refine.extend_to_corners(2, planes, plain(reach_t=40 / F), COVER)
        assert (ends(planes[0])[3] == pytest.approx(2.2)) == kept


@pytest.mark.parametrize("side", [1, -1])
def test_an_end_is_not_cut_back_where_the_other_plane_ends_before_it(side: int) -> None:
    """A long wall and a short piece of it that crosses it: cut at the crossing, the wall would have a slit between the end of
    the piece and the next wall."""
    for end, kept in ((0.9, True), (1.2, False)):
        a, b = (2.65, -1.0 * side, 2.65, 1.1 * side, -1, 1), (2.69, 0.7 * side, 2.62, end * side, -1, 1)
        planes = plane_table(*((a, b) if side > 0 else (b[2:4] + b[:2] + b[4:], a[2:4] + a[:2] + a[4:])))
        refine.extend_to_corners(2, planes, plain(reach_t=40 / F), COVER)
        outer = ends(planes[0])[3] if side > 0 else ends(planes[1])[1]
        assert (outer == pytest.approx(1.1 * side)) == kept


def test_an_end_is_cut_back_only_where_the_same_rays_are_stopped() -> None:
    """The flat top of a box, seen from above, in two sheets of the same heights: the nearer one lies lower in the view."""
    for low, kept in ((0.5, True), (-0.5, False)):
        planes = plane_table((5.0, -2.6, 6.0, -0.9, low, 0.6), (7.0, -3.6, 5.5, 0.5, low, 0.6))
        before = planes[1].copy()
        refine.extend_to_corners(2, planes, plain(passable_width_m=20.0, reach_t=200 / F), COVER)
        assert (planes[1].t0 == before.t0) == kept


def test_what_takes_over_an_end_takes_over_all_of_its_height() -> None:
    """A wire that sinks by 2 cm from piece to piece, less than the slack: none of it may be lost where pieces meet."""
    planes = plane_table((3.0, -1.0, 3.0, 0.1, -0.54, -0.5), (3.02, -0.1, 2.8, 1.0, -0.52, -0.48))
    refine.extend_to_corners(2, planes, plain(passable_width_m=4.0, reach_t=40 / F), COVER)
    cut, longer = planes[0], planes[1]
    assert cut.t1 == longer.t0 < 0.1 / 3.0
    assert longer.top_m <= -0.54 + 1e-9
    assert (longer.bottom_m, cut.bottom_m) == pytest.approx((-0.48, -0.48), abs=0.01)


def test_an_end_that_stands_out_in_front_of_the_other_plane_stays() -> None:
    """A spike towards the camera whose end overshoots a wall: cut back, nothing would stand where it was seen."""
    for near, kept in ((5.0, True), (5.9, False)):
        planes = plane_table((6.5, -0.2, near, 0.2, -1, 1), (6.0, 0.1, 6.0, 2.0, -1, 1))
        refine.extend_to_corners(2, planes, plain(passable_width_m=4.0, reach_t=40 / F), COVER)
        assert (ends(planes[0])[2:] == pytest.approx((near, 0.2))) == kept


POCKET = {"passable_width_m": 2.0, "pocket_behind_m": 0.3}


def pockets(*rows: tuple[float, ...], masks: OpeningMasks = CLOSED) -> np.ndarray:
    planes = plane_table(*rows)
    return planes[: refine.close_concavities(len(rows), planes, plain(**POCKET), masks)]


def test_a_notch_narrower_than_the_vehicle_is_spanned_and_marked_inferred() -> None:
    wall = [(6.0, -3.0, 6.0, -0.7, -1, 1), (6.0, 0.7, 6.0, 3.0, -1, 1)]
    planes = pockets(*wall, (7.5, -0.7, 7.5, 0.7, -1, 1))
    new = planes[3]
    assert ends(new) == pytest.approx((6.0, -0.7, 6.0, 0.7))
    assert (new.top_m, new.bottom_m, new.inferred, new.support) == (-1, 1, 1, 0)
    refine.drop_covered(len(planes), planes, 2.0, 1 / F)
    # the back of the notch, and the chord between it and its side, are covered by the one across its mouth
    assert np.flatnonzero(planes["support"] >= 0).tolist() == [0, 1, 3]


def test_wide_seen_through_and_covered_gaps_are_not_spanned() -> None:
    wide = [(6.0, -3.0, 6.0, -1.1, -1, 1), (6.0, 1.1, 6.0, 3.0, -1, 1)]
    assert len(pockets(*wide)) == 2
    narrow = [(6.0, -3.0, 6.0, -0.7, -1, 1), (6.0, 0.7, 6.0, 3.0, -1, 1)]
    assert len(pockets(*narrow, masks=OPEN_EVERYWHERE)) == 2
    assert len(pockets(*narrow, (5.0, -0.9, 5.0, 0.9, -1, 1))) == 3  # a spike already stands before it
    apart = [(6.0, -3.0, 6.0, -0.7, -3, -1), (6.0, 0.7, 6.0, 3.0, 0, 1)]
    assert len(pockets(*apart)) == 2  # no height in common


@pytest.mark.parametrize("gap_m", [0.0, 1e-12])
def test_planes_that_meet_leave_no_gap(gap_m: float) -> None:
    """A chord without width has no line."""
    planes = plane_table((6.0, -3.0, 6.0, 0.0, -1, 1), (6.0, gap_m, 6.0, 3.0, -1, 1))
    assert refine.close_concavities(2, planes, plain(**POCKET), CLOSED) == 2


def test_pockets_never_write_past_their_table() -> None:
    rows = [(6.0, -3.0, 6.0, -0.7, -1, 1), (6.0, 0.7, 6.0, 3.0, -1, 1)]
    planes = plane_table(*rows, room=0)
    assert refine.close_concavities(2, planes, plain(**POCKET), CLOSED) == 2


def test_what_one_nearer_plane_hides_wholly_is_dropped_and_only_that() -> None:
    front = (5.0, -1.0, 5.0, 1.0, -1.0, 1.0)

    def left(other: tuple[float, ...]) -> list[bool]:
        planes = plane_table(front, other)
        refine.drop_covered(2, planes, 2.0, 1e-6)
        return (planes["support"][:2] >= 0).tolist()

    assert left((6.0, -1.0, 6.0, 1.0, -1.0, 1.0)) == [True, False]
    assert left((7.5, -1.0, 7.5, 1.0, -1.0, 1.0)) == [True, True]  # a vehicle fits between
    assert left((6.0, -1.0, 6.0, 2.0, -1.0, 1.0)) == [True, True]  # stands out to the side
    assert left((6.0, -1.0, 6.0, 1.0, -1.5, 1.0)) == [True, True]  # stands out above
    assert left((4.0, -0.1, 4.0, 0.1, -0.2, 0.2)) == [True, True]  # a spike in front of it stays
    assert left((4.5, -0.5, 5.5, 0.5, -0.5, 0.5)) == [True, True]  # crosses it


def test_equal_planes_do_not_drop_each_other() -> None:
    row = (5.0, -1.0, 5.0, 1.0, -1.0, 1.0)
    planes = plane_table(row, row)
    refine.drop_covered(2, planes, 2.0, 1e-6)
    assert (planes["support"][:2] >= 0).sum() == 1
    assert planes["support"][:2].max() == 2000


def trimmed(*rows: tuple[float, ...], depth: float = 2.0) -> tuple[np.ndarray, list[bool]]:
    planes = plane_table(*rows)
    cells = Evidence(np.zeros((40, 40), np.float32), F / 4, F / 4, 20.0, 20.0)
    refine.trim_covered(len(rows), planes, depth, cells)
    return planes[: len(rows)], (planes["support"][: len(rows)] >= 0).tolist()


def test_what_several_nearer_planes_hide_together_is_dropped() -> None:
    front = [(5.0, -2.0, 5.0, 0.0, -1.5, 1.5), (5.0, 0.0, 5.0, 2.0, -1.5, 1.5)]
    assert trimmed(*front, (6.0, -1.0, 6.0, 1.0, -1.0, 1.0))[1] == [True, True, False]
    assert trimmed(*front, (7.5, -1.0, 7.5, 1.0, -1.0, 1.0))[1] == [True, True, True]  # too far behind
    assert trimmed(*front, (4.5, -1.0, 4.5, 1.0, -1.0, 1.0))[1] == [True, True, True]  # in front


def test_a_plane_is_cut_back_to_what_is_not_hidden() -> None:
    planes, alive = trimmed((5.0, -2.0, 5.0, 0.0, -2.5, 2.5), (5.5, -1.0, 5.5, 2.0, -1.0, 1.0))
    assert alive == [True, True]
    assert ends(planes[1])[0] == 5.5
    assert -0.25 <= ends(planes[1])[1] <= 0.0  # to a cell: 0.22 m
    assert ends(planes[1])[3] == pytest.approx(2.0)
    assert (planes[1].top_m, planes[1].bottom_m) == (-1.0, 1.0)


def test_a_plane_seen_edge_on_in_half_a_cell_is_trimmed_where_it_is() -> None:
    """Carried on to the middle of its cell it would pass through infinity and come out behind the camera."""
    near, far, middle, t1 = 0.148, 0.05, 2.5 / (F / 4), 2.9 / (F / 4)
    t0 = middle + (t1 - middle) * (far + 0.002) / (near + 0.002)  # 1/x is -0.002 at the middle of the cell
    edge_on = (1.0 / far, t0 / far, 1.0 / near, t1 / near, 0.2, 1.0)
    planes, alive = trimmed(edge_on)
    assert alive == [True]
    assert ends(planes[0]) == pytest.approx(edge_on[:4], rel=1e-5)
    assert (planes[0].top_m, planes[0].bottom_m) == pytest.approx((0.2, 1.0))


@given(SEED, st.sampled_from([0.5, 2.0]))
def test_trimming_moves_the_end_of_no_ray_by_more_than_the_depth(seed: int, depth: float) -> None:
    """Rays that met a plane meet one still, and the nearest one they met is the one they meet now."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(12):
        x0, x1 = rng.uniform(4.0, 8.0, 2)
        t0, t1 = np.sort(rng.uniform(-0.7, 0.7, 2)) + np.array([0.0, 0.02])
        z0, z1 = np.sort(rng.uniform(-2.5, 2.5, 2)) + np.array([0.0, 0.02])
        rows.append((x0, x0 * t0, x1, x1 * t1, z0, z1))
    before = plane_table(*rows)
    after, alive = trimmed(*rows, depth=depth)

    def nearest(planes: np.ndarray, keep: list[bool], t: float, m: float) -> float:
        met = [
            pl.distance_at(p, t)
            for p, k in zip(planes, keep, strict=False)
            if k and p.t0 <= t <= p.t1 and p.top_m <= m * pl.distance_at(p, t) <= p.bottom_m
        ]
        return min(met, default=pl.MOST_M)

    for t, m in rng.uniform(-0.7, 0.7, (150, 2)):
        was, now = nearest(before, [True] * 12, t, m), nearest(after, alive, t, m)
        # a slanted plane leaves a cell with another distance than it has in its middle
        assert now == was or now <= was + 0.35


# ---- openings ---------------------------------------------------------------------------------------------------


@given(SEED, st.integers(1, 5), st.integers(1, 5))
def test_open_cells_against_trying_every_box(seed: int, wide: int, high: int) -> None:
    rng = np.random.default_rng(seed)
    nearest = rng.choice([0, 50, 500], (9, 7), p=[0.05, 0.75, 0.2]).astype(np.uint16)
    mask = np.full(nearest.shape, 9, np.uint8)
    total = np.full((10, 8), 77, np.int32)
    openings.count_unknown(nearest, total)
    box = openings.Box(wide, high, 100, np.int32(0.2 * wide * high))
    openings.open_mask(nearest, box, total, np.full((2, 63), 9, np.uint8), mask)
    want = np.zeros(nearest.shape, np.uint8)
    for i in range(9 - wide + 1):
        for j in range(7 - high + 1):
            box = nearest[i : i + wide, j : j + high]
            if (box < 100).all() and 5 * np.sum(box == 0) <= box.size:
                want[i : i + wide, j : j + high] = 1
    np.testing.assert_array_equal(mask, want)


@given(SEED)
def test_the_nearest_object_in_a_cell_against_its_definition(seed: int) -> None:
    rng, cell = np.random.default_rng(seed), openings.CELL_PX
    cols, rows = rng.integers(2, 30, 2)
    codes = rng.choice([0, 1, 2, 300, 301, 40000, 65535], (cols, rows), p=[0.4, *[0.1] * 6]).astype(np.uint16)
    n = 12
    strips = np.zeros(n, s.STRIP)
    strips["column"], strips["top_row"] = rng.integers(0, cols, n), rng.integers(0, rows, n)
    strips["bottom_row"] = np.minimum(strips["top_row"] + rng.integers(0, rows, n), rows - 1)
    strips["support"] = rng.integers(0, 2, n)
    strips["disparity_px"] = rng.uniform(1.0, 3000.0, n)
    shape = -(-cols // cell), -(-rows // cell)
    nearest = np.full(shape, 7, np.uint16)
    openings.nearest_codes(codes, strips, n, 32.0, np.full(rows, 9, np.uint16), nearest)
    want = np.zeros(shape, int)
    for i, j in np.ndindex(shape):
        corners = sorted(
            int(codes[u, v])
            for u in (i * cell, min(cols, (i + 1) * cell) - 1)
            for v in (j * cell, min(rows, (j + 1) * cell) - 1)
        )
        want[i, j] = corners[2] if corners.count(0) < 2 else 0
    for r in strips:
        if r.support:
            part = want[r.column // cell, r.top_row // cell : r.bottom_row // cell + 1]
            np.maximum(part, int(min(65535.0, r.disparity_px * np.float32(32.0))), out=part)
    np.testing.assert_array_equal(nearest, want)


def masks_of(codes: np.ndarray) -> tuple[OpeningMasks, ViewGeometry]:
    g = view(rows=codes.shape[1], cols=codes.shape[0])
    passable = P.passable_width_m, P.passable_height_m
    return openings.find_openings(codes, np.zeros(1, s.STRIP), 0, g, 20.0, passable, Buffers()), g


def test_an_opening_in_a_wall_is_open_at_the_wall_and_its_frame_is_not() -> None:
    """A wall at 5 m with a hole of 60 x 40 columns (3 x 2 m), 15 m of air behind it."""
    codes = np.full((160, 120), code(5.0)[0], np.uint16)
    codes[50:110, 40:80] = code(18.0)[0]
    masks, g = masks_of(codes)

    def at(u: int, v: int) -> bool:
        return bool(openings.is_open(masks, (u - g.cu) / F, (v - g.cv) / F, 5.0))

    assert at(80, 60)
    assert at(54, 44)
    assert not at(30, 60)
    assert not at(80, 20)
    assert not at(-50, 60)
    small = np.full((160, 120), code(5.0)[0], np.uint16)
    small[60:90, 40:80] = code(18.0)[0]  # 1.5 m wide
    masks, _ = masks_of(small)
    assert not masks.masks[openings.layer_of(5.0, masks.steps_m)].any()


def test_unknown_is_not_open() -> None:
    masks, _ = masks_of(np.zeros((160, 120), np.uint16))
    assert not masks.masks.any()

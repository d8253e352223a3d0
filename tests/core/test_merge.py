"""The merge: which pieces become one plane, what a joined plane may cover, and in which order pairs are looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import evidence
from core.stages import line_fit as lines
from core.stages import merge as mg
from core.stages import merge_cost as pairs
from core.stages import planes as pl
from core.stages import priority_queue as pq
from core.stages.openings import OpeningMasks
from core.stages.settings import view_settings
from core.stages.strips import ROUGH, STRIP
from core.stages.view_geometry import SOURCE, pooled_geometry, view_geometry
from core.types import Intrinsics

from . import naive
from .columns import F, view
from .tables import Strips, ends, line_through, plane_table
from .views import INFO, level

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
CELLS = 80
FRAME = (F / 2, F / 2, CELLS / 2, CELLS / 2)
"""A grid of 80 x 80 cells of two pixels."""
STEPS = np.array([0.7, 1.0, 2.0, 4.0, 8.0])
CLOSED = OpeningMasks(np.zeros((6, CELLS, CELLS), np.uint8), STEPS, *FRAME)
OPEN = CLOSED._replace(masks=np.ones_like(CLOSED.masks))


def grid_of(rows: list[tuple[float, ...]]) -> np.ndarray:
    """1/x of the rectangles (a_x, a_y, b_x, b_y, top, bottom) in the cells whose centres they cover."""
    grid = np.zeros((CELLS, CELLS), np.float32)
    for ax, ay, bx, by, top, bottom in rows:
        a, b = line_through((ax, ay), (bx, by))
        for i in range(CELLS):
            t = (i + 0.5 - FRAME[2]) / FRAME[0]
            for j in range(CELLS):
                z = (j + 0.5 - FRAME[3]) / FRAME[1] / (a + b * t)
                if ay / ax <= t <= by / bx and top <= z <= bottom:
                    grid[i, j] = max(grid[i, j], a + b * t)
    return grid


def pieces_of(rows: list[tuple[float, ...]]) -> np.ndarray:
    """Planes of rectangles with 20 strips each, 1 mm exact."""
    planes = plane_table(*rows)
    for plane, (ax, ay, bx, by, *_) in zip(planes, rows, strict=False):
        lines.clear_moments(plane)
        for t in np.linspace(ay / ax, by / bx, 20):
            lines.add_point(plane, t, plane.a + plane.b * t, 1e6)
        plane.middle_m = pl.distance_at(plane, 0.5 * (plane.t0 + plane.t1))
    return planes


def merge(
    rows: list[tuple[float, ...]], masks: OpeningMasks = CLOSED, grid: np.ndarray | None = None, **changed: float
) -> np.ndarray:
    """The planes that are left of rectangles; no other thing is in view."""
    planes = pieces_of(rows)
    n, p = len(rows), Params(**changed)
    tables = pl.PlaneTables(planes, np.arange(n, dtype=np.int32), np.arange(len(planes), dtype=np.int32))
    settings = view_settings(view(), 0.0005, p)[0]
    seen = evidence.Evidence(grid_of(rows) if grid is None else grid, *FRAME)
    cover = evidence.Cover(seen, masks, np.zeros((2, seen.nearest.shape[1] + 2), np.int32))
    mg.join_planes(n, tables, settings, cover)
    alive = pl.compact_planes(n, n, tables)
    assert set(tables.plane_of.tolist()) == set(range(alive))
    assert planes["support"][:alive].sum() == 1000 * n
    return planes[:alive]


def test_pieces_of_one_wall_become_one_plane() -> None:
    got = merge([(6.0, -3.0, 6.0, -1.0, -1, 1), (6.05, -1.0, 6.05, 1.0, -1.2, 1), (5.95, 1.2, 5.95, 3.0, -1, 1)])
    assert len(got) == 1
    assert ends(got[0]) == pytest.approx((6.0, -3.0, 6.0, 3.0), abs=0.1)
    assert (got[0].top_m, got[0].bottom_m) == (-1.2, 1.0)


@pytest.mark.parametrize(
    "rows",
    [
        [(6.0, -3.0, 6.0, -1.0, -1, 1), (8.0, -1.0, 8.0, 1.0, -1, 1)],
        [(6.0, -3.0, 6.0, 0.0, -1, 1), (6.0, 0.0, 9.0, 3.0, -1, 1)],
        [(6.0, -3.0, 6.0, -1.2, -1, 1), (6.0, 1.2, 6.0, 3.0, -1, 1)],
        [(6.0, -1.0, 6.0, 1.0, -4, -1.5), (6.0, -1.0, 6.0, 1.0, 0.5, 2)],
        [(6.0, -3.0, 6.0, 0.0, -4, 1), (6.0, 0.0, 6.0, 3.0, 0.5, 1)],
    ],
    ids=[
        "a step in depth",
        "a corner",
        "a gap wider than Ws",
        "an opening between two heights",
        "a notch above the lower",
    ],
)
def test_different_objects_stay_apart(rows: list[tuple[float, ...]]) -> None:
    assert len(merge(rows)) == 2


def test_small_pieces_do_not_creep_over_a_corner_one_by_one() -> None:
    """An L of small pieces: rectangles that grow step by step would reach over the open quarter."""
    rows = [(6.0, 0.4 * i, 6.0, 0.4 * i + 0.4, 0.6, 1.0) for i in range(8)]
    rows += [(6.0, 0.0, 6.0, 0.4, -2.0 + 0.4 * i, -1.6 + 0.4 * i) for i in range(7)]
    got = merge(rows)
    # nothing farther than the reach (0.9 m) from what was seen is covered: the middle of the quarter, 1.5 m from both
    for p in got:
        assert not (6.0 * p.t0 < 2.4 < 6.0 * p.t1 and p.top_m < -1.2 < p.bottom_m)


@pytest.mark.parametrize(("behind_m", "planes"), [(0.2, 1), (0.7, 2)])
def test_a_plane_covers_a_wall_only_within_what_a_strip_may_be_behind_it(behind_m: float, planes: int) -> None:
    """A balcony in front of a house: one plane for its parapet and its end would stop rays to the wall below."""
    rows = [(6.0, -1.0, 6.0, 1.0, -1.0, 0.0), (6.0, 1.0, 6.0, 1.3, -1.0, 2.0)]
    wall = (6.0 + behind_m, -3.0, 6.0 + behind_m, 3.0, -2.0, 3.0)
    assert len(merge(rows, grid=grid_of([*rows, wall]))) == planes


def test_an_opening_that_was_seen_is_never_covered() -> None:
    rows = [(6.0, -3.0, 6.0, -0.2, -1, 1), (6.0, 0.2, 6.0, 3.0, -1, 1)]
    assert len(merge(rows)) == 1
    assert len(merge(rows, OPEN)) == 2


def test_a_join_never_shifts_a_large_plane_for_the_sake_of_a_small_one() -> None:
    """A wall and a twig half a metre in front of it: one plane in front of both would misplace the wall."""
    rows = [(6.0, -2.0, 6.0, 2.0, -1, 1), (5.4, -0.1, 5.4, 0.1, -0.5, 0.5)]
    assert len(merge(rows)) == 2
    assert len(merge([rows[0], (5.9, -0.1, 5.9, 0.1, -0.5, 0.5)])) == 1


def test_a_gap_is_as_wide_as_its_line_is_long() -> None:
    """Facing ends close in the view but far apart in depth."""
    rows = [(5.0, -0.6, 6.0, -0.2, -1, 1), (8.0, 0.3, 9.0, 0.7, -1, 1)]
    loose = {
        "merge_distance_m": 2.0,
        "merge_spread_m": 2.0,
        "merge_shift_m": 2.0,
        "join_gap_m": 3.0,
        "merge_empty_share": 1.0,
    }
    assert len(merge(rows, passable_width_m=20.0, passable_height_m=10.0, **loose)) == 1
    assert len(merge(rows, **loose)) == 2


@given(SEED, st.integers(1, 12))
def test_merging_never_moves_a_plane_farther_than_allowed(seed: int, n: int) -> None:
    """Random pieces: every piece is covered by its plane, which passes it within the tolerance or a shift."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(n):
        x, y, z = rng.uniform(5.0, 7.0), rng.uniform(-3, 3), rng.uniform(-2, 2)
        rows.append((x, y, x + rng.uniform(-0.3, 0.3), y + rng.uniform(0.2, 1.5), z, z + rng.uniform(0.2, 1.5)))
    rows = [r for r in rows if r[1] / r[0] < r[3] / r[2]]
    got = merge(rows)
    for ax, ay, bx, by, top, bottom in rows:
        middle = 0.5 * (ay / ax + by / bx)
        x = 1.0 / np.dot(line_through((ax, ay), (bx, by)), (1.0, middle))
        own = [
            p
            for p in got
            if p.t0 <= ay / ax + 1e-9 and p.t1 >= by / bx - 1e-9 and p.top_m <= top and p.bottom_m >= bottom
        ]
        assert min(abs(pl.distance_at(p, middle) - x) for p in own) < 3 * (0.3 + 0.02)


# ---- evidence ---------------------------------------------------------------------------------------------------


def test_evidence_is_the_nearest_strip_of_a_cell() -> None:
    t = Strips(cols=60)
    for u, top, bottom, x in ((10, 20, 43, 5.0), (11, 22, 43, 4.0), (20, 0, 7, 5.2), (30, 0, 99, 8.0)):
        t.add(u, top, bottom, x)
    t.build()
    t.strips["kind"][2] = ROUGH
    t.strips["support"][3] = 0
    grid = evidence.find_evidence(t.strips, t.n, t.view, image_of(60)).nearest
    assert grid.shape == (8, 13)
    assert grid[1, 2:6] == pytest.approx([0.25] * 4)
    assert grid[2, 0] == pytest.approx(1 / 5.0), "a rough strip is evidence as if it were 0.2 m nearer"
    assert np.count_nonzero(grid) == 5
    # the last cells reach beyond the image; a smaller image leaves cells without a measurement
    grid = evidence.find_evidence(t.strips, t.n, t.view, image_of(40)).nearest
    assert (grid[5:, :] > 1e3).all()
    assert (grid[:5, :12] < 1.0).all()


def image_of(width: int, height: int = 100) -> np.ndarray:
    """A record of SOURCE."""
    return np.array([(width, height, 1.0, 0.0, 15.0, 20.0, 0.3)], SOURCE)[0]


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.4, 0.2), (-0.3, -0.7), (-0.9, 0.1)])
@pytest.mark.parametrize("step", [1, 2])
def test_cells_that_look_beyond_the_image_are_blocked(pitch: float, roll: float, step: int) -> None:
    """step: columns that are pooled to one."""
    k, R = Intrinsics(160, 120, 120.0, 110.0, 79.5, 55.0), level(pitch, roll)
    full = view_geometry(replace(INFO, intrinsics=k), R, Params())
    g = pooled_geometry(full, step)
    found = evidence.find_evidence(np.zeros(1, STRIP), 0, g, image_of(k.width, k.height))
    assert found.nearest.shape == (-(-g.cols // 8), -(-g.rows // 8))
    outside = np.ones(found.nearest.shape, bool)
    for (i, j), _ in np.ndenumerate(outside):
        t, m = (i + 0.5 - found.cu) / found.across, (j + 0.5 - found.cv) / found.down
        u, v = full.cu + full.f_px * t, full.cv + full.f_px * m
        assert (u - 0.5 * (step - 1)) / step == pytest.approx(8 * i + 3.5)
        assert v == pytest.approx(8 * j + 3.5)
        at = naive.source_pixel(u, v, R, k, full.f_px, full.cu, full.cv)
        outside[i, j] = at is None or not (-0.5 <= at[0] <= k.width - 0.5 and -0.5 <= at[1] <= k.height - 0.5)
    assert not outside.all()
    np.testing.assert_array_equal(found.nearest > 1e3, outside)


@given(SEED, st.sampled_from([0.3, 0.6, 1.2]))
def test_what_a_joined_plane_covers_against_trying_every_square(seed: int, gap: float) -> None:
    rng = np.random.default_rng(seed)
    grid = np.zeros((20, 16), np.float32)
    grid[rng.random(grid.shape) < rng.uniform(0.4, 0.95)] = 0.2
    grid[rng.random(grid.shape) < rng.choice([0.1, 0.7])] = 0.1
    masks = (rng.random((6, *grid.shape)) < 0.02).astype(np.uint8)
    frame = np.array([rng.choice([25.0, 12.5]), 25.0, 10.0, 8.0])
    t0, t1, m0, m1 = *np.sort(rng.uniform(-0.5, 0.5, 2)), *np.sort(rng.uniform(-0.4, 0.4, 2))
    a, b = 0.2, float(rng.uniform(-0.01, 0.01))
    p = (t0, 0.5 * (t0 + t1), m0 / a, 0.5 * (m0 + m1) / a)
    q = (0.4 * t0 + 0.6 * t1, t1, m0 / a, m1 / a)
    rect = (t0, t1, m0 / a, m1 / a)
    settings = view_settings(view(), 0.0005, Params())[0]
    settings.sigma_s, settings.smear_s, settings.gap_m, settings.opening_slack_m = 0.001, 0.002, gap, 0.1
    boxes = evidence.Rectangle(*rect), a, b, evidence.Rectangle(*p), evidence.Rectangle(*q)
    openings = OpeningMasks(masks, STEPS, *frame)
    cover = evidence.Cover(evidence.Evidence(grid, *frame), openings, np.zeros((2, 18), np.int32))
    got = evidence.uncovered_share(*boxes, settings, cover)
    want = naive.uncovered_share(rect, a, b, p, q, settings.merge_distance_m, 0.005, gap, 0.1, grid, frame, masks[4])
    assert got == pytest.approx(want)


TALL = np.full((2, 7), 0.12)
LOW, NARROW, LEFT, RIGHT = TALL[:, :6], TALL[:1], TALL * [[1], [0]], TALL * [[0], [1]]
DIVIDED, APART = np.insert(TALL, 4, 0.2, axis=1), np.insert(TALL, 1, 0.2, axis=0)


@pytest.mark.parametrize(
    ("behind", "forbidden"),
    [(TALL, True), *((area, False) for area in (0.0 * TALL, LOW, NARROW, LEFT, RIGHT, DIVIDED, APART))],
    ids=["tall", "unmeasured", "low", "narrow", "left column", "right column", "two low ones", "two narrow ones"],
)
def test_a_tall_area_behind_which_something_was_measured_forbids_the_plane(behind: np.ndarray, forbidden: bool) -> None:
    """At 5 m in cells of 0.25 m, 20 by 16 of them, all but some of which show the plane. Where a column of the area was not
    measured (0), on either side, it is covered."""
    settings = view_settings(view(), 0.0005, Params())[0]
    settings.gap_m, settings.sigma_s, settings.smear_s = 0.5, 0.0, 0.0
    grid = np.full((20, 16), 0.2, np.float32)
    grid[7 : 7 + len(behind), 3 : 3 + behind.shape[1]] = behind
    cells = evidence.Evidence(grid, 20.0, 20.0, 10.0, 8.0)
    cover = evidence.Cover(
        cells, OpeningMasks(np.zeros((6, 20, 16), np.uint8), STEPS, 20.0, 20.0, 10.0, 8.0), np.zeros((2, 18), np.int32)
    )
    joined = evidence.Rectangle(-0.5, 0.5, -2.0, 2.0)
    share = evidence.uncovered_share(joined, 0.2, 0.0, joined, joined, settings, cover)
    assert share == (2.0 if forbidden else pytest.approx((behind < 0.2).sum() / 320.0))


@pytest.mark.parametrize("slack_m", [0.0, 0.25, 0.55])
def test_an_open_cell_more_than_the_slack_inside_of_the_border_forbids_the_plane(slack_m: float) -> None:
    """At 5 m, in cells of 0.2 m: columns 6 to 14 and rows 4 to 11 of the grid, of which the two planes have the corners."""
    frame, settings = (25.0, 25.0, 10.0, 8.0), view_settings(view(), 0.0005, Params())[0]
    settings.gap_m, settings.opening_slack_m = 100.0, slack_m
    joined = evidence.Rectangle(-0.16, 0.2, -0.8, 0.8)
    p, q = evidence.Rectangle(-0.16, -0.12, -0.8, -0.6), evidence.Rectangle(0.16, 0.2, 0.6, 0.8)
    forbidden = np.zeros((20, 16), bool)
    for i, j in np.ndindex(forbidden.shape):
        masks = np.zeros((6, 20, 16), np.uint8)
        masks[:, i, j] = 1
        cells = evidence.Evidence(np.zeros((20, 16), np.float32), *frame)
        cover = evidence.Cover(cells, OpeningMasks(masks, STEPS, *frame), np.zeros((2, 18), np.int32))
        share = evidence.uncovered_share(joined, 0.2, 0.0, p, q, settings, cover)
        assert share in (1.0, 2.0)
        forbidden[i, j] = share == 2.0
    want, rim = np.zeros((20, 16), bool), {0.0: 0, 0.25: 1, 0.55: 3}[slack_m]
    want[6 + rim : 15 - rim, 4 + rim : 12 - rim] = True
    want[6, 4] = want[14, 11] = False
    np.testing.assert_array_equal(forbidden, want)


# ---- pairs ------------------------------------------------------------------------------------------------------


@given(SEED, st.integers(1, 200), st.sampled_from([1.0, 2e-3, 0.0]))
def test_the_cheapest_pair_comes_first_also_of_what_was_put_in_later(seed: int, n: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    lists, heap = np.zeros(pq.STEPS, np.int32), np.zeros(n, np.int32)
    queue = pq.Queue(np.zeros(n, pq.ENTRY), lists, heap, np.zeros(1, pq.QUEUE_STATE))
    entries = queue.entries
    entries["cost"], entries["first"] = rng.integers(0, 9, n) / 9.0 * spread, rng.integers(0, 50, n)
    entries["second"] = np.arange(n)

    def key(k: int) -> tuple[float, int, int]:
        return float(entries[k].cost), int(entries[k].first), int(entries[k].second)

    pq.clear_queue(queue)
    for k in range(n):
        pq.push(queue, k)
    waiting = {key(k) for k in range(n)}
    for _ in range(3 * n):
        k = int(pq.pop(queue))
        if not waiting:
            break
        assert key(k) == min(waiting)
        waiting.remove(min(waiting))
        if rng.random() < 0.5:  # dearer than before, now and then by nothing at all
            entries[k].cost = min(entries[k].cost + rng.choice([0.0, 1e-4, 0.3]), 0.999)
            pq.push(queue, k)
            waiting.add(key(k))
    while waiting:
        k = int(pq.pop(queue))
        assert key(k) == min(waiting)
        waiting.remove(min(waiting))
    assert pq.pop(queue) == -1


def random_pieces(rng: np.random.Generator, n: int) -> tuple[np.ndarray, list]:
    """(planes, pieces as `naive.pair_cost` takes them): short lines at about the same distance."""
    planes, pieces = np.zeros(n, pl.PLANE), []
    for plane in planes:
        t = rng.uniform(-0.3, 0.2) + np.sort(rng.uniform(0.0, 0.15, 8))
        a, b = rng.uniform(0.17, 0.19), rng.uniform(-0.1, 0.1)
        points = np.column_stack([t, a + b * t + 1e-3 * rng.standard_normal(8), rng.uniform(1e4, 1e6, 8)])
        for point in points:
            lines.add_point(plane, *point)
        plane.a, plane.b, _, _ = lines.fit_line(plane, 1.0)
        plane.t0, plane.t1 = t[0], t[-1]
        plane.top_m, plane.bottom_m, plane.front_m = -1.0, 1.0, rng.uniform(-0.2, 0.3)
        pieces.append((points, (plane.a, plane.b), plane.front_m))
    return planes, pieces


def traits_of(planes: np.ndarray, settings: np.ndarray) -> np.ndarray:
    traits = np.zeros((len(planes), pairs.TRAITS))
    for k, plane in enumerate(planes):
        if plane.sum_w > 0.0:
            pairs.score_piece(plane, traits, k, settings)
    return traits


@given(SEED)
def test_what_a_pair_costs_against_a_fit_to_all_of_its_points(seed: int) -> None:
    p = Params(merge_noise_cap=0.0)
    settings = view_settings(view(), 0.0005, p)[0]
    planes, pieces = random_pieces(np.random.default_rng(seed), 40)
    traits = traits_of(planes, settings)
    for k in range(0, 40, 2):
        got, a, b = pairs.pair_cost(pairs.of_piece(traits, k), pairs.of_piece(traits, k + 1), settings)
        want = naive.pair_cost(pieces[k : k + 2], p, settings.sigma_s, settings.gap_m)
        assert got == pytest.approx(want, rel=1e-4) or min(got, want) >= 0.9999
        if got < 1.0:
            lines.add_moments(planes[k], planes[k + 1])
            assert (a, b) == pytest.approx(lines.fit_line(planes[k], settings.slope_prior)[:2])


@given(SEED, st.integers(2, 150))
def test_costs_side_by_side_are_those_of_each_pair(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    planes, _ = random_pieces(rng, n)
    planes["top_m"] += rng.choice([0.0, 3.0], n)
    planes["bottom_m"] = planes["top_m"] + 1.0
    settings = view_settings(view(), 0.0005, Params())[0]
    traits, order = traits_of(planes, settings), rng.permutation(n).astype(np.int32)
    tiles, costs = np.zeros(-(-n // pairs.TILE) * pairs.TRAITS * pairs.TILE), np.zeros(n)
    pairs.fill_tiles(order, n, traits, tiles)
    k = int(rng.integers(0, n - 1))
    end = int(rng.integers(k + 2, n + 1))
    pairs.costs_of_next(tiles, k, end, settings, costs)
    for m in range(k + 1, end):
        p, q = pairs.of_piece(traits, order[k]), pairs.of_piece(traits, order[m])
        t0, t1 = max(p.t0, q.t0), min(p.t1, q.t1)
        off = abs(p.a - q.a + (p.b - q.b) * 0.5 * (t0 + t1))
        apart = p.top_m != q.top_m or (t0 < t1 and off > 2.0 * (p.allowed + q.allowed))
        assert costs[m] == (pairs.REFUSED if apart else pairs.pair_cost(p, q, settings)[0])


def test_a_line_may_leave_a_plane_by_what_is_allowed_root_mean_square() -> None:
    planes = pieces_of([(6.0, -1.0, 6.0, 1.0, -1, 1)])
    settings = view_settings(view(), 0.0005, Params(merge_noise_cap=0.0))[0]
    traits = traits_of(planes, settings)
    t = np.linspace(-1 / 6, 1 / 6, 20)
    for a, b in ((1 / 6.2, 0.0), (1 / 6, 0.01), (0.17, -0.02)):
        off = 36.0 * (a + b * t - 1 / 6)
        assert pairs.deviation_squared(pairs.of_piece(traits, 0), a, b) == pytest.approx(
            np.mean(off**2) / 0.3**2, rel=1e-6
        )


@pytest.mark.parametrize("x_m", [5.0, 10.0, 15.0])
def test_pieces_of_a_camera_that_smears_may_differ_by_its_noise_at_any_distance(x_m: float) -> None:
    """Its pixels err together, so that the noise of a piece is that of a pixel; of another camera noise grants 0.6 m at most."""
    p, ke = Params(), 0.004
    planes = pieces_of([(x_m, -1.0, x_m, 1.0, -1, 1)])
    granted_m = []
    for smeared in (False, True):
        settings = view_settings(view(), ke, p, smeared)[0]
        granted_m.append(pairs.of_piece(traits_of(planes, settings), 0).allowed * x_m**2 - p.merge_distance_m)
    assert granted_m[0] <= p.merge_noise_cap * p.merge_distance_m
    assert granted_m[1] == pytest.approx(granted_m[0] + p.smear_merge_sigmas * ke * x_m**2, rel=0.05)

"""Strips of one column: windows, steps, near sides and the irregular rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import strips as s
from core.stages import windows as w
from core.stages.row_mask import CODE, NO_PEAK

from . import naive
from .columns import QUANTUM, Column, F, code
from .views import INFO, extract, flat_wall

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)


@given(SEED, st.integers(1, 60), st.integers(1, s.NEAR_RANK))
def test_the_kth_closest_is_the_one_sorting_gives(seed: int, n: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    codes = np.concatenate([[60000], rng.integers(2, 30, n), [60000]]).astype(np.int32)
    if k <= n:
        assert s.kth_closest(codes, 1, n + 1, k) == np.sort(codes[1 : n + 1])[n - k]


@given(SEED, st.integers(2, 12), st.floats(0.1, 0.9))
def test_windows_against_their_definition(seed: int, half: int, share: float) -> None:
    """Runs of members and others, with holes: the segments are those of the plain rule."""
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.choice([5.0, 9.0, math.nan, math.inf, 3.0], 20, p=[0.5, 0.2, 0.1, 0.1, 0.1]), 5)
    x[rng.random(100) < 0.2 * share] = 9.0
    c = Column(x, params=Params(passable_height_m=max(0.2, 2 * half * 5.0 / F), window_min_px=4))
    c.members(c.line == code(5.0))
    member = c.is_member.copy()
    got_half = w.window_half_rows(F / 5.0, c.settings, 100)
    low, high = 0.8 * code(5.0)[0], 1.2 * code(5.0)[0]
    want = naive.accepted_segments(c.line, c.open, member, low, high, got_half, 0.5, 3)
    n = c.windows(low, high, F / 5.0)
    assert c.ends(n) == want
    for (top, bottom), row in zip(want, c.strips, strict=False):
        assert row["support"] == s.PX * np.sum(member[top : bottom + 1])


@pytest.mark.parametrize("z", [1.0, 5.0, 20.0, 500.0])
def test_a_window_is_as_long_as_a_passable_height_at_the_near_side_of_the_noise(z: float) -> None:
    c = Column(np.full(100, 5.0), sigma_d_px=2.0)
    ke = 2.0 / F
    near = max(0.5 * z, z - ke * z * z)  # Eq. 8, never nearer than half
    rows = min(max(F * c.params.passable_height_m / near, c.params.window_min_px), 100)
    assert w.window_half_rows(F / z, c.settings, 100) == int(rows / 2 + 0.5)


def test_a_lintel_over_a_window_is_found_beside_the_sill() -> None:
    x = np.full(100, 12.0)
    x[10:40] = 4.0
    x[65:95] = 4.0
    c = Column(x)
    c.members(c.line == code(4.0))
    n = c.windows(0.9 * code(4.0)[0], 1.1 * code(4.0)[0], F / 4.0)
    found = c.ends(n)
    np.testing.assert_allclose(F / c.strips["disparity_px"][:n], 4.0, rtol=1e-3)
    assert len(found) == 2
    assert found[0][0] == 10
    assert found[1][1] == 94
    # what the last window of each leaves is a strip of the irregular rest at the same distance, nothing in the opening is
    covered = set()
    rest = c.rest()
    near = [e for e, d in zip(c.ends(rest), c.strips["disparity_px"][:rest], strict=True) if F / d < 5.0]
    for top, bottom in [*found, *near]:
        covered |= set(range(top, bottom + 1))
    assert covered == set(range(10, 40)) | set(range(65, 95))


def test_a_pole_in_front_does_not_pull_the_wall_behind_it_forward() -> None:
    x = np.full(100, 10.0)
    x[40:44] = 3.0
    c = Column(x)
    c.members(c.line == code(10.0))
    n = c.windows(0.9 * code(10.0)[0], 1.5 * code(10.0)[0], F / 10.0, rough=True)
    assert c.ends(n) == [(0, 39), (45, 99)]
    np.testing.assert_allclose(F / c.strips["disparity_px"][:n], 10.0, atol=0.1)
    assert c.open[40:44].all()  # nearer than the peak: left for a strip of its own


def test_rows_between_members_that_were_never_seen_count_as_filled() -> None:
    x = np.full(100, 5.0)
    x[40:50] = math.nan
    x[70:73] = math.nan  # no more than single pixels drop out
    c = Column(x)
    n = c.windows(0.9 * code(5.0)[0], 1.1 * code(5.0)[0], F / 5.0)
    assert c.ends(n) == [(0, 99)]
    assert c.strips["filled_rows"][0] == 10


def split(c: Column) -> list[tuple[int, int, int]]:
    """split_bands over all rows: (first row, pixels, sum of codes) of each part."""
    rows = np.flatnonzero(c.is_member)
    top, bottom = int(rows[0]), int(rows[-1])
    b = c.buffers
    w.running_sums(c.line, c.mark, 0, top, bottom, b.sums_open, b.sums_own)
    k = w.split_bands(b.sums_own, top, bottom, c.settings, b.parts)
    return [tuple(int(v) for v in part) for part in b.parts[:, :k].T]


def cut_rows(c: Column) -> list[int]:
    return [part[0] for part in split(c)]


@given(SEED, st.sampled_from([2, 5, 7]), st.sampled_from([0.05, 0.3, 2.0]))
def test_bands_against_their_definition(seed: int, high: int, sigma: float) -> None:
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.choice([5.0, 5.15, 5.4, 7.0], 10), 10) + sigma * 0.2 * rng.normal(size=100)
    x[rng.random(100) < 0.3] = math.nan
    x[0] = 5.0
    c = Column(np.clip(x, 1.0, None), sigma_d_px=sigma, params=Params(band_rows=high))
    p = c.params

    def tolerance(mean: float, band: int, part: int) -> float:
        noise = p.band_sigmas * sigma * math.sqrt(1 / band + 1 / part)
        return QUANTUM * max(p.band_step_m * (mean / QUANTUM) ** 2 / F, noise)

    assert split(c) == naive.bands(c.line, set(np.flatnonzero(c.is_member).tolist()), high, tolerance)


@given(SEED, st.integers(1, 6))
def test_rows_missed_are_those_of_the_longer_gaps(seed: int, gap: int) -> None:
    rng = np.random.default_rng(seed)
    c = Column(np.where(rng.random(60) < rng.uniform(0.2, 1.0), 5.0, math.nan))
    c.mark[[3, 50]] = 0
    rows = np.flatnonzero(c.is_member)
    got = w.rows_missed(c.mark, 0, int(rows[0]), int(rows[-1]), len(rows), gap)
    assert got == naive.missed(rows.tolist(), gap)


def test_bands_cut_a_run_where_it_steps_and_only_there() -> None:
    x = np.full(100, 5.0)
    assert cut_rows(Column(x)) == [0]
    x[50:] = 6.0
    assert cut_rows(Column(x)) == [0, 50]
    x[75:] = 8.0
    assert cut_rows(Column(x)) == [0, 50, 75]
    x = np.full(100, 5.0)
    x[40:45] = 6.0  # one band off is no step
    assert cut_rows(Column(x)) == [0]
    x = np.full(100, 5.0)
    x[50:] = 5.1  # below band_step_m
    assert cut_rows(Column(x)) == [0]
    assert cut_rows(Column(x, params=Params(band_step_m=0.05))) == [0, 50]
    assert cut_rows(Column(x, params=Params(band_step_m=0.05), sigma_d_px=3.0)) == [0]  # within the noise


def test_a_run_may_step_as_often_as_it_has_room_for_steps() -> None:
    x = np.tile(np.repeat([3.0, 6.0], 10), 100)
    assert cut_rows(Column(x)) == list(range(0, 2000, 10))
    assert len(cut_rows(Column(x[:1000], params=Params(band_rows=2)))) == 100


def emit(c: Column, rough: bool = True) -> tuple[float, float]:
    """(D, NEAR) of one strip of all pixels of a column."""
    n = c.gather()
    codes = c.px[CODE]
    pixels = s.Pixels(codes, 0, n, n, int(codes[:n].sum()), 0, len(c.line) - 1, 0)
    s.emit(pixels, rough, s.ROUGH, c.column, c.settings, c.out)
    return float(c.strips["disparity_px"][0]), float(c.strips["near_px"][0])


@given(SEED, st.integers(3, 200))
def test_the_near_side_of_rough_pixels_leaves_no_more_than_configured_behind(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    c = Column(rng.uniform(3.0, 8.0, n), sigma_d_px=0.05)
    p = c.params
    d = np.sort(c.disparity)
    k = min(s.NEAR_RANK, (n + 1) // 2)
    near = max(d[n - k] - p.near_sigmas * 0.05, d.mean())
    strip, edge = emit(c)
    assert strip == pytest.approx(max(d.mean(), F / (F / near + p.safe_distance_m)), rel=1e-5)
    assert edge == pytest.approx(max(p.near_edge_share * strip, near - p.band_sigmas * 0.05 / math.sqrt(n)), rel=1e-5)
    assert emit(Column(c.x_m), rough=False)[0] == pytest.approx(d.mean(), rel=1e-5)


@given(SEED, st.sampled_from([0.05, 0.3, 1.5]), st.sampled_from([4.0, 2.0]))
def test_the_irregular_rest_against_its_definition(seed: int, sigma: float, sigmas: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(2.0, 12.0) + 0.3 * np.cumsum(rng.normal(size=100)).clip(-3, 8)
    x[rng.random(100) < 0.2] = rng.uniform(1.0, 15.0)
    x[rng.random(100) < 0.3] = math.nan
    x = np.clip(x, 0.6, None)
    c = Column(x, sigma_d_px=sigma, params=Params(irregular_sigmas=sigmas))
    p = c.params
    want = naive.irregular_segments(
        c.disparity, c.open, F, p.irregular_gap_px, p.segment_height_m, p.irregular_depth_m, sigmas * sigma
    )
    free = c.open
    n = c.rest()
    assert c.ends(n) == want
    # every measured pixel belongs to exactly one strip, which is no farther than the mean of its pixels
    assert c.strips["support"][:n].sum() == s.PX * free.sum()
    for (top, bottom), d in zip(want, c.strips["disparity_px"][:n], strict=True):
        own = c.disparity[top : bottom + 1][free[top : bottom + 1]]
        assert d >= own.mean() * (1 - 1e-5)
        assert d <= own.max() * (1 + 1e-5)


def test_strips_of_a_wall_stand_at_its_distance_in_every_column() -> None:
    model = extract(flat_wall(INFO, 5.0), INFO, keep_strips=True)
    t = model.strips
    assert t is not None
    assert sorted(set(t.u.tolist())) == list(range(40))
    np.testing.assert_allclose(t.x_m, 5.0, atol=0.02)
    np.testing.assert_allclose(t.y_m, 5.0 * (t.u - 19.5) / 30.0, atol=0.02)
    for u in range(40):
        own = t.u == u
        assert (t.row_top[own].min(), t.row_bottom[own].max()) == (0, 29)
        assert t.support_px[own].sum() == 30
    np.testing.assert_allclose(t.top_m, 5.0 * (t.row_top - 15.0) / 30.0, atol=0.02)
    np.testing.assert_allclose(t.bottom_m, 5.0 * (t.row_bottom - 14.0) / 30.0, atol=0.02)


def test_settings_have_their_names() -> None:
    c = Column(np.full(10, 5.0), sigma_d_px=0.3)
    p = c.params
    g = c.settings
    assert (g.sigma_d_px, g.f_px, g.passable_height_m) == (0.3, F, p.passable_height_m)
    assert g.lsb_per_px == QUANTUM
    assert g.irregular_gap_px == p.irregular_gap_px


@pytest.mark.parametrize("members", [1, 3, 6])
def test_a_window_needs_its_least_members(members: int) -> None:
    """Five rows of a peak, the rest of the column unknown."""
    x = np.full(100, math.nan)
    x[40:45] = 5.0
    c = Column(x, params=Params(window_min_px=6, window_members=members))
    assert c.ends(c.windows(0.8 * code(5.0)[0], 1.2 * code(5.0)[0], F / 5.0)) == ([(40, 44)] if members <= 5 else [])


@pytest.mark.parametrize(("sigmas", "left"), [(0.0, 3), (1.0, 2), (3.0, 1)])
def test_what_is_a_little_nearer_than_the_peak_is_taken_with_its_segment(sigmas: float, left: int) -> None:
    c = Column(np.full(100, 5.0), sigma_d_px=0.5, params=Params(window_take_sigmas=sigmas))
    high = code(5.0)[0] + 20
    c.line[[20, 50, 80]] = high + 0.5 * QUANTUM * np.array([0.9, 2.5, 4.0])
    c.mark[[20, 50, 80]] = NO_PEAK
    assert c.windows(0.9 * code(5.0)[0], high, F / 5.0) == 1
    assert np.sum(c.open) == left


@pytest.mark.parametrize(("sigmas", "share"), [(2.0, 0.5), (0.0, 0.5), (2.0, 1.0), (2.0, 0.98)])
def test_a_near_edge_is_the_kth_closest_less_noise_and_never_far_behind_its_strip(sigmas: float, share: float) -> None:
    rng = np.random.default_rng(3)
    c = Column(rng.uniform(4.0, 6.0, 100), params=Params(near_sigmas=sigmas, near_edge_share=share, band_sigmas=8.0))
    _, near = emit(c)
    closest = max(np.sort(c.disparity)[100 - 3] - sigmas * 0.1, c.disparity.mean())
    want = max(share * c.strips["disparity_px"][0], closest - 8.0 * 0.1 / 10.0)
    assert near == pytest.approx(want, rel=1e-6)


def test_a_column_with_too_many_strips_merges_them_at_the_nearest_and_counts_it() -> None:
    """Twenty single pixels, each a strip of its own, in room for eight."""
    x = np.full(200, math.nan)
    x[5:200:10] = np.linspace(9.0, 3.0, 20)
    c = Column(x, params=Params(max_column_strips=8))
    n = c.rest()
    assert n == 8
    assert c.counts["merged"][0] == 12
    assert c.ends(n) == [*((v, v) for v in range(5, 75, 10)), (75, 195)]
    assert c.strips["support"][7] == 13 * s.PX
    assert c.strips["filled_rows"][7] == 121 - 13
    alone = Column(np.full(1, 3.0))
    alone.rest()
    assert c.strips["disparity_px"][7] == alone.strips["disparity_px"][0]
    assert c.strips["near_px"][7] == alone.strips["near_px"][0]
    c = Column(x)
    assert c.rest() == 20
    assert c.counts["merged"][0] == 0

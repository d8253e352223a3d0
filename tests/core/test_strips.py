"""Strips of one column: windows, steps, near sides and the irregular rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core import irregular
from core import strips as s
from core.density import NO_PEAK
from core.params import Params

from . import naive
from .columns import QUANTUM, Column, F, code, view
from .views import INFO, extract, flat_wall

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)


@given(SEED, st.integers(1, 60))
def test_the_kth_largest_is_the_one_sorting_gives(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.choice(rng.random(max(1, n // 2)), n).astype(np.float32)  # with equal ones
    for k in {1, n, (n + 1) // 2, min(3, n)}:
        assert s.kth_largest(values.copy(), n, k) == np.sort(values)[n - k]


@given(SEED)
def test_histogram_sorts_every_row_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    line = rng.integers(0, 60, 50).astype(np.uint16)
    gate = rng.uniform(-0.3, 0.3, 65536).astype(np.float32)
    tan_mid = np.linspace(-0.5, 0.5, 50).astype(np.float32)
    bin_of_code = np.maximum(np.arange(65536) // 7, 1).astype(np.uint16)
    bins, state, hist = np.full(50, 9, np.uint16), np.full(50, 9, np.uint8), np.full(10, 9, np.int32)
    ground = s.histogram(line, gate, np.float32(0.05), tan_mid, bin_of_code, bins, state, hist)
    want = np.zeros(10, int)
    for v in range(50):
        below = line[v] > 1 and tan_mid[v] - np.float32(0.05) > gate[line[v]]
        kind = naive.NONE if line[v] == 0 else naive.FAR_ROW if line[v] == 1 else naive.GROUND if below else naive.FREE
        assert state[v] == kind
        assert bins[v] == (bin_of_code[line[v]] if kind == naive.FREE else 0)
        want[bins[v]] += kind == naive.FREE
    np.testing.assert_array_equal(hist, want)
    assert ground == np.sum(state == naive.GROUND)


@given(SEED, st.integers(2, 12), st.floats(0.1, 0.9))
def test_windows_against_their_definition(seed: int, half: int, share: float) -> None:
    """Runs of members and others, with holes: the segments are those of the plain rule."""
    rng = np.random.default_rng(seed)
    x = np.repeat(rng.choice([5.0, 9.0, math.nan, math.inf, 3.0], 20, p=[0.5, 0.2, 0.1, 0.1, 0.1]), 5)
    x[rng.random(100) < 0.2 * share] = 9.0
    c = Column(x, params=Params(passable_height_m=max(0.2, 2 * half * 5.0 / F), window_min_px=4))
    c.member[:] = np.where(c.line == code(5.0), 0, NO_PEAK)
    got_half = s.window_half_rows(F / 5.0, c.fs, c.si, 100)
    low, high = 0.8 * code(5.0)[0], 1.2 * code(5.0)[0]
    want = naive.accepted_segments(c.line, c.state, c.member == 0, low, high, got_half, 0.5, 3)
    n = c.windows(low, high, F / 5.0)
    assert c.ends(n) == want
    for (top, bottom), row in zip(want, c.ints, strict=False):
        assert row[s.SUPPORT] == s.PX * np.sum(c.member[top : bottom + 1] == 0)


@pytest.mark.parametrize("z", [1.0, 5.0, 20.0, 500.0])
def test_a_window_is_as_long_as_a_passable_height_at_the_near_side_of_the_noise(z: float) -> None:
    c = Column(np.full(100, 5.0), sigma_d_px=2.0)
    ke = 2.0 / F
    near = max(0.5 * z, z - ke * z * z)  # Eq. 8, never nearer than half
    rows = min(max(F * c.params.passable_height_m / near, c.params.window_min_px), 100)
    assert s.window_half_rows(F / z, c.fs, c.si, 100) == int(rows / 2 + 0.5)


def test_a_lintel_over_a_window_is_found_beside_the_sill() -> None:
    x = np.full(100, 12.0)
    x[10:40] = 4.0
    x[65:95] = 4.0
    c = Column(x)
    c.member[:] = np.where(c.line == code(4.0), 0, NO_PEAK)
    n = c.windows(0.9 * code(4.0)[0], 1.1 * code(4.0)[0], F / 4.0)
    found = c.ends(n)
    np.testing.assert_allclose(F / c.floats[:n, s.D], 4.0, rtol=1e-3)
    assert len(found) == 2
    assert found[0][0] == 10
    assert found[1][1] == 94
    # what the last window of each leaves is a strip of the irregular rest at the same distance, nothing in the opening is
    covered = set()
    rest = c.rest()
    near = [e for e, d in zip(c.ends(rest), c.floats[:rest, s.D], strict=True) if F / d < 5.0]
    for top, bottom in [*found, *near]:
        covered |= set(range(top, bottom + 1))
    assert covered == set(range(10, 40)) | set(range(65, 95))


def test_a_pole_in_front_does_not_pull_the_wall_behind_it_forward() -> None:
    x = np.full(100, 10.0)
    x[40:44] = 3.0
    c = Column(x)
    c.member[:] = np.where(c.line == code(10.0), 0, NO_PEAK)
    n = c.windows(0.9 * code(10.0)[0], 1.5 * code(10.0)[0], F / 10.0, rough=True)
    assert c.ends(n) == [(0, 39), (45, 99)]
    np.testing.assert_allclose(F / c.floats[:n, s.D], 10.0, atol=0.1)
    assert (c.state[40:44] == s.FREE_PX).all()  # nearer than the peak: left for a strip of its own


def test_rows_between_members_that_were_never_seen_count_as_filled() -> None:
    x = np.full(100, 5.0)
    x[40:50] = math.nan
    x[70:73] = math.nan  # no more than single pixels drop out
    c = Column(x)
    n = c.windows(0.9 * code(5.0)[0], 1.1 * code(5.0)[0], F / 5.0)
    assert c.ends(n) == [(0, 99)]
    assert c.ints[0, s.FILL] == 10


def cut_rows(c: Column) -> list[int]:
    k = s.split_bands(c.line, c.state, c.member, 0, 0, len(c.line) - 1, c.fs, c.si, c.cuts)
    return [int(v) for v in c.cuts[:k]]


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


def test_a_run_with_more_steps_than_there_is_room_for_stays_within_it() -> None:
    x = np.tile(np.repeat([3.0, 6.0], 10), 100)
    c = Column(x)
    k = s.split_bands(c.line, c.state, c.member, 0, 0, len(x) - 1, c.fs, c.si, c.cuts)
    assert k == len(c.cuts)
    assert (np.diff(c.cuts) > 0).all()


@given(SEED, st.integers(3, 200))
def test_the_near_side_of_rough_pixels_leaves_no_more_than_told_behind(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    p = Params()
    c = Column(np.full(10, 5.0), sigma_d_px=0.05)
    d = (F / rng.uniform(3.0, 8.0, n)).astype(np.float32)
    mean = np.float32(d.mean())
    strip, near = s.near_side(d.copy(), n, mean, c.fs, c.si)
    k = min(max(p.near_rank, int(p.near_quantile * n)), (n + 1) // 2)
    assert near == pytest.approx(max(np.sort(d)[n - k] - 0.1, mean), rel=1e-5)
    assert strip >= mean
    assert F / strip - F / near <= p.safe_distance_m + 1e-4


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
        c.disparity, c.state, F, p.irregular_gap_px, p.segment_height_m, p.irregular_depth_m, sigmas * sigma
    )
    free = c.state == s.FREE_PX
    n = c.rest()
    assert c.ends(n) == want
    # every measured pixel belongs to exactly one strip, which is no farther than the mean of its pixels
    assert c.ints[:n, s.SUPPORT].sum() == s.PX * free.sum()
    for (top, bottom), d in zip(want, c.floats[:n, s.D], strict=True):
        own = c.disparity[top : bottom + 1][free[top : bottom + 1]]
        assert d >= own.mean() * (1 - 1e-5)
        assert d <= own.max() * (1 + 1e-5)


@pytest.mark.parametrize(("tilt", "expected"), [(0.0, True), (0.3, False)])
def test_horizontal_surfaces_correlate_and_vanish_at_the_horizon(tilt: float, expected: bool) -> None:
    """Disparity of a horizontal surface grows linearly from 0 at the horizon row; of a ramp from elsewhere."""
    v = np.arange(100.0)
    c = Column(np.full(100, 5.0), params=Params(horizontal_centre_px=10.0))
    rows = v[60:100]
    c.line[60:] = np.rint(QUANTUM * (F * tilt + rows - 49.5) / 2.0).astype(np.uint16)
    assert irregular.is_horizontal(c.line, c.member, 0, 60, 99, c.fs, c.si) == expected
    assert irregular.is_horizontal(c.line, c.member, 0, 60, 65, c.fs, c.si) == expected
    assert not irregular.is_horizontal(c.line, c.member, 0, 0, 50, c.fs, c.si)  # a wall: no correlation
    assert not irregular.is_horizontal(c.line, c.member, 0, 60, 64, c.fs, c.si)  # too few


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


def test_settings_stand_at_their_indices() -> None:
    c = Column(np.full(10, 5.0), sigma_d_px=0.3)
    p = c.params
    assert (c.fs[s.S_SIGMA_D], c.fs[s.S_F], c.fs[s.S_HS]) == (0.3, F, p.passable_height_m)
    assert (c.fs[s.S_HORIZON], c.fs[s.S_QUANTUM]) == (view(10).cv, QUANTUM)
    assert (c.si[s.I_RANK], c.si[s.I_GAP], c.si[s.I_PAPER]) == (p.near_rank, p.irregular_gap_px, 0)


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
    c.member[[20, 50, 80]] = NO_PEAK
    assert c.windows(0.9 * code(5.0)[0], high, F / 5.0) == 1
    assert np.sum(c.state == s.FREE_PX) == left


@pytest.mark.parametrize(("sigmas", "share"), [(2.0, 0.5), (0.0, 0.5), (2.0, 1.0), (2.0, 0.98)])
def test_a_near_edge_is_the_kth_closest_less_noise_and_never_far_behind_its_strip(sigmas: float, share: float) -> None:
    rng = np.random.default_rng(3)
    c = Column(rng.uniform(4.0, 6.0, 100), params=Params(near_sigmas=sigmas, near_edge_share=share, band_sigmas=8.0))
    n = s.emit_pixels(
        c.line, c.state, c.member, 0, 0, 99, True, s.ROUGH, 0, c.H, c.fs, c.si, c.scratch, c.ints, c.floats, 0
    )
    assert n == 1
    closest = max(np.sort(c.disparity)[100 - 3] - sigmas * 0.1, c.disparity.mean())
    want = max(share * c.floats[0, s.D], closest - 8.0 * 0.1 / 10.0)
    assert c.floats[0, s.NEAR] == pytest.approx(want, rel=1e-6)

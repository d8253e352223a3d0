"""Lines by moments, and strips that grow into straight pieces."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages import line_fit as lines
from core.stages import segments as tr
from core.stages import strips as s

from . import naive
from .columns import F
from .tables import CLOSED, Strips
from .tables import moments_of as moments

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)


def moments_of(t: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
    m = np.zeros(1, tr.TRACK)
    for point in zip(t, v, w, strict=True):
        lines.add_point(m[0], *point)
    return m[0]


@given(SEED, st.integers(2, 60))
def test_the_fit_is_weighted_least_squares(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    t = rng.uniform(-1, 1, n)
    v = 0.2 + 0.1 * t + 0.02 * rng.standard_normal(n)
    w = rng.uniform(10.0, 1e4, n)
    m = moments_of(t, v, w)
    a, b, mean, scatter = lines.fit_line(m, 1e-9)
    slope, intercept = np.polyfit(t, v, 1, w=np.sqrt(w))
    assert (a, b) == pytest.approx((intercept, slope), rel=1e-4, abs=1e-7)
    assert mean == pytest.approx(np.average(t, weights=w))
    assert scatter == pytest.approx(np.sum(w * (t - mean) ** 2), rel=1e-6, abs=1e-6)
    assert lines.misfit(*moments(m), a, b) == pytest.approx(
        np.average((v - a - b * t) ** 2, weights=w), rel=1e-4, abs=1e-9
    )


@given(SEED, st.integers(2, 20), st.integers(2, 20))
def test_moments_of_two_pieces_add_up_to_those_of_the_whole(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    t, v, w = rng.uniform(-1, 1, n + m), rng.uniform(0.05, 1, n + m), rng.uniform(1, 9, n + m)
    parts = moments_of(t[:n], v[:n], w[:n])
    lines.add_moments(parts, moments_of(t[n:], v[n:], w[n:]))
    np.testing.assert_allclose(moments(parts), moments(moments_of(t, v, w)), rtol=1e-12)


def test_a_wall_along_the_view_axis_is_a_line_like_any_other() -> None:
    """y = 1.5: s = t / 1.5. As x over y its slope would be infinite (the term the paper leaves out)."""
    x = np.linspace(2, 15, 40)
    m = moments_of(1.5 / x, 1.0 / x, np.full(40, 1e6))
    a, b, _, _ = lines.fit_line(m, 1e-9)
    assert (a, b) == pytest.approx((0.0, 1 / 1.5), abs=1e-6)
    assert lines.misfit(*moments(m), a, b) == pytest.approx(0.0, abs=1e-9)
    # the ray (1, 0.1) against the normal (0, 1)
    assert lines.incidence_cosine(0.0, 1 / 1.5, 1 / 1.5, 0.1) == pytest.approx(0.1 / math.hypot(1, 0.1))


def test_one_point_is_a_wall_across_the_view() -> None:
    m = moments_of(np.array([0.3]), np.array([0.25]), np.array([1e4]))
    a, b, _, scatter = lines.fit_line(m, 0.7)
    assert (a, b, scatter) == pytest.approx((0.25, 0.0, 0.0))


def scatter_strips(seed: int, n: int) -> Strips:
    rng = np.random.default_rng(seed)
    t = Strips(cols=50)
    for u in np.sort(rng.integers(0, 50, n)):
        top = int(rng.integers(0, 60))
        t.add(int(u), top, top + int(rng.integers(3, 35)), float(rng.choice([4.0, 4.6, 9.0]) + 0.1 * rng.random()))
    t.build().cluster()
    return t


@given(SEED, st.integers(1, 80), st.sampled_from([0.3, 1.0]), st.sampled_from([1, 4]))
def test_what_holds_for_every_track(seed: int, n: int, hs: float, link: int) -> None:
    t = scatter_strips(seed, n)
    count = t.track(hs, link=link)
    got = t.track_of
    assert sorted(set(got.tolist())) == list(range(count))
    for k in range(count):
        own = np.flatnonzero(got == k)
        us = t.strips["column"][own].astype(int)
        assert (np.diff(us) >= 1).all()  # one strip a column, in order
        assert (np.diff(us) <= link).all()
        assert len(set(t.strips["cluster"][own].tolist())) == 1
        assert (t.strips["top_row"][own[1:]] <= t.strips["bottom_row"][own[:-1]]).all()
        assert (t.strips["top_row"][own[:-1]] <= t.strips["bottom_row"][own[1:]]).all()
        for column in (2, 3):
            assert np.ptp(t.place[own, column]) <= hs + 1e-5
        m = moments_of(
            (us - t.view.cu) / F,
            t.strips["disparity_px"][own] / F,
            [1.0 / tr.strip_variance(float(r.disparity_px), float(r.sigma_px), F) for r in (t.strips[i] for i in own)],
        )
        np.testing.assert_allclose(moments(t.tracks[k]), moments(m), rtol=1e-6, atol=1e-7 * m.sum_w)
        assert t.tracks[k].first_t == pytest.approx((us[0] - t.view.cu) / F)
        assert t.tracks[k].last_t == pytest.approx((us[-1] - t.view.cu) / F)


@given(SEED, st.integers(1, 80))
def test_growth_against_a_look_at_every_track(seed: int, n: int) -> None:
    t = scatter_strips(seed, n)
    rng = np.random.default_rng(seed)
    t.strips["cut"] = rng.choice([0, 0, 0, 1, 2, 3], t.n)
    t.strips["sigma_px"] = rng.choice([0.02, 0.3, 1.0], t.n)
    count = t.track(0.5)
    tangents = [tr.tangent(strip, t.view) for strip in t.strips]
    strips = [
        (
            *(int(r[name]) for name in ("column", "top_row", "bottom_row")),
            tangents[i],
            float(r.disparity_px),
            float(r.sigma_px),
            int(r.cluster),
            int(r.cut),
            float(r.top_m),
            float(r.bottom_m),
        )
        for i, r in enumerate(t.strips)
    ]
    want = naive.tracks(strips, Params(height_step_m=0.5), F)
    assert t.track_of.tolist() == want
    assert count == max(want) + 1


def climb(kind: int, px_a_column: float, columns: int, sigma_px: float = 0.02) -> Strips:
    """Strips that come nearer by so many pixels of disparity from column to column, from 5 m on."""
    t = Strips(cols=60, sigma_px=sigma_px)
    for u in range(columns):
        t.add(u, 20, 80, F / (20.0 + px_a_column * u), kind=kind)
    t.build().cluster()
    return t


def test_rough_strips_on_a_slant_that_many_columns_determine_are_one_track() -> None:
    assert climb(s.ROUGH, 0.5, 30).track(hs=3.0) == 1


def faces(*pieces: tuple[range, float, float], noise: float = 0.0) -> Strips:
    """Walls 2.4 m high about the horizon (columns, A, B): 1/x = A + B t."""
    rng = np.random.default_rng(1)
    t = Strips(cols=100)
    for columns, a, b in pieces:
        for u in columns:
            d = F * (a + b * (u - t.view.cu) / F) + noise * rng.standard_normal()
            half = 1.2 * d
            t.add(u, round(49.5 - half), round(49.5 + half), F / d)
    t.build().cluster()
    return t


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize(("a", "b"), [(0.2, 0.0), (0.2, 0.15), (0.25, -0.2), (0.02, 0.6)])
def test_a_straight_wall_is_one_track(noise: float, a: float, b: float) -> None:
    columns = range(100) if b < 0.5 else range(60, 100)  # seen edge-on it begins beside the axis
    t = faces((columns, a, b), noise=noise)
    assert t.track() == 1
    got = lines.fit_line(t.tracks[0], 1.0 / 1.44)
    assert got[:2] == pytest.approx((a, b), abs=0.02 if noise else 1e-3)


def test_a_corner_is_two_tracks_and_a_jump_is_two() -> None:
    corner = faces((range(50), 0.2, 0.3), (range(50, 100), 0.2, -0.3))
    assert corner.track() == 2
    edge = np.flatnonzero(np.diff(corner.track_of))
    assert len(edge) == 1
    assert abs(int(corner.strips["column"][edge[0]]) - 49) <= 4
    assert faces((range(50), 0.2, 0.0), (range(50, 100), 0.15, 0.0)).track() == 2


def test_a_pole_before_a_wall_keeps_a_track_of_its_own_and_the_wall_goes_on_behind_it() -> None:
    t = Strips(cols=100)
    for u in range(100):
        t.add(u, 10, 80, 4.5 if u in (50, 51) else 6.0)
    t.build().cluster()
    assert t.track() == 2
    assert set(t.track_of[[50, 51]].tolist()) == {1}


def test_a_gap_wider_than_the_link_begins_a_new_track() -> None:
    for gap, count in ((3, 1), (4, 2)):
        t = faces((range(40), 0.2, 0.0), (range(40 + gap, 90), 0.2, 0.0))
        assert t.track(link=4) == count


def test_heights_that_step_begin_a_new_track_and_cut_ends_are_wildcards() -> None:
    def steps(cut: int) -> int:
        t = Strips(cols=60)
        for u in range(60):
            t.add(u, 20 if u < 30 else 60, 90, 5.0)  # 2 m lower from the middle on
        t.build().cluster()
        t.strips["cut"][t.strips["column"] >= 30] = cut
        return t.track(hs=1.0)

    assert steps(0) == 2
    assert steps(1) == 1  # the picture ends there: the wall may go on
    assert steps(2) == 2


@pytest.mark.parametrize("far_column", [0, 25, 49])
@pytest.mark.parametrize("tops", [True, False])
def test_a_step_beside_an_opening_begins_a_new_track(far_column: int, tops: bool) -> None:
    """A wall at 5 m with the opening (rows 40 to 59) above it; one column reaches half a metre into it. Or mirrored."""

    def count(opening: bool) -> int:
        t = Strips(cols=50)
        for u in range(50):
            end = 50 if u == far_column else 60
            t.add(u, *((end, 90) if tops else (9, 99 - end)), 5.0)
        t.build().cluster()
        masks = CLOSED.masks.copy()
        masks[:, :, 10:15] = opening
        cu, cv = (t.view.cu + 0.5) / 4, (t.view.cv + 0.5) / 4
        return t.track(hs=1.0, masks=CLOSED._replace(masks=masks, cu=cu, cv=cv))

    assert count(opening=False) == 1
    assert count(opening=True) == 2

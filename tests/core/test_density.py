"""Bins, soft counts and peaks."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.jit import record
from core.params import Params
from core.stages.density import MAX_PEAKS, ONE_PX, BinTable, Peaks, bin_table, find_peaks, soft_counts
from core.stages.row_mask import CODE

from . import naive

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("sigma", [0.01, 0.1, 0.675, 2.25, 20.0])
def test_bins_rise_with_the_code_and_hold_their_own_codes(sigma: float) -> None:
    p = Params()
    t = bin_table(450.0, 20.0, sigma, p)
    b = t.bin_of_code.astype(int)
    assert b[0] == b[1] == 0
    assert b[2] >= 1
    assert (np.diff(b[2:]) >= 0).all()
    assert b.max() + 2 == len(t.disparity_px) == len(t.width_px) == len(t.threshold)
    assert (np.diff(t.disparity_px[1 : b.max()]) > 0).all()
    d = np.arange(2, 60000) / 20.0
    own = b[2:60000]
    centre, width = t.disparity_px[own].astype(float), t.width_px[own].astype(float)
    # within half a bin of its centre: in disparity where bins are even, in depth nearby
    off_px = np.abs(d - centre) / width
    off_m = np.abs(450.0 / d - 450.0 / centre) / max(p.bin_depth_m, 1e-9)
    assert (np.minimum(off_px, off_m) <= 0.51).all()


def test_bins_are_as_wide_as_the_noise_far_away_and_as_deep_as_configured_nearby() -> None:
    p = Params()
    t = bin_table(450.0, 20.0, 0.675, p)
    d, width = t.disparity_px[1:-2], t.width_px[1:-2]
    depth = 450.0 * width / d**2
    far = d < math.sqrt(0.675 / p.bin_per_sigma * 450.0 / p.bin_depth_m) - 1.0
    np.testing.assert_allclose(width[far], 0.675 / p.bin_per_sigma, rtol=1e-5)
    np.testing.assert_allclose(depth[d > d[far].max() + 5.0], p.bin_depth_m, rtol=0.05)


def test_the_threshold_is_the_pixels_of_a_least_obstacle() -> None:
    p = Params()
    t = bin_table(450.0, 20.0, 0.675, p)
    for b in (3, 60, 300):
        pixels = p.min_obstacle_height_m * t.disparity_px[b]  # Hm * f / X rows
        assert t.threshold[b] == pytest.approx(ONE_PX * max(p.density_share * pixels, p.density_min_px), abs=1.0)


@cache
def bins_with(half: int) -> BinTable:
    """Bins with a kernel that reaches so many bins to either side. Without the JIT the table of all codes takes 0.3 s."""
    return bin_table(450.0, 20.0, 0.5, Params(kernel_half_bins=half))


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.sampled_from([1, 3, 7]))
def test_soft_counts_are_a_convolution(seed: int, n: int, half: int) -> None:
    rng = np.random.default_rng(seed)
    bins = bins_with(half)
    weights = bins.weights
    assert len(weights) == 2 * half + 1
    assert weights[half] == ONE_PX
    np.testing.assert_array_equal(weights, weights[::-1])
    bin_of_code = np.minimum(1 + np.arange(65536) // 7, n - 2 if n > 3 else 1).astype(np.uint16)
    px = np.zeros((2, 100), np.int32)
    pixels = int(rng.integers(1, 90))
    px[CODE, :pixels] = rng.integers(2, 7 * n, pixels)
    hist, out = np.zeros(n + 2 * half, np.int32), np.full(n, -1, np.int32)
    begin, end = soft_counts(px, pixels, bins._replace(bin_of_code=bin_of_code), hist, out)
    own = bin_of_code[px[CODE, :pixels]]
    want = np.convolve(np.bincount(own, minlength=n), weights)[half : half + n]
    np.testing.assert_array_equal(out[begin : end + 1], want[begin : end + 1])
    assert not want[:begin].any()
    assert not want[end + 1 :].any()
    assert not hist.any()


def test_first_codes_begin_their_bins() -> None:
    for sigma in (0.01, 0.675):
        t = bin_table(450.0, 20.0, sigma, Params())
        for b in range(1, len(t.first_code) - 2):
            own = np.flatnonzero(t.bin_of_code == b)
            assert own.tolist() == list(range(t.first_code[b], t.first_code[b + 1]))
        assert t.first_code[-1] == 65536


def run_peaks(counts: np.ndarray, threshold: np.ndarray, share: float, alpha: float) -> list[tuple[int, int, int]]:
    """(top, low, high) of each peak of all bins."""
    peaks = Peaks(*(np.full(MAX_PEAKS, -9, np.int32) for _ in range(3)))
    settings = np.array([(share, alpha)], record(("peak_valley", np.float64), ("peak_alpha", np.float64)))[0]
    n = find_peaks(counts.astype(np.int32), threshold.astype(np.int32), 0, len(counts) - 1, settings, peaks)
    return [(int(peaks.top[i]), int(peaks.low[i]), int(peaks.high[i])) for i in range(n)]


@given(
    st.integers(0, 2**32 - 1), st.integers(3, 80), st.sampled_from([0.5, 0.8, 1.0]), st.sampled_from([0.1, 0.3, 0.9])
)
def test_peaks_of_random_counts(seed: int, n: int, share: float, alpha: float) -> None:
    rng = np.random.default_rng(seed)
    counts = np.convolve(rng.integers(0, 200, n) * (rng.random(n) < 0.4), [1, 2, 3, 2, 1], "same")
    counts[0] = 0  # no measurement: never a peak
    threshold = rng.integers(0, 400, len(counts))
    found = run_peaks(counts, threshold, share, alpha)
    tops = [t for t, _, _ in found]
    assert tops == sorted(tops, reverse=True)
    previous_low = len(counts)
    for top, low, high in found:
        assert 0 <= low <= top <= high < previous_low
        previous_low = low
        assert counts[top] == counts[low : high + 1].max() >= threshold[top]
        assert (counts[low : high + 1] >= alpha * counts[top]).all()
    for (near, _, _), (far, _, _) in itertools.pairwise(found):
        valley = counts[far : near + 1].min()
        assert valley < share * min(counts[near], counts[far])
    # nothing high is left out: every naive peak is one, or lies inside one
    if len(found) < MAX_PEAKS:
        for b in naive.peaks(counts, threshold, share):
            assert (
                any(
                    counts[t] >= counts[b] and counts[min(t, b) : max(t, b) + 1].min() >= share * counts[b]
                    for t in tops
                )
                or b in tops
            )


def test_two_peaks_split_at_the_valley_and_join_above_it() -> None:
    zero = np.zeros(9)
    two = np.array([0, 0, 10, 4, 2, 6, 8, 1, 0])
    assert run_peaks(two, zero, 0.8, 0.1) == [(6, 4, 7), (2, 2, 3)]  # the valley itself goes with the nearer
    assert [t for t, _, _ in run_peaks(two, zero, 0.2, 0.1)] == [2]
    plateau = np.array([0, 0, 7, 7, 7, 7, 0, 0, 0])
    assert len(run_peaks(plateau, zero, 1.0, 0.5)) == 1
    assert run_peaks(plateau, zero, 0.8, 0.5)[0][1:] == (2, 5)
    assert run_peaks(plateau, zero + 8, 0.8, 0.5) == []
    assert run_peaks(zero, zero, 0.8, 0.5) == []


def test_more_peaks_than_there_is_room_for_keeps_the_nearest() -> None:
    counts = np.zeros(200)
    counts[1::4] = 10
    found = run_peaks(counts, np.ones(200), 0.8, 0.3)
    assert [t for t, _, _ in found] == list(range(197, 197 - 4 * MAX_PEAKS, -4))


def test_bin_table_type() -> None:
    t = bin_table(450.0, 20.0, 0.5, Params())
    assert isinstance(t, BinTable)
    assert (t.bin_of_code.dtype, t.threshold.dtype, t.weights.dtype) == (np.uint16, np.int32, np.int32)

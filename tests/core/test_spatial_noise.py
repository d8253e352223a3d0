"""The noise that is measured from one depth image."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages.spatial_noise import (
    TileRules,
    agreeing_tiles,
    estimate_ke,
    noise_tiles,
    quantile_of_tiles,
    tile_roughness,
)
from core.types import FAR_MM, CameraInfo
from drivers.simulation.source import camera_info

from . import naive
from .views import flat_wall, marks_of, noisy, to_mm

P = Params()


@pytest.mark.parametrize("ke", [0.0015, 0.005, 0.01])
@pytest.mark.parametrize("size", [(640, 480), (320, 240)])
def test_the_noise_of_a_plain_wall_is_recovered(ke: float, size: tuple[int, int]) -> None:
    info = camera_info(*size, ke_per_m=0.0025)  # neither far below 0.6 of it nor above four times it
    depth = noisy(flat_wall(info, 6.0, 0.2, 0.1), ke, 3)
    got = estimate_ke(
        marks_of(depth, info), info.intrinsics.fx, info.ke_per_m, math.nan, math.nan, Params(min_sigma_px=0.01)
    )
    assert got == pytest.approx(ke, rel=0.15)


def test_the_noise_stays_within_the_span_of_its_prior() -> None:
    info = camera_info(320, 240)
    p = Params(min_sigma_px=0.01, noise_prior_span=2.0)
    loud, silent = noisy(flat_wall(info, 6.0), 0.02, 3), flat_wall(info, 6.0)
    assert estimate_ke(marks_of(loud, info), 225.0, 0.004, math.nan, math.nan, p) == pytest.approx(0.008, rel=0.025)
    assert estimate_ke(marks_of(silent, info), 225.0, 0.004, math.nan, math.nan, p) == pytest.approx(0.0024, rel=0.025)
    assert estimate_ke(marks_of(silent, info), 225.0, 0.004, math.nan, 1e-5, p) == pytest.approx(0.002, rel=0.025)


def test_the_noise_estimate_changes_slowly_and_is_kept() -> None:
    info = camera_info(320, 240)
    p = Params(min_sigma_px=0.01)
    image = marks_of(noisy(flat_wall(info, 6.0), 0.008, 3), info)
    once = estimate_ke(image, 225.0, 0.004, 0.004, math.nan, p)
    assert 0.004 < once < 0.006  # a memory of 0.7 takes a third of the way
    ke = 0.004
    for _ in range(30):
        ke = estimate_ke(image, 225.0, 0.004, ke, math.nan, p)
    assert ke == pytest.approx(0.008, rel=0.2)
    assert estimate_ke(image, 225.0, 0.004, ke, math.nan, p) == ke  # at rest
    blank = np.zeros_like(image)
    assert estimate_ke(blank, 225.0, 0.004, 0.0055, math.nan, p) == 0.0055
    assert estimate_ke(blank, 225.0, 0.004, math.nan, math.nan, p) == 0.004
    assert estimate_ke(image, 225.0, 0.004, 0.0055, math.nan, replace(p, estimate_noise=False)) == 0.004


def leaves(info: CameraInfo, ke: float, seed: int) -> np.ndarray:
    """Leaves of 4 px about 5 m off, in some places 0.15 m deep, in others 1.8 m, seen with noise."""
    k, rng = info.intrinsics, np.random.default_rng(seed)
    deep = np.kron(np.exp(rng.uniform(-2.0, 0.6, (k.height // 40, k.width // 40))), np.ones((10, 10)))
    depth = 5.0 + deep * rng.uniform(-1.0, 1.0, (k.height // 4, k.width // 4))
    return noisy(to_mm(np.kron(depth, np.ones((4, 4)))), ke, seed)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_leaves_alone_do_not_raise_the_noise(seed: int) -> None:
    info, p = camera_info(320, 240), Params(min_sigma_px=0.01)
    image = marks_of(leaves(info, 0.002, seed), info)
    assert noise_tiles(image, 225.0, p)[1] > 2.0 * 0.002 * 225.0
    assert estimate_ke(image, 225.0, 0.002, math.nan, math.nan, p) == 0.002
    assert estimate_ke(image, 225.0, 0.002, 0.003, math.nan, p) == 0.003
    # noise below the prior is accepted all the same
    assert estimate_ke(image, 225.0, 0.05, math.nan, math.nan, p) == pytest.approx(0.6 * 0.05, rel=0.025)
    # and what was measured over time outranks both
    assert estimate_ke(image, 225.0, 0.006, math.nan, 0.002, p) == pytest.approx(0.002, rel=0.025)
    # and a wall over a part of the image shows it
    image[:, 160:] = marks_of(noisy(flat_wall(info, 6.0), 0.004, seed), info)[:, 160:]
    assert estimate_ke(image, 225.0, 0.002, math.nan, math.nan, p) == pytest.approx(0.004, rel=0.15)


@pytest.mark.nojit
@given(st.lists(st.floats(-1, 9, width=32), min_size=1, max_size=12), st.floats(0.1, 9), st.floats(1.01, 3.0))
def test_how_many_tiles_agree(values: list[float], value: float, within: float) -> None:
    tiles = np.array([values], np.float32)
    want = sum(value / within <= float(t) <= value * within for t in tiles[0])
    assert agreeing_tiles(tiles, value, within) == want


def test_each_tile_has_the_noise_of_its_own_pixels() -> None:
    """Left half quiet, right half loud, the top row of tiles unknown."""
    info = camera_info(320, 240)
    depth = np.where(np.arange(320) < 160, noisy(flat_wall(info, 6.0), 0.002, 3), noisy(flat_wall(info, 6.0), 0.008, 4))
    depth[:60] = 0
    tiles, *_ = noise_tiles(
        marks_of(depth.astype(np.uint16), info), 225.0, Params(noise_tiles_down=4, noise_tiles_across=2)
    )
    assert tiles.shape == (4, 2)
    assert (tiles[0] < 0).all()
    np.testing.assert_allclose(tiles[1:], [[0.45, 1.8]] * 3, rtol=0.1)


def test_which_tiles_and_pixels_determine_the_noise_is_a_setting() -> None:
    info = camera_info(320, 240)
    near, half = noisy(flat_wall(info, 1.4), 0.004, 3), noisy(flat_wall(info, 6.0), 0.002, 3)
    half[:, 160:] = noisy(flat_wall(info, 6.0), 0.006, 4)[:, 160:]
    p = Params(min_sigma_px=0.01)
    assert estimate_ke(marks_of(near, info), 225.0, 0.003, math.nan, math.nan, p) == 0.003
    got = estimate_ke(marks_of(near, info), 225.0, 0.003, math.nan, math.nan, replace(p, noise_min_depth_m=0.0))
    assert got == pytest.approx(0.004, rel=0.15)
    for quantile, want in ((0.25, 0.002), (0.75, 0.006)):
        got = estimate_ke(marks_of(half, info), 225.0, 0.003, math.nan, math.nan, replace(p, noise_quantile=quantile))
        assert got == pytest.approx(want, rel=0.15)


@pytest.mark.nojit
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 3), st.sampled_from([0.0, 1.5]))
def test_the_roughness_of_tiles_against_its_definition(seed: int, step: int, row_step: int, least_m: float) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(1200, 6000, (26, 45)).astype(np.uint16)
    image[rng.random(image.shape) < 0.1] = rng.choice([0, FAR_MM])
    out = np.empty((2, 3), np.float32)
    tile_roughness(image, TileRules(30.0, 1000.0 * least_m, step, row_step, 20), out)
    for v in range(2):
        for u in range(3):
            bends = naive.bends(image[v * 13 : (v + 1) * 13 : row_step, u * 15 : (u + 1) * 15], 30.0, least_m, step)
            if len(bends) < 20:
                assert out[v, u] == -1
            else:
                # in the bin of 0.05 px that holds the (lower) median; beyond the last bin a tile only counts as rough
                median = sorted(bends)[(len(bends) + 1) // 2 - 1]
                assert out[v, u] == pytest.approx(min(median, 25.6), abs=0.0501)


@pytest.mark.nojit
def test_a_picture_too_narrow_for_the_step_shows_no_noise() -> None:
    out = np.zeros((2, 2), np.float32)
    tile_roughness(np.full((16, 16), 3000, np.uint16), TileRules(30.0, 0.0, 8, 1, 1), out)
    assert (out == -1).all()


@pytest.mark.nojit
@given(st.lists(st.floats(-1, 9, width=32), min_size=1, max_size=12), st.floats(0, 1), st.integers(1, 4))
def test_the_quantile_of_the_tiles_that_are_known(values: list[float], share: float, least: int) -> None:
    tiles = np.array([values], np.float32)
    known = tiles[tiles >= 0]
    want = np.quantile(known.astype(float), share) if len(known) >= least else -1.0
    assert quantile_of_tiles(tiles, share, least) == pytest.approx(want, abs=1e-6)

"""Each rule that a stereo match must pass: off, there are depths where nothing is; on, there are none, and things stay."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from drivers.cameras.match_confidence import (
    EVERY_MATCH,
    ConfidenceLimits,
    accepted_matches,
    derivative,
    large_patches,
    match_statistics,
    patches,
    repetitive,
    without_shared,
    without_smear,
)
from drivers.cameras.stereo import MatchParams, StereoMatcher, compute_disparity, matcher

WIDTH, HEIGHT, D = 320, 160, 48
PARAMS = MatchParams(disparities=D, edge_px=0)
ALL = ConfidenceLimits()


def rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def texture(seed: int, width: int = WIDTH + D, contrast: float = 25.0) -> np.ndarray:
    """(HEIGHT, width) grey: blurred noise, nowhere the same."""
    image = cv2.GaussianBlur(rng(seed).standard_normal((HEIGHT, width)), (0, 0), 1.5)
    return 120.0 + contrast * image / image.std()


def noisy(image: np.ndarray, noise_grey: float, seed: int) -> np.ndarray:
    return np.clip(np.rint(image + noise_grey * rng(seed).standard_normal(image.shape)), 0, 255).astype(np.uint8)


def sky(noise_grey: float) -> tuple[np.ndarray, np.ndarray]:
    """A clear sky over a textured field at infinity."""
    v = np.arange(HEIGHT)[:, None]
    image = np.where(v < 120, 200.0 - 0.15 * v, texture(1)[:, :WIDTH])
    return noisy(image, noise_grey, 2), noisy(image, noise_grey, 3)


def matched(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return compute_disparity(matcher(PARAMS), left, right, PARAMS)


@pytest.mark.parametrize("noise_grey", [0.5, 1.0, 1.5])
@pytest.mark.parametrize(
    ("rule", "left_over"),
    [({"correlation": 0.7}, 0.004), ({"texture": 3.0}, 0.0), ({"correlation": 0.7, "texture": 3.0}, 0.0)],
)
def test_noise_of_a_blank_sky_is_no_depth(noise_grey: float, rule: dict[str, float], left_over: float) -> None:
    """Correlation alone leaves a patch by chance, texture takes every near match out of the sky; the textured field stays."""
    left, right = sky(noise_grey)
    found = matched(left, right)
    high = np.s_[:112, D:]
    assert np.mean(found[high] > 2.0) > 0.03
    kept = accepted_matches(left, right, found, replace(EVERY_MATCH, **rule, patch_px=20))
    assert np.mean(kept[high] > 2.0) <= left_over
    assert np.mean(kept[128:, D:] >= 0.0) > 0.95 * np.mean(found[128:, D:] >= 0.0)


def test_texture_that_the_other_image_does_not_show_is_hardly_ever_a_depth() -> None:
    """A thing too near to be matched, a reflection: there is texture in both images, and it is not the same. Two textures
    agree by chance, strong ones not well."""
    shares = np.zeros(3)
    for seed in range(20, 80, 10):
        views = [cv2.GaussianBlur(rng(seed + i).standard_normal((HEIGHT, WIDTH)), (0, 0), 1.0) for i in range(2)]
        left, right = (noisy(120.0 + 25.0 * view / view.std(), 1.0, seed + 2 + i) for i, view in enumerate(views))
        found = matched(left, right)
        weak = accepted_matches(left, right, found, replace(ALL, strong_correlation=0.0))
        shares += [np.mean(d >= 0.0) / 6 for d in (found, weak, accepted_matches(left, right, found, ALL))]
    assert shares[0] > 0.01
    assert shares[1] < 0.6 * shares[0]
    assert shares[2] < 0.25 * shares[1]


@pytest.mark.parametrize(("disparity_px", "least"), [(2, 0.91), (3, 0.91), (12, 0.85)])
def test_a_far_match_of_strong_texture_must_agree_better(disparity_px: int, least: float) -> None:
    """What is behind a rod agrees in a window that holds the rod, though not as well."""
    shared, other = texture(30), texture(31)
    mixed = shared.copy()
    lower = np.s_[HEIGHT // 2 :]
    mixed[lower] = 120.0 + 0.88 * (shared[lower] - 120.0) + 0.47 * (other[lower] - 120.0)
    left, right = noisy(shared[:, :WIDTH], 0.3, 32), noisy(mixed[:, disparity_px : disparity_px + WIDTH], 0.3, 33)
    found = np.full(left.shape, disparity_px, np.float32)
    kept = accepted_matches(left, right, found, replace(EVERY_MATCH, correlation=0.7)) >= 0.0
    s = match_statistics(left, right, found, EVERY_MATCH.window_px)
    strong = (s.variance > 100.0 * s.noise_variance) & (s.matched > 0.9)
    agrees = s.correlation >= least - 2.0 * s.noise_variance / s.variance
    assert strong.mean() > 0.5
    assert 0.1 < np.mean(agrees[lower]) < 0.9
    np.testing.assert_array_equal(kept[strong], agrees[strong])


def test_a_fence_matches_itself_at_other_disparities() -> None:
    """Bars every 9 px before a blank sky, the true disparity is 20 px."""
    u = np.arange(WIDTH + D)
    bars = np.where(u % 9 < 2, 90.0, 180.0)
    image = np.broadcast_to(cv2.GaussianBlur(bars[None], (0, 0), 0.6), (HEIGHT, WIDTH + D))
    left, right = noisy(image[:, :WIDTH], 1.0, 4), noisy(image[:, 20 : 20 + WIDTH], 1.0, 5)
    found = matched(left, right)
    inner = np.s_[20:-20, 80:-40]
    wrong = (found >= 0.0) & (np.abs(found - 20.0) > 2.0)
    assert wrong[inner].mean() > 0.05
    without = accepted_matches(left, right, found, replace(ALL, period=1.0))
    assert ((without >= 0.0) & (np.abs(without - 20.0) > 2.0))[inner].mean() > 0.01
    assert not (accepted_matches(left, right, found, ALL)[inner] >= 0.0).any()


@pytest.mark.parametrize("period_px", [3.0, 3.15, 3.3, 3.5, 3.8, 4.5, 5.5, 6.5, 7.5, 9.7])
def test_a_net_repeats_itself_whatever_its_period(period_px: float) -> None:
    """A mesh of 3 cm at 3 to 10 m. A period between whole pixels was not found, and parts of the net were measured twice as far away."""
    u = np.arange(8 * WIDTH) / 8.0
    fine = np.where(u % period_px < 0.3 * period_px, 70.0, 110.0)
    image = np.broadcast_to(fine.reshape(-1, 8).mean(axis=1), (HEIGHT, WIDTH))
    assert repetitive(noisy(image, 1.0, 7), ALL.period, ALL.period_px)[:, 40:-40].mean() > 0.95


@pytest.mark.parametrize("grain_px", [0.5, 0.7, 1.0, 2.0])
def test_texture_does_not_repeat_itself(grain_px: float) -> None:
    texture = cv2.GaussianBlur(rng(8).standard_normal((HEIGHT, WIDTH)), (0, 0), grain_px)
    image = 120.0 + 25.0 * texture / texture.std()
    assert repetitive(noisy(image, 1.0, 9), ALL.period, ALL.period_px).mean() < 0.005


def test_two_poles_are_no_repetition() -> None:
    image = np.full((HEIGHT, WIDTH + D), 180.0)
    image[:, 150:153] = image[:, 170:173] = 80.0
    left = noisy(image[:, :WIDTH], 1.0, 6)
    assert not repetitive(left, ALL.period, ALL.period_px)[:, 140:185].any()


@pytest.mark.parametrize("noise_grey", [0.5, 1.0, 1.5])
def test_a_blank_box_keeps_its_upright_outline_and_nothing_else(noise_grey: float) -> None:
    """A box 100 px wide, 24 px of disparity, before a blank sky: the matcher smears depth over both."""
    left, right = np.full((HEIGHT, WIDTH), 200.0), np.full((HEIGHT, WIDTH), 200.0)
    left[20:, 150:250], right[20:, 126:226] = 130.0, 130.0
    left, right = noisy(left, noise_grey, 7), noisy(right, noise_grey, 8)
    found = StereoMatcher(PARAMS).disparity(left, right)
    for edge in (150, 250):
        beside = found[30:-10, edge - 3 : edge + 3]
        assert np.mean((np.abs(beside - 24.0) < 1.0).any(axis=1)) > 0.98
    reach = PARAMS.window_px // 2 + 2  # the derivative reaches one pixel farther
    assert not (found[:, D : 150 - reach] >= 0.0).any()
    assert not (found[30:, 150 + reach : 250 - reach] >= 0.0).any()
    assert not (found[:, 250 + reach :] >= 0.0).any()
    smeared = StereoMatcher(
        replace(PARAMS, correlation=0.0, texture=0.0, period=1.0, patch_px=0, patch_per_px=0.0, shared=1.0)
    ).disparity(left, right)
    assert (smeared[:, 250 + reach :] >= 0.0).any() or (smeared[30:, 160:240] >= 0.0).any()


def test_a_textured_wall_stays_whole() -> None:
    image = texture(9)
    left, right = noisy(image[:, :WIDTH], 1.0, 10), noisy(image[:, 12 : 12 + WIDTH], 1.0, 11)
    found = matched(left, right)
    kept = accepted_matches(left, right, found, ALL)
    inner = np.s_[8:-8, D:-8]
    assert np.mean(np.abs(kept[inner] - 12.0) < 0.5) > 0.98


def test_the_right_border_is_matched_too() -> None:
    """The check from the right image needs columns beyond the left image's end for far things; without them the last
    columns would never be measured."""
    image = texture(9)
    left, right = noisy(image[:, :WIDTH], 1.0, 10), noisy(image[:, 2 : 2 + WIDTH], 1.0, 11)
    found = matched(left, right)
    assert np.mean(np.abs(found[8:-8, -40:-4] - 2.0) < 0.5) > 0.98


def test_brightness_of_one_imager_does_not_matter() -> None:
    image = texture(9)
    left, right = noisy(image[:, :WIDTH], 1.0, 10), noisy(0.9 * image[:, 12 : 12 + WIDTH] + 8.0, 1.0, 11)
    s = match_statistics(left, right, np.full(left.shape, 12.0, np.float32), 7)
    assert np.median(s.correlation[8:-8, D:-16]) > 0.97


def test_the_correlation_is_that_of_texture_in_noise() -> None:
    """Texture of variance t, noise of variance n: t / (t + n)."""
    image, noise_grey = texture(12, contrast=3.0), 1.0
    left, right = noisy(image[:, :WIDTH], noise_grey, 13), noisy(image[:, 12 : 12 + WIDTH], noise_grey, 14)
    s = match_statistics(left, right, np.full(left.shape, 12.0, np.float32), 31)
    t = float(cv2.Sobel(image, cv2.CV_64F, 1, 0, ksize=3, scale=1 / 8).var())
    n = 3.0 / 16.0 * (noise_grey**2 + 1.0 / 12.0)
    assert np.median(s.correlation[20:-20, 60:-20]) == pytest.approx(t / (t + n), abs=0.03)


@pytest.mark.parametrize("noise_grey", [0.5, 1.0, 1.5, 3.0])
def test_the_noise_is_measured_beside_texture(noise_grey: float) -> None:
    """The 20th percentile over windows lies somewhat below the mean."""
    image = texture(15)
    left, right = noisy(image[:, :WIDTH], noise_grey, 16), noisy(image[:, 12 : 12 + WIDTH], noise_grey, 17)
    s = match_statistics(left, right, np.full(left.shape, 12.0, np.float32), 7)
    true = 3.0 / 16.0 * (noise_grey**2 + 1.0 / 12.0)
    assert 0.6 * true < s.noise_variance < 1.05 * true


def test_a_blank_thing_does_not_take_the_depth_of_the_texture_behind_it() -> None:
    """A blank bar before a textured wall: along its level edges nothing locates it, and the wall's disparity reaches into it."""
    image = texture(22)
    left, right = image[:, :WIDTH].copy(), image[:, 4 : 4 + WIDTH].copy()
    left[60:100], right[60:100] = 130.0, 130.0
    left, right = noisy(left, 1.0, 23), noisy(right, 1.0, 24)
    found = matched(left, right)
    inside = np.s_[60:100, 60:-20]
    rows = [
        int((accepted_matches(left, right, found, replace(ALL, smear_rows=rows))[inside] >= 0.0).any(axis=1).sum())
        for rows in (0, 4)
    ]
    assert rows[0] >= 4
    assert rows[1] == 0
    kept = accepted_matches(left, right, found, ALL)
    assert np.mean(kept[10:50, 60:-20] >= 0.0) > 0.98


def shifted(view: np.ndarray, disparity_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Both images of a view (HEIGHT, WIDTH + D) at one disparity, with noise of 1 grey level."""
    return noisy(view[:, :WIDTH], 1.0, 2), noisy(view[:, disparity_px : WIDTH + disparity_px], 1.0, 3)


@pytest.mark.parametrize(("disparity_px", "stays"), [(0, True), (8, False)])
def test_the_rows_of_far_ground_that_fades_stay(disparity_px: int, stays: bool) -> None:
    """Ground loses its texture in the distance, without an edge: one row is dropped, not four."""
    fade = np.clip((np.arange(HEIGHT) - 40) / 80.0, 0.0, 1.0)[:, None]
    left, right = shifted(120.0 + fade * (texture(11, contrast=10.0) - 120.0), disparity_px)
    found = matched(left, right)
    all_rows, kept = (accepted_matches(left, right, found, replace(ALL, smear_rows=n)) >= 0.0 for n in (1, 4))
    all_rows, kept = all_rows[:, D:], kept[:, D:]
    dropped_rows = float((all_rows & ~kept).sum(axis=0).mean())
    assert all_rows[100:].mean() > 0.95
    assert (dropped_rows < 1.5) == stays, dropped_rows


@pytest.mark.parametrize("contrast", [5.0, 10.0, 25.0])
def test_a_blank_thing_before_far_texture_does_not_take_its_rows(contrast: float) -> None:
    """But for single pixels of the row beside it, by noise."""
    for row in (70, 71, 72):
        view = texture(12, contrast=contrast)
        view[:row] = 120.0
        left, right = shifted(view, 0)
        kept = accepted_matches(left, right, matched(left, right), ALL)
        assert not (kept[: row - 1, D:] >= 0.0).any()
        assert np.mean(kept[row - 1, D:] >= 0.0) < 0.1


def test_the_steps_of_a_slanted_edge_stay() -> None:
    """A nearly level edge before the sky is measured where it steps from row to row."""
    v, u = np.ogrid[:HEIGHT, : WIDTH + D]
    image = np.where(v > 60.0 + 0.05 * u, 110.0, 200.0) * np.ones((HEIGHT, WIDTH + D))
    left, right = noisy(image[:, :WIDTH], 1.0, 25), noisy(image[:, 14 : 14 + WIDTH], 1.0, 26)
    kept = accepted_matches(left, right, matched(left, right), ALL)[:, D:-4]
    assert (np.abs(kept - 14.0) < 1.0).sum() > 50
    assert ((kept >= 0.0) & (np.abs(kept - 14.0) > 1.5)).sum() == 0


def test_holes_in_weak_texture_do_not_grow() -> None:
    disparity = np.full((60, 80), 9.0, np.float32)
    disparity[30:34, 40:44] = -1.0
    assert np.array_equal(without_smear(disparity, 1, 4, 7, np.zeros(disparity.shape, np.bool_)), disparity)


@pytest.mark.parametrize(
    ("disparity_px", "rows", "stays"), [(37.0, 20, False), (37.0, 30, True), (9.5, 20, True), (0.0, 5, True)]
)
def test_a_near_edge_needs_more_rows(disparity_px: float, rows: int, stays: bool) -> None:
    """Two equal edges of different things agree in 20 rows at a disparity of 37 px, as if a thing stood at 3 m."""
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[40 : 40 + rows, 100:104] = disparity_px
    disparity[:, 200:260] = 45.0  # a large thing nearer still
    kept = large_patches(disparity, 3.0, 1.5)
    assert (kept[40 : 40 + rows, 100:104] == disparity_px).all() == stays
    assert (kept[:, 200:260] == 45.0).all()
    assert (kept[:, :90] == -1.0).all()


def test_without_any_match_no_patch_is_large() -> None:
    nothing = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    assert np.array_equal(large_patches(nothing, 3.0, 1.5), nothing)
    assert np.array_equal(without_shared(nothing, 0.5, 1.5), nothing)


def edges_of_two_pillars(column: int, rows: int) -> np.ndarray:
    """The left edge of a far pillar, 3 px wide from column 113 on at 10 px, so from 103 on in the right image; that of a near one, 3 px
    wide from `column` on at 37 px, which touches the near pillar's own edge at 19 px; and a textured wall at 30 px."""
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[:, 113:116] = 10.0
    disparity[60 : 60 + rows, column : column + 3] = 37.0
    disparity[60 + rows :, column : column + 3] = 19.0
    disparity[:, 220:300] = 30.0
    return disparity


@pytest.mark.parametrize(("column", "dropped"), [(139, True), (141, True), (146, False), (134, False)])
def test_an_edge_of_the_right_image_belongs_to_one_thing(column: int, dropped: bool) -> None:
    """At a disparity of 37 px the columns from 139 to 142 of the near pillar lie on the edge of the far one."""
    before = edges_of_two_pillars(column, 50)
    kept = without_shared(before, 0.5, 1.5)
    near = before == 37.0
    assert (kept[near] == (-1.0 if dropped else 37.0)).all()
    assert np.array_equal(kept[~near], before[~near])


def test_an_edge_that_shares_few_rows_stays() -> None:
    """The far edge ends: less than half of the near patch lies on it."""
    before = edges_of_two_pillars(140, 50)
    before[80:, 113:116] = -1.0
    assert np.array_equal(without_shared(before, 0.5, 1.5), before)


def test_a_wide_thing_beside_its_background_stays() -> None:
    """Foreground and background touch in the right image, column by column in the left one where nothing is hidden."""
    before = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    before[40:80, 120:140] = 20.0
    before[:, 60:105] = 5.0
    before[:, 140:300] = 5.0
    assert np.array_equal(without_shared(before, 0.5, 1.5), before)


def test_small_patches_are_dropped() -> None:
    disparity = np.full((40, 60), -1.0, np.float32)
    disparity[5:8, 5:11] = 7.0
    disparity[20:30, 20:30] = 9.0
    kept = patches(disparity, 20, 1.5)
    assert (kept[5:8, 5:11] < 0.0).all()
    assert (kept[20:30, 20:30] == 9.0).all()


def test_the_derivative_is_per_pixel_along_the_row() -> None:
    ramp = np.broadcast_to(2 * np.arange(50, dtype=np.uint8), (20, 50)).copy()
    assert np.allclose(derivative(ramp)[:, 2:-2], 2.0)
    assert np.allclose(derivative(np.ascontiguousarray(ramp.T))[2:-2], 0.0)


def test_nothing_matched_gives_nothing() -> None:
    left, right = sky(1.0)
    none = np.full(left.shape, -1.0, np.float32)
    assert np.array_equal(accepted_matches(left, right, none, ALL), none)

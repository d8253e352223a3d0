"""The sensor model's statistics, each against what its field promises."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.types import FAR_MM, SATURATED_MM, UNKNOWN_MM
from drivers.simulation.sensor_model import PERFECT, TYPICAL, SensorModel, measure, unit_noise
from drivers.simulation.source import camera_info, render

INFO = camera_info(320, 240)


def flat(z_m: float) -> np.ndarray:
    return np.full((240, 320), z_m)


def test_perfect_sensor_rounds_to_millimetres() -> None:
    assert (measure(flat(7.1234), INFO, PERFECT, 0) == 7123).all()


@pytest.mark.parametrize("z_m", [2.0, 6.0, 11.0])
def test_noise_is_constant_in_disparity(z_m: float) -> None:
    ke = 0.005
    d = measure(flat(z_m), INFO, SensorModel(ke_per_m=ke, noise_length_px=0.0), 1)
    assert (d != UNKNOWN_MM).all()
    inverse = 1000.0 / d.astype(np.float64)
    assert inverse.std() == pytest.approx(ke, rel=0.02)
    assert inverse.mean() == pytest.approx(1.0 / z_m, abs=5 * ke / np.sqrt(d.size))


def test_same_seed_and_frame_same_noise() -> None:
    first, again = (measure(flat(8.0), INFO, TYPICAL, 4, 9) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert (first != measure(flat(8.0), INFO, TYPICAL, 4, 10)).mean() > 0.5
    assert (first != measure(flat(8.0), INFO, TYPICAL, 5, 9)).mean() > 0.5


def test_range_clip_and_sky() -> None:
    depth = np.concatenate([flat(0.2)[:60], flat(5.0)[:60], flat(25.0)[:60], flat(np.inf)[:60]])
    for sky_is_far, beyond in ((False, UNKNOWN_MM), (True, FAR_MM)):
        d = measure(depth, INFO, SensorModel(sky_is_far=sky_is_far), 0)
        assert [int(d[row, 7]) for row in (0, 60, 120, 180)] == [UNKNOWN_MM, 5000, beyond, beyond]


def test_noise_never_makes_a_surface_of_the_sky() -> None:
    d = measure(flat(np.inf), INFO, SensorModel(ke_per_m=0.05), 2)
    assert (d == UNKNOWN_MM).all()


def test_dropouts_saturation_and_blind_band() -> None:
    model = SensorModel(dropout_share=0.05, saturated_share=0.02, blind_left_px=13)
    d = measure(flat(5.0), INFO, model, 3)
    assert (d[:, :13] == UNKNOWN_MM).all()
    rest = d[:, 13:]
    assert (rest == UNKNOWN_MM).mean() == pytest.approx(0.05 * 0.98, rel=0.1)
    assert (rest == SATURATED_MM).mean() == pytest.approx(0.02, rel=0.15)


def test_holes_are_blobs() -> None:
    d = measure(flat(5.0), INFO, SensorModel(holes=3, hole_radius_px=10.0), 5)
    hole = d == UNKNOWN_MM
    assert 100 < hole.sum() < 3 * np.pi * 15.0**2
    inner = hole[1:-1, 1:-1] & hole[:-2, 1:-1] & hole[2:, 1:-1] & hole[1:-1, :-2] & hole[1:-1, 2:]
    assert inner.sum() > 0.7 * hole.sum()


def test_mismatches_cover_their_share_in_blocks_of_two() -> None:
    d = measure(flat(10.0), INFO, SensorModel(mismatch_share=0.002), 6)
    wrong = d != 10000
    assert wrong.mean() == pytest.approx(0.002, rel=0.1)
    v, u = np.nonzero(wrong[:-1, :-1])
    beside = sum(
        bool(wrong[max(0, a - 1) : a + 2, max(0, b - 1) : b + 2].sum() >= 4) for a, b in zip(v, u, strict=True)
    )
    assert beside == len(v)


def test_flying_pixels_lie_between_both_sides_and_only_beside_the_edge() -> None:
    depth = flat(10.0)
    depth[:, :160] = 4.0
    d = measure(depth, INFO, SensorModel(flying_share=0.4), 7).astype(int)
    changed = d != np.rint(1000 * depth)
    assert set(np.nonzero(changed)[1]) == {159, 160}
    assert changed.sum() == pytest.approx(0.4 * 240, rel=0.2)
    assert (d[changed] >= 4000).all()
    assert (d[changed] <= 10000).all()


def test_scaled_faults_follow_the_image_width() -> None:
    half = TYPICAL.scaled_to(320)
    assert (half.hole_radius_px, half.blind_left_px) == (TYPICAL.hole_radius_px / 2, TYPICAL.blind_left_px / 2)
    assert half.ke_per_m == TYPICAL.ke_per_m


@pytest.mark.parametrize(
    "wrong",
    [{"ke_per_m": -1.0}, {"dropout_share": 1.5}, {"holes": -1}, {"hole_radius_px": 0.0}, {"ke_per_m": float("nan")}],
)
def test_impossible_faults_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SensorModel(**wrong)


def test_rendered_frame_is_truth_plus_noise() -> None:
    r = render("street", INFO, sensor=SensorModel(ke_per_m=0.0015), seed=2)
    both = (r.depth_mm > 0) & np.isfinite(r.truth.depth_m) & (r.truth.depth_m < 15.0)
    error = 1000.0 / r.depth_mm[both] - 1.0 / r.truth.depth_m[both]
    assert both.mean() > 0.5
    assert error.std() == pytest.approx(0.0015, rel=0.03)


@pytest.mark.parametrize("length_px", [0.0, 9.0, 20.0])
def test_noise_is_correlated_over_the_length_that_is_asked_for(length_px: float) -> None:
    noise = unit_noise((480, 640), length_px, np.random.default_rng(1))
    assert noise.std() == pytest.approx(1.0, rel=0.03)
    for lag in (1, 8, round(length_px), 60):
        expected = math.exp(-((lag / length_px) ** 2)) * 0.95 if length_px else 0.0
        along = (noise[:, lag:] * noise[:, :-lag]).mean() if lag else 1.0
        down = (noise[lag:] * noise[:-lag]).mean() if lag else 1.0
        if lag:
            assert (along, down) == (pytest.approx(expected, abs=0.08), pytest.approx(expected, abs=0.08))


def test_the_default_noise_is_that_of_a_real_camera_and_white_noise_can_be_had() -> None:
    assert SensorModel().noise_length_px == 9.0
    flat_white = measure(flat(5.0), INFO, SensorModel(ke_per_m=0.005, noise_length_px=0.0), 1).astype(float)
    blobs = measure(flat(5.0), INFO, SensorModel(ke_per_m=0.005), 1).astype(float)
    assert np.std(flat_white) == pytest.approx(np.std(blobs), rel=0.1)
    assert np.std(np.diff(blobs)) < 0.5 * np.std(np.diff(flat_white))


def test_a_smearing_camera_turns_steps_into_ramps_and_keeps_what_borders_on_nothing() -> None:
    info = camera_info(160, 24, max_range_m=20.0)
    depth_m = np.full((24, 160), 9.0)
    depth_m[:, 40:80] = 5.0
    depth_m[:, 120:] = np.inf
    inverse = 1000.0 / measure(depth_m, info, SensorModel(smear_px=9.0), 1)[:, :120]
    sharp = 1000.0 / measure(depth_m, info, SensorModel(), 1)[:, :120]
    between = (inverse > 1 / 8.8) & (inverse < 1 / 5.1)
    assert not ((sharp > 1 / 8.8) & (sharp < 1 / 5.1)).any()
    assert (between.sum(axis=1) >= 12).all(), "two ramps"
    assert (inverse[:, 40:80] > 1 / 5.01)[:, 2:-2].all(), "the near surface has grown"
    assert np.all(np.diff(inverse[12, 28:42]) >= 0.0)
    np.testing.assert_array_equal(measure(depth_m, info, SensorModel(smear_px=9.0), 1)[:, 120:], 0)
    depth_m[:, 40:80] = 2.0
    steep = measure(depth_m, info, SensorModel(smear_px=9.0), 1)[:, :120]
    assert not ((steep > 2100) & (steep < 8900)).any(), "larger steps stay sharp"


@pytest.mark.parametrize("baseline_m", [0.0, 0.12])
def test_the_left_side_of_a_near_thing_hides_what_is_behind_from_the_second_imager(baseline_m: float) -> None:
    """Its disparity is fx B / Z: the shadow is as wide as the disparities differ, whether a wall or the sky is behind."""
    info = camera_info(640, 24, max_range_m=20.0)
    for behind_m in (9.0, math.inf):
        depth_m = np.full((24, 640), behind_m)
        depth_m[:, 300:340] = 3.0
        seen = measure(depth_m, info, SensorModel(baseline_m=baseline_m, sky_is_far=True), 1) != UNKNOWN_MM
        width = info.intrinsics.fx * baseline_m * (1.0 / 3.0 - 1.0 / behind_m)
        assert abs(int((~seen[12]).sum()) - width) <= 1.0
        assert seen[:, 300:].all()
        assert seen[:, : 299 - math.ceil(width)].all()


def test_one_surface_hides_nothing_of_itself() -> None:
    """Ground, and walls at an angle that both imagers see."""
    for scene in ("open", "wall"):
        hidden, whole = (
            render(scene, INFO, sensor=SensorModel(baseline_m=b), pitch_rad=-0.4, yaw_rad=0.3).depth_mm
            for b in (0.12, 0.0)
        )
        np.testing.assert_array_equal(hidden[:, 1:], whole[:, 1:])

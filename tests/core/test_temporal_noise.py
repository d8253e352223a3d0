"""Noise measured over time: from repeated frames of a camera that stands still, and from no others."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.params import Params
from core.stages.classify import pixel_limits
from core.stages.spatial_noise import estimate_ke
from core.stages.temporal_noise import SAMPLE_COLS, SAMPLE_ROWS, depth_samples, observe
from core.types import CameraInfo, ExtractorState
from drivers.simulation.sensor_model import SensorModel, measure
from drivers.simulation.source import camera_info

from ..nightly import nightly
from .views import flat_wall, marks_of

P = Params(min_sigma_px=0.01)
FRAMES = 2 * P.noise_time_frames + 1
Depth = NDArray[np.uint16]


def wall(info: CameraInfo, ke: float, length_px: float, frame: int, at_m: float = 6.0, turn_rad: float = 0.2) -> Depth:
    """One frame of a wall that is seen at a slant, by a camera with noise."""
    with np.errstate(divide="ignore"):
        depth_m = np.where(flat_wall(info, at_m, turn_rad) > 0, flat_wall(info, at_m, turn_rad) / 1000.0, np.inf)
    return measure(depth_m, info, SensorModel(ke_per_m=ke, noise_length_px=length_px), 5, frame)


def after(frames: list[Depth], info: CameraInfo, p: Params = P, state: ExtractorState | None = None) -> ExtractorState:
    state = state or ExtractorState()
    for depth in frames:
        limits = pixel_limits(info, info.ke_per_m, p)
        state = observe(state, depth, marks_of(depth, info), info.intrinsics.fx, limits, p)
    return state


@pytest.mark.parametrize("length_px", [0.0, 9.0])
@pytest.mark.parametrize("ke", [0.0015, *nightly(0.005)])
@pytest.mark.parametrize("configured", [1.0 / 3.0, 1.0, 3.0])
def test_noise_of_a_still_camera_is_measured_for_any_correlation(
    ke: float, length_px: float, configured: float
) -> None:
    info = camera_info(640, 480, ke_per_m=configured * ke)
    frames = [wall(info, ke, length_px, i) for i in range(FRAMES)]
    state = after(frames, info)
    assert state.still_ke_per_m == pytest.approx(ke, rel=0.15)
    got = estimate_ke(marks_of(frames[-1], info), info.intrinsics.fx, info.ke_per_m, math.nan, state.still_ke_per_m, P)
    assert 0.85 * ke <= got <= 1.2 * ke


def test_correlated_noise_is_not_estimated_far_below_the_prior_without_evidence_over_time() -> None:
    info = camera_info(640, 480, ke_per_m=0.005)
    image = marks_of(wall(info, 0.005, 30.0, 0), info)
    for still, least in ((math.nan, 0.6 * 0.005), (0.0045, 0.0043)):
        got = estimate_ke(image, info.intrinsics.fx, 0.005, math.nan, still, P)
        assert got >= 0.97 * least


@pytest.mark.parametrize("speed_m", [0.1, 0.5])
def test_motion_is_not_taken_for_noise(speed_m: float) -> None:
    info = camera_info(640, 480, ke_per_m=0.0015)
    frames = [wall(info, 0.0015, 9.0, i, 6.0 - speed_m * i) for i in range(FRAMES)]
    still = after(frames, info).still_ke_per_m
    assert math.isnan(still) or still == pytest.approx(0.0015, rel=0.3)


def test_a_camera_that_turns_past_objects_measures_nothing() -> None:
    """Every sample meets another surface: the differences are those of the scene."""
    info = camera_info(640, 480, ke_per_m=0.0015)
    rng = np.random.default_rng(3)
    depth_m = np.kron(rng.uniform(4.0, 9.0, (8, 40)), np.ones((60, 60)))
    sensor = SensorModel(ke_per_m=0.0015)
    frames = [measure(depth_m[:, 50 * i : 50 * i + 640], info, sensor, 2, i) for i in range(FRAMES)]
    assert math.isnan(after(frames, info).still_ke_per_m)


def test_a_frame_that_comes_twice_is_no_evidence_of_no_noise() -> None:
    info = camera_info(640, 480)
    depth = wall(info, 0.0015, 9.0, 0)
    assert math.isnan(after([depth] * FRAMES, info).still_ke_per_m)


def test_what_is_known_stays_while_the_camera_moves() -> None:
    info = camera_info(640, 480, ke_per_m=0.0015)
    known = ExtractorState(still_ke_per_m=0.002)
    frames = [wall(info, 0.0015, 9.0, i, 6.0 - 1.0 * i, 0.6) for i in range(4)]
    assert after(frames, info, state=known).still_ke_per_m == pytest.approx(0.002, rel=0.3)


def test_frames_are_compared_that_are_so_many_apart() -> None:
    info = camera_info(640, 480)
    ages, known = [], []
    state = ExtractorState()
    for i in range(P.noise_time_frames + 2):
        state = after([wall(info, 0.0015, 9.0, i)], info, state=state)
        ages.append(state.samples_age)
        known.append(math.isfinite(state.still_ke_per_m))
    n = P.noise_time_frames
    assert ages == [*range(n), 0, 1]
    assert known == [False] * n + [True] * 2


def test_the_state_is_small_and_holds_the_sampled_pixels() -> None:
    depth = np.random.default_rng(1).integers(0, 65536, (480, 640)).astype(np.uint16)
    samples = np.frombuffer(depth_samples(depth), "<u2").reshape(SAMPLE_ROWS, SAMPLE_COLS)
    assert samples[0].tolist() == depth[10, 10::20].tolist()
    assert samples[:, 0].tolist() == depth[10::20, 10].tolist()
    assert len(depth_samples(depth)) < 2000


def test_noise_that_is_not_to_be_measured_leaves_the_state() -> None:
    info = camera_info(640, 480)
    state = ExtractorState(1.0, 0.002)
    assert after([wall(info, 0.0015, 9.0, 0)], info, replace(P, estimate_noise=False), state) == state

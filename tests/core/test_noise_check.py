"""Noise in a part of the image: detected pixels, and that such a frame is invalid while foliage is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.extractor import Extractor
from core.params import Params
from core.stages.classify import PixelLimits, pixel_limits
from core.stages.noise_check import count_alone, flying_off_ramps, is_no_measurement, noisy_share
from core.types import FAR_MM, SATURATED_MM, CameraInfo, InvalidCause
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info, render

from ..nightly import nightly
from . import naive
from .views import INFO, anything_free, extract, first_hit, flat_wall, level, noisy, pixel_grid, to_mm

P = Params()


@pytest.mark.nojit
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([100, 3000, 19000]), tiles=st.sampled_from([1, 3, 5]))
def test_pixels_that_are_alone_against_their_definition(seed: int, spread: int, tiles: int) -> None:
    rng = np.random.default_rng(seed)
    depth = (rng.integers(300, 19400 - spread) + rng.integers(0, spread + 1, (12, 17))).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.1] = rng.choice([0, 1, 299, 300, FAR_MM, SATURATED_MM])
    ke, relative, absolute = 0.0005, np.float32(0.08), np.float32(0.02)
    limits = pixel_limits(INFO, ke, P)._replace(relative=relative, absolute=absolute)
    judged, alone = np.full((tiles, tiles), -1, np.int32), np.full((tiles, tiles), -1, np.int32)
    count_alone(depth, limits, judged, alone)
    raw = naive.inverse_image(depth, INFO.min_range_m, INFO.max_range_m, ke).astype(np.float32)
    want = np.zeros((2, tiles, tiles), int)
    for v, u in np.ndindex(depth.shape):
        step = absolute + relative * raw[v, u]
        what = naive.alone(raw, v, u, step)
        # tile n holds what begins at n * size // tiles
        tile = v * tiles // 12, max(n for n in range(tiles) if n * 17 // tiles <= u)
        want[0][tile] += what is not None
        want[1][tile] += what is True
    np.testing.assert_array_equal(judged, want[0])
    np.testing.assert_array_equal(alone, want[1])


@pytest.mark.nojit
def test_an_image_is_a_measurement_by_what_is_measured_or_far_and_does_not_fly() -> None:
    flat, rare = np.full((40, 50), 5000, np.uint16), round(P.min_measured_share * 2000)

    def refused(measured: int, far: int, flying: int) -> bool:
        return is_no_measurement(flat, pixel_limits(INFO, 0.0015, P), (measured, far, flying), P)

    assert refused(rare, 0, 0)
    assert not refused(rare + 1, 0, 0)
    assert refused(rare + 1, 0, 1)
    assert not refused(0, rare + 1, 0)


@pytest.mark.nojit
def test_noise_is_looked_for_where_many_pixels_fly() -> None:
    noise = np.random.default_rng(3).integers(300, 20000, (40, 50)).astype(np.uint16)
    look = round(min(0.003, P.max_flying_share) * noise.size)
    limits = pixel_limits(INFO, 0.0015, P)
    assert not is_no_measurement(noise, limits, (noise.size, 0, look), P)
    assert is_no_measurement(noise, limits, (noise.size, 0, look + 1), P)


def spoiled(depth: np.ndarray, share: float, seed: int) -> np.ndarray:
    """The image with noise in one block of so large a share of its pixels."""
    rng = np.random.default_rng(seed)
    rows, cols = (round(n * share**0.5) for n in depth.shape)
    top, left = rng.integers(0, depth.shape[0] - rows), rng.integers(0, depth.shape[1] - cols)
    out = depth.copy()
    out[top : top + rows, left : left + cols] = rng.integers(300, 20000, (rows, cols))
    return out


@pytest.mark.parametrize("ke", [0.0015, 0.005, 0.01])
@pytest.mark.parametrize("seed", range(4))
def test_a_frame_with_noise_in_a_tenth_of_it_is_invalid(ke: float, seed: int) -> None:
    info = camera_info(320, 240, ke_per_m=ke)
    clean = noisy(flat_wall(info, 5.0), ke, seed)
    assert extract(clean, info).valid
    model = extract(spoiled(clean, 0.1, seed), info)
    assert not model.valid
    assert model.cause == InvalidCause.NO_MEASUREMENT
    assert not anything_free(model)
    assert len(model.planes) == 0


def test_noise_in_a_part_changes_no_estimate() -> None:
    info = camera_info(320, 240, ke_per_m=0.005)
    clean = noisy(flat_wall(info, 5.0), 0.005, 1)
    ex = Extractor()
    _, state = ex.extract(clean, info, level())
    model, after = ex.extract(spoiled(clean, 0.1, 1), info, level(), state)
    assert not model.valid
    assert after == state


@pytest.mark.parametrize("ke", [0.0015, 0.005])
@pytest.mark.parametrize("seed", [0, *nightly(1, 2)])
def test_leaves_seen_by_a_faulty_camera_are_no_noise(ke: float, seed: int) -> None:
    """Many pixels of small leaves fly, but hardly any is unlike all of its neighbours."""
    info = camera_info(320, 240, ke_per_m=ke)
    shot = render(
        "trees", info, position_ned_m=(0.0, 0.0, -2.0), sensor=replace(TYPICAL, ke_per_m=ke).scaled_to(320), seed=seed
    )
    assert noisy_share(shot.depth_mm, pixel_limits(info, ke, P), P) == 0.0
    assert extract(shot.depth_mm, info).valid


def floor_and_wall(info: CameraInfo, height_m: float, wall_m: float, roll_rad: float) -> np.ndarray:
    """Depth of an endless floor height_m below a level camera, and of a wall across its heading."""
    R = level(0.0, roll_rad)
    u, v = pixel_grid(info.intrinsics)
    k = info.intrinsics
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1) @ R.T
    with np.errstate(divide="ignore"):
        floor_m = np.where(rays[..., 2] > 1e-9, height_m / rays[..., 2], np.inf)
        return to_mm(np.minimum(floor_m, wall_m / rays[..., 0]))


@pytest.mark.parametrize("height_m", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("ke", [0.001, 0.0015, 0.005])
@pytest.mark.parametrize("roll_rad", [0.0, 0.2])
def test_a_floor_close_below_the_camera_is_no_noise(height_m: float, ke: float, roll_rad: float) -> None:
    """Before take-off: from row to row the floor's depth changes by more than a step, so that its pixels fly."""
    info = camera_info(320, 240, ke_per_m=ke)
    for wall_m in (4.0, 100.0):
        depth = noisy(floor_and_wall(info, height_m, wall_m, roll_rad), ke, 1)
        depth[np.random.default_rng(2).random(depth.shape) < 0.05] = 0
        model = extract(depth, info, level(0.0, roll_rad))
        assert model.valid
        assert (first_hit(model, 0.0, -0.5) < wall_m + 0.3) == (wall_m < 10.0)


@pytest.mark.nojit
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([100, 3000, 19000]))
def test_flying_pixels_off_ramps_against_their_definition(seed: int, spread: int) -> None:
    rng = np.random.default_rng(seed)
    depth = (rng.integers(300, 19400 - spread) + rng.integers(0, spread + 1, (12, 17))).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.1] = rng.choice([0, 1, 299, 300, FAR_MM, SATURATED_MM])
    ke, relative, absolute = 0.0005, np.float32(0.08), np.float32(0.02)
    limits = pixel_limits(INFO, ke, P)._replace(relative=relative, absolute=absolute)
    raw = naive.inverse_image(depth, INFO.min_range_m, INFO.max_range_m, ke).astype(np.float32)
    want = 0
    for (v, u), d in np.ndenumerate(raw):
        step = absolute + relative * d
        bends = []
        for dv, du in ((0, 1), (1, 0)):
            if dv <= v < 12 - dv and du <= u < 17 - du:
                a, b = raw[v - dv, u - du], raw[v + dv, u + du]
                bends += [a + b - d - d] if min(a, b) > 0 else []
        want += naive.is_flying(raw, v, u, step) and any(abs(bend) > step for bend in bends)
    assert flying_off_ramps(depth, limits) == want


@pytest.mark.nojit
def test_a_tile_counts_with_enough_of_its_pixels_amid_measured_ones() -> None:
    rng = np.random.default_rng(3)
    noise = rng.integers(300, 19000, (32, 32)).astype(np.uint16)
    sparse = np.where(rng.random(noise.shape) < 0.5, noise, 0).astype(np.uint16)
    one = Params(noisy_tiles=1)
    limits = PixelLimits(
        np.uint16(300), np.uint16(19500), np.float32(P.flying_relative), np.float32(0.001 * P.flying_sigmas)
    )
    assert noisy_share(noise, limits, one) == 1.0
    assert noisy_share(sparse, limits, one) == 0.0
    assert noisy_share(np.zeros_like(noise), limits, one) == 0.0
    # more tiles than pixels, all alike
    assert noisy_share(np.full((3, 4), 5000, np.uint16), limits, Params(noisy_tiles=64)) == 0.0

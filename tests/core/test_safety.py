"""Blind, stale or unknown is never reported as clear; invalid input is reported; results do not depend on history."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.extractor import Extractor
from core.params import Params
from core.stages import plane_shaping
from core.stages.classify import clear_range_m
from core.stages.plane_shaping import shape_planes
from core.types import FAR_MM, SATURATED_MM, CameraInfo, ExtractorState, FrameModel, FreeEnd, Intrinsics, InvalidCause
from drivers.simulation.scenes import SceneBuilder
from drivers.simulation.sensor_model import TYPICAL
from drivers.simulation.source import camera_info, render

from .views import INFO, SMALL, VIEW, anything_free, extract, flat_wall, free_to, level, noisy, seen


def says_nothing(model: FrameModel, cause: InvalidCause) -> bool:
    return not model.valid and model.cause == cause and not anything_free(model) and len(model.planes) == 0


@pytest.mark.nojit
@pytest.mark.parametrize("least_share", [0.0, 0.02], ids=["least share 0", "default"])
@pytest.mark.parametrize("value", [0, SATURATED_MM, 200], ids=["zero", "saturated", "too near"])
def test_an_image_without_a_measurement_is_invalid_and_nothing_is_free(value: int, least_share: float) -> None:
    depth = np.full((30, 40), value, np.uint16)
    model = extract(depth, INFO, min_measured_share=least_share)
    assert says_nothing(model, InvalidCause.NO_MEASUREMENT)


@pytest.mark.nojit
def test_rotations_that_are_none_are_refused_with_their_cause() -> None:
    depth = flat_wall(INFO, 5.0)
    skewed = level().copy()
    skewed[0, 0] += 0.1
    mirrored = level() * np.array([[1.0], [-1.0], [1.0]])
    backwards = np.diag([-1.0, -1.0, 1.0]) @ level()
    turned = np.array([[0.9, -0.4359, 0.0], [0.4359, 0.9, 0.0], [0.0, 0.0, 1.0]]) @ level()
    for R in (np.full((3, 3), np.nan), np.full((3, 3), np.inf), np.zeros((3, 3)), skewed, mirrored, backwards, turned):
        assert says_nothing(extract(depth, INFO, R), InvalidCause.BAD_ROTATION)
    assert says_nothing(extract(depth, INFO, np.eye(4)), InvalidCause.BAD_ROTATION)


@pytest.mark.nojit
@pytest.mark.parametrize("pitch_deg", [-89.0, -65.0, 65.0, 89.0])
def test_a_camera_tilted_too_far_is_reported(pitch_deg: float) -> None:
    R = level(math.radians(pitch_deg))
    assert says_nothing(extract(flat_wall(INFO, 5.0), INFO, R), InvalidCause.TOO_STEEP)


@pytest.mark.nojit
@pytest.mark.parametrize(
    ("k", "tilt_rad", "roll_rad"),
    [
        (Intrinsics(17, 160, 41.3, 3.291, 20.65, 178.89), 0.0, 1.1022),
        (Intrinsics(16, 24, 2.5602, 166.2748, -7.9984, 10.0836), -0.91947, -1.23059),
    ],
    ids=["no cell", "one row"],
)
def test_a_view_without_a_pixel_that_is_not_too_steep_is_reported(
    k: Intrinsics, tilt_rad: float, roll_rad: float
) -> None:
    """A principal point outside of the image, and a camera that looks steeply or lies on its side."""
    info = CameraInfo("front", k, max_range_m=10.0)
    depth = np.full((k.height, k.width), 1000, np.uint16)
    model, _ = Extractor().extract(depth, info, level(tilt_rad, roll_rad))
    assert says_nothing(model, InvalidCause.TOO_STEEP)


@settings(max_examples=150)
@given(st.integers(0, 2**32 - 1))
def test_no_camera_and_no_attitude_end_in_an_exception(seed: int) -> None:
    rng = np.random.default_rng(seed)
    width, height = (int(rng.choice([16, 17, 24, 64])) for _ in range(2))
    fx, fy = np.exp(rng.uniform(math.log(0.1001), math.log(19.99), 2)) * width
    cx, cy = rng.uniform(-0.4999, 1.4999, 2) * (width, height)
    info = CameraInfo("front", Intrinsics(width, height, float(fx), float(fy), float(cx), float(cy)), max_range_m=60.0)
    R = level(float(rng.uniform(-1.57, 1.57)), float(rng.uniform(-math.pi, math.pi)))
    depth = rng.integers(0, 65536, (height, width)).astype(np.uint16)
    if rng.random() < 0.5:
        depth[:] = rng.integers(300, 20_000)
    model, _ = Extractor().extract(depth, info, R)
    assert model.valid or model.cause is not InvalidCause.NONE


@pytest.mark.nojit
def test_images_that_do_not_fit_raise_with_the_remedy() -> None:
    ex = Extractor()
    with pytest.raises(ValueError, match="intrinsics of this resolution"):
        ex.extract(np.zeros((40, 30), np.uint16), INFO, level())
    with pytest.raises(ValueError, match="float64"):
        ex.extract(np.zeros((30, 40)), INFO, level())
    with pytest.raises(ValueError, match="intrinsics"):
        ex.extract(np.zeros((30, 40, 1), np.uint16), INFO, level())


def test_metres_and_millimetres_give_the_same_model() -> None:
    r = render("corner", VIEW, sensor=TYPICAL, seed=3)
    metres = (r.depth_mm / 1000.0).astype(np.float32)
    metres[r.depth_mm == 0] = np.nan
    assert same(extract(r.depth_mm, VIEW, r.R_level_optical), extract(metres, VIEW, r.R_level_optical))


def test_infinite_metres_are_unknown_not_free() -> None:
    assert says_nothing(extract(np.full((240, 320), np.inf, np.float32), VIEW), InvalidCause.NO_MEASUREMENT)


def test_a_wall_beyond_what_is_measured_is_not_reported_as_free() -> None:
    """With noise a wall at 17 m of a 20 m camera is cut off before any plane is made: the free range ends before it."""
    info = camera_info(320, 240, ke_per_m=0.005)
    model = extract(noisy(flat_wall(info, 17.0), 0.005, 1), info, estimate_noise=False)
    assert clear_range_m(info, 0.005, Params()) < 17.0
    for azimuth in (-0.4, -0.2, 0.0, 0.2, 0.4):
        assert 10.0 < free_to(model, azimuth, 0.0) * math.cos(azimuth) <= clear_range_m(info, 0.005, Params())


def same(a: FrameModel, b: FrameModel) -> bool:
    """Bit-identical in everything that is published."""
    arrays = ("planes", "support_px", "margin_m", "flags", "cluster")
    free = ("azimuth_edges_rad", "layer_edges_m", "free_from_m", "free_to_m", "end")
    return (
        all(np.array_equal(getattr(a, f), getattr(b, f)) for f in arrays)
        and all(np.array_equal(getattr(a.free, f), getattr(b.free, f)) for f in free)
        and (a.valid, a.cause, a.ground, a.stats, a.ke_per_m) == (b.valid, b.cause, b.ground, b.stats, b.ke_per_m)
        and len(a.prisms) == len(b.prisms)
        and all(
            np.array_equal(p.vertices_m, q.vertices_m)
            and np.array_equal(p.plane, q.plane)
            and (p.cluster, p.top_m, p.bottom_m, p.closed, p.margin_m)
            == (q.cluster, q.top_m, q.bottom_m, q.closed, q.margin_m)
            for p, q in zip(a.prisms, b.prisms, strict=True)
        )
    )


def test_nothing_leaks_from_frame_to_frame() -> None:
    """One extractor over frames of other sizes, tilts and cameras gives what new ones give, bit for bit."""
    small = camera_info(160, 120, ke_per_m=0.005)
    wide = camera_info(400, 240, focal_px=180.0)
    views = [
        (render("street", VIEW, sensor=TYPICAL, seed=1), VIEW),
        (render("trees", small, pitch_rad=-0.3, roll_rad=0.4, sensor=TYPICAL, seed=2), small),
        (render("corner", wide, roll_rad=-0.2, sensor=TYPICAL, seed=3), wide),
    ]
    fresh = [extract(r.depth_mm, info, r.R_level_optical) for r, info in views]
    assert all(len(m.planes) > 0 for m in fresh)
    ex = Extractor()
    for i in (0, 1, 2, 1, 0, 2, 2, 0):
        r, info = views[i]
        before = r.depth_mm.copy()
        model, _ = ex.extract(r.depth_mm, info, r.R_level_optical)
        assert same(model, fresh[i])
        assert np.array_equal(before, r.depth_mm)


def test_a_model_keeps_its_numbers_when_the_next_frame_comes() -> None:
    ex = Extractor()
    a, b = render("street", VIEW, seed=1), render("alley", VIEW, seed=2)
    first, _ = ex.extract(a.depth_mm, VIEW, a.R_level_optical, keep_strips=True)
    assert first.strips is not None
    kept = first.planes.copy(), first.free.free_to_m.copy(), first.strips.x_m.copy(), first.strips.u.copy()
    ex.extract(b.depth_mm, VIEW, b.R_level_optical, keep_strips=True)
    for now, then in zip((first.planes, first.free.free_to_m, first.strips.x_m, first.strips.u), kept, strict=True):
        np.testing.assert_array_equal(now, then)


def test_read_only_and_strided_images_are_taken() -> None:
    r = render("street", VIEW, seed=1)
    want = extract(r.depth_mm, VIEW, r.R_level_optical)
    locked = r.depth_mm.copy()
    locked.flags.writeable = False
    wide = np.zeros((240, 640), np.uint16)
    wide[:, ::2] = r.depth_mm
    R = r.R_level_optical.copy()
    R.flags.writeable = False
    assert same(extract(locked, VIEW, R), want)
    assert same(extract(wide[:, ::2], VIEW, np.asfortranarray(R)), want)


def sound(model: FrameModel, info: CameraInfo) -> None:
    """What holds for every model, whatever the picture was."""
    reach = 3.7 * info.max_range_m  # a ray at max_elevation from the horizontal heading
    assert np.isfinite(model.planes).all()
    assert np.abs(model.planes).max(initial=0.0) < reach
    assert np.isfinite(model.margin_m).all()
    assert (model.margin_m >= 0.0).all()
    assert (model.support_px >= 0).all()
    ax, ay, bx, by = model.planes[:, :4].astype(float).T
    # the camera stands on the right of a -> b: level axes x forward, y right
    assert (ax * by - ay * bx > -1e-6).all()
    for prism in model.prisms:
        assert np.isfinite(prism.vertices_m).all()
        assert 0 <= prism.plane.min() <= prism.plane.max() < len(model.planes)
    f = model.free
    assert np.isfinite(f.free_to_m).all()
    assert (np.diff(f.azimuth_edges_rad) > 0.0).all()
    assert (f.free_to_m >= 0.0).all()
    assert (f.end <= int(FreeEnd.MAX_RANGE)).all()


FEW = settings(max_examples=3) if numba.config.DISABLE_JIT else settings()
"""Without the JIT an extraction takes seconds; with bounds checks all examples are run."""


@pytest.mark.nojit
@FEW
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["any", "mm", "blocks", "rows", "sparse"]),
)
def test_random_pictures_never_raise(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    shape = (SMALL.height, SMALL.width)
    if kind == "any":
        depth = rng.integers(0, 65536, shape)
    elif kind == "mm":
        depth = rng.integers(250, 21000, shape)
    elif kind == "blocks":
        depth = np.kron(rng.integers(200, 15000, (6, 8)), np.ones((5, 5), int))
    elif kind == "rows":
        depth = np.repeat(rng.integers(200, 9000, (30, 1)), 40, axis=1)
    else:
        depth = rng.integers(250, 21000, shape) * (rng.random(shape) < 0.1)
    R = level(rng.uniform(-1.0, 1.0), rng.uniform(-3.1, 3.1))
    model = extract(depth.astype(np.uint16), INFO, R)
    if model.valid:
        sound(model, INFO)


@given(seed=st.integers(0, 2**32 - 1), width=st.sampled_from([16, 64, 161]), step=st.sampled_from([1, 2, 7, 16]))
def test_random_pictures_of_other_sizes_and_steps_never_raise(seed: int, width: int, step: int) -> None:
    rng = np.random.default_rng(seed)
    info = camera_info(
        width, 96, ke_per_m=float(rng.choice([1e-5, 0.0015, 0.05])), max_range_m=float(rng.choice([2.0, 20.0, 65.0]))
    )
    depth = rng.integers(0, 66000, (96, width)).clip(0, 65535).astype(np.uint16)
    sound(extract(depth, info, level(rng.uniform(-0.9, 0.9), rng.uniform(-0.9, 0.9)), column_step=step), info)


def test_noise_of_full_width_stays_within_its_buffers() -> None:
    rng = np.random.default_rng(5)
    info = camera_info(640, 64, focal_px=450.0)
    model = extract(
        rng.integers(300, 20000, (64, 640)).astype(np.uint16),
        info,
        max_flying_share=1.0,
        max_noisy_share=1.0,
        max_strips_per_column=1024.0,
    )
    assert len(model.planes) > 0
    sound(model, info)


def test_a_picture_that_is_far_all_over_is_free_up_to_the_clear_range() -> None:
    model = extract(np.full((240, 320), FAR_MM, np.uint16), VIEW)
    limit = clear_range_m(VIEW, VIEW.ke_per_m, Params())
    assert model.valid
    assert len(model.planes) == 0
    for azimuth in (-0.4, 0.0, 0.4):
        assert limit - 0.51 <= free_to(model, azimuth, 0.0) * math.cos(azimuth) <= limit + 0.3
    middle = model.free.free_to_m.shape[0] // 2
    assert (model.free.end[middle] == int(FreeEnd.MAX_RANGE)).all()


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.2, 0.3), (-0.3, -0.5)])
def test_the_unknown_half_of_a_picture_is_not_free(side: int, tilt: tuple[float, float]) -> None:
    pitch, roll = tilt
    depth = np.full((240, 320), FAR_MM, np.uint16)
    half = np.s_[:, :160] if side < 0 else np.s_[:, 160:]
    depth[half] = 0
    model = extract(depth, VIEW, level(pitch, roll))
    assert model.valid
    assert anything_free(model)
    # rays of the unknown half, by the directions they really have
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    k = VIEW.intrinsics
    rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], -1) @ level(pitch, roll).T
    known = (depth == FAR_MM).ravel()
    azimuth = np.arctan2(rays[..., 1], rays[..., 0]).ravel()
    f = model.free
    direction = np.searchsorted(f.azimuth_edges_rad, azimuth, side="right") - 1
    for d in range(f.free_to_m.shape[0]):
        there = direction == d
        if there.any() and not known[there].any():
            assert not (f.free_to_m[d] > f.free_from_m[d]).any()


def test_nothing_is_free_past_a_plane_or_behind_a_pole() -> None:
    s = SceneBuilder("pole before a wall")
    s.wall("wall", (9.0, -30.0), (9.0, 30.0), 20.0, base=-10.0)
    s.cylinder("pole", (4.0, 0.5, 10.0), (4.0, 0.5, -20.0), 0.1)
    r = seen(s)
    model = extract(r.depth_mm, VIEW, r.R_level_optical)
    at = math.atan2(0.5, 4.0)
    assert first_free_to_pole(model, at)
    assert free_to(model, 0.4, 0.0) > 8.0
    check_no_free_range_passes_a_plane(model)


def first_free_to_pole(model: FrameModel, azimuth: float) -> bool:
    return 2.5 < free_to(model, azimuth, 0.0) <= math.hypot(4.0, 0.5) - 0.09


def check_no_free_range_passes_a_plane(model: FrameModel) -> None:
    """Every plane against every direction and layer that it crosses, by sampling points of it."""
    f = model.free
    for plane, margin in zip(model.planes.astype(float), model.margin_m, strict=True):
        ax, ay, bx, by, top, bottom = plane
        for share in np.linspace(0.002, 0.998, 60):
            x, y = ax + share * (bx - ax), ay + share * (by - ay)
            d = int(np.searchsorted(f.azimuth_edges_rad, math.atan2(y, x), side="right")) - 1
            if not 0 <= d < f.free_to_m.shape[0]:
                continue
            for layer in range(f.free_to_m.shape[1]):
                if top < f.layer_edges_m[layer + 1] and bottom > f.layer_edges_m[layer]:
                    assert f.free_to_m[d, layer] <= math.hypot(x, y) - margin + 1e-3


@pytest.mark.parametrize("scene", ["street", "trees", "alley"])
def test_no_free_range_passes_what_is_really_there(scene: str) -> None:
    """Truth against profile: at most what the share of stray cells allows is nearer than the free range."""
    info = camera_info(320, 240, ke_per_m=0.0015)
    r = render(scene, info, sensor=TYPICAL, seed=4, pitch_rad=0.1, roll_rad=-0.2)
    model = extract(r.depth_mm, info, r.R_level_optical)
    check_no_free_range_passes_a_plane(model)
    points = r.truth.points_level_cam_m[r.truth.obstacle()]
    x, y, z = points.T
    f = model.free
    d = np.searchsorted(f.azimuth_edges_rad, np.arctan2(y, x), side="right") - 1
    layer = np.searchsorted(f.layer_edges_m, z, side="right") - 1
    inside = (d >= 0) & (d < f.free_to_m.shape[0]) & (layer >= 0) & (layer < f.free_to_m.shape[1])
    d, layer, reach = d[inside], layer[inside], np.hypot(x, y)[inside]
    inside_free = (f.free_from_m[d, layer] < reach) & (reach < f.free_to_m[d, layer] - 0.3)
    assert np.mean(inside_free) < 0.002


def test_state_is_handed_on_and_a_blind_frame_keeps_it() -> None:
    r = render("street", VIEW, sensor=TYPICAL, seed=1)
    ex = Extractor(Params())
    _, state = ex.extract(r.depth_mm, VIEW, r.R_level_optical)
    assert state.ground_height_m == pytest.approx(2.0, abs=0.1)
    assert math.isfinite(state.ke_per_m)
    _, after = ex.extract(np.zeros_like(r.depth_mm), VIEW, r.R_level_optical, state)
    assert after == state
    assert ex.extract(r.depth_mm, VIEW, r.R_level_optical, ExtractorState())[1] == state


def test_intrinsics_wider_than_high_or_off_centre_are_taken() -> None:
    info = CameraInfo("odd", Intrinsics(200, 150, 160.0, 150.0, 130.3, 60.8), ke_per_m=0.0015)
    model = extract(flat_wall(info, 6.0), info)
    a = model.planes[np.argmax(model.support_px)].astype(float)
    assert a[[0, 2]] == pytest.approx([6.0, 6.0], abs=0.05)
    assert a[1] == pytest.approx(6.0 * (-0.5 - 130.3) / 160.0, abs=0.06)
    assert a[3] == pytest.approx(6.0 * (199.5 - 130.3) / 160.0, abs=0.06)
    assert a[4] == pytest.approx(6.0 * (-0.5 - 60.8) / 150.0, abs=0.06)
    assert a[5] == pytest.approx(6.0 * (149.5 - 60.8) / 150.0, abs=0.06)


@pytest.mark.nojit
def test_an_image_of_pure_noise_is_blind_in_no_time() -> None:
    depth = np.random.default_rng(8).integers(300, 20000, (60, 80)).astype(np.uint16)
    info = CameraInfo("noise", Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5))
    model = extract(depth, info)
    assert model.stats.flying_px > 0.05 * depth.size
    assert says_nothing(model, InvalidCause.NO_MEASUREMENT)


@pytest.mark.parametrize("pixels", [2, 3, 4])
@pytest.mark.parametrize("pitch", [0.0, -0.4])
def test_noise_in_blocks_is_invalid_and_changes_no_estimate(pixels: int, pitch: float) -> None:
    """No pixel of a block flies by itself; but no scene falls into so many pieces."""
    rng = np.random.default_rng(pixels)
    coarse = rng.integers(500, 15000, (240 // pixels, -(-320 // pixels)))
    depth = np.kron(coarse, np.ones((pixels, pixels), int))[:240, :320].astype(np.uint16)
    before = ExtractorState(2.0, 0.002)
    model, state = Extractor(Params()).extract(depth, VIEW, level(pitch), before)
    assert model.stats.flying_px == 0
    assert says_nothing(model, InvalidCause.NO_MEASUREMENT)
    assert model.stats.dropped_strips > 24 * 320
    assert state == before
    loud = extract(depth, VIEW, level(pitch), max_strips_per_column=1024.0)
    assert loud.valid  # only this check refuses it


def test_leaves_all_over_the_picture_are_no_noise() -> None:
    """Leaves of 6 px, each at a depth of its own within two metres of a hedge that fills the view."""
    rng = np.random.default_rng(4)
    hedge = rng.uniform(4.0, 6.0, (40, 54))
    depth = noisy((1000.0 * np.kron(hedge, np.ones((6, 6))))[:240, :320].astype(np.uint16), 0.0015, 4)
    model = extract(depth, VIEW)
    assert model.valid
    assert len(model.planes) > 0


@pytest.mark.parametrize("name", ["a", "t0", "bottom_m", "front_m"])
def test_a_frame_with_a_plane_that_is_not_finite_is_invalid_and_changes_no_state(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def spoilt(*args: Any) -> int:
        count = shape_planes(*args)
        args[-1][name][count - 1] = np.nan
        return count

    ex, state = Extractor(Params()), ExtractorState(ground_height_m=1.5, ke_per_m=0.003)
    assert ex.extract(flat_wall(VIEW, 6.0), VIEW, level(), state)[0].valid
    monkeypatch.setattr(plane_shaping, "shape_planes", spoilt)
    model, after = ex.extract(flat_wall(VIEW, 6.0), VIEW, level(), state)
    assert says_nothing(model, InvalidCause.NON_FINITE)
    assert after == state
    monkeypatch.undo()
    assert ex.extract(flat_wall(VIEW, 6.0), VIEW, level(), after)[0].valid

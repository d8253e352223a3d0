"""Pixels against their definition."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.params import Params
from core.stages.classify import (
    classify,
    clear_range_m,
    depth_to_mm,
    pixel_limits,
)
from core.types import FAR_MM, SATURATED_MM

from . import naive
from .views import INFO

P = Params()


def run(depth: np.ndarray, ke: float, relative: float, absolute: float) -> tuple[np.ndarray, tuple[int, int, int]]:
    out = np.full(depth.shape, 7, np.uint16)
    limits = pixel_limits(INFO, ke, P)._replace(relative=np.float32(relative), absolute=np.float32(absolute))
    counts = classify(depth, limits, out)
    return out, counts


@pytest.mark.nojit
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([100, 3000, 65535]))
def test_classify_against_its_definition(seed: int, spread: int) -> None:
    rng = np.random.default_rng(seed)
    depth = (rng.integers(0, 65536 - spread) + rng.integers(0, spread + 1, (12, 17))).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.1] = rng.choice([0, 1, 299, 300, FAR_MM, SATURATED_MM])
    ke, relative, absolute = 0.004, 0.08, 0.02
    out, counts = run(depth, ke, relative, absolute)
    raw = naive.inverse_image(depth, INFO.min_range_m, INFO.max_range_m, ke)
    flying = np.zeros(depth.shape, bool)
    for v, u in zip(*np.nonzero(raw > 0), strict=True):
        step = absolute + relative * raw[v, u]
        flying[v, u] = naive.is_flying(raw, v, u, step) and not naive.is_slanted(raw, v, u, step)
    np.testing.assert_array_equal(out, np.where(flying | (raw == 0), 0, np.where(raw < 0, FAR_MM, depth)))
    assert counts == (np.sum(raw > 0), np.sum(raw < 0), np.sum(flying))


@pytest.mark.nojit
def test_a_flying_pixel_goes_and_a_thin_object_stays() -> None:
    depth = np.full((30, 40), 8000, np.uint16)
    depth[:, :20] = 3000
    depth[10, 20] = 5000  # between both sides of the edge
    depth[:, 30] = 4000  # a pole one pixel wide, in front of both its sides
    out, (_, _, flying) = run(depth, 0.0015, 0.08, 5 * 0.0015)
    assert flying == 1
    assert out[10, 20] == 0
    assert (out[:, 30] == 4000).all()


@pytest.mark.nojit
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("order", [1, -1])
def test_a_surface_seen_edge_on_stays(turned: bool, order: int) -> None:
    """Its 1/Z changes by the same amount from pixel to pixel, here by 10 to 30 %, between a near and a far surface."""
    side = 1000.0 / np.linspace(0.1, 0.3, 9)
    line = np.concatenate([np.full(11, 15000.0), side, np.full(20, 3300.0)])
    depth = np.tile(np.rint(line).astype(np.uint16), (30, 1))[:, ::order]
    depth = np.ascontiguousarray(depth.T if turned else depth)
    out, (_, _, flying) = run(depth, 0.0015, 0.08, 5 * 0.0015)
    assert flying == 0
    assert (out == depth).all()


@pytest.mark.nojit
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("inverse", "stays"),
    [((0.1, 0.2, 0.3, 0.9, 0.95), (1, 0, 1, 1, 1)), ((0.6, 0.2, 0.08, 0.08, 0.08), (1, 0, 1, 1, 1))],
    ids=["the surface ends at the border", "a surface at 1 m would continue beyond it"],
)
def test_the_border_of_the_image_is_unknown(
    inverse: tuple[float, ...], stays: tuple[int, ...], turned: bool, order: int
) -> None:
    """1/Z of one line, 1/m. Its outermost pixel counts as every other one, and there is nothing beyond it."""
    line, kept = np.rint(1000.0 / np.array(inverse)).astype(np.uint16), np.array(stays, bool)
    depth = np.tile(line, (3, 1))[:, ::order]
    want = np.tile(np.where(kept, line, 0), (3, 1))[:, ::order]
    out, _ = run(np.ascontiguousarray(depth.T if turned else depth), 0.0015, 0.08, 0.02)
    np.testing.assert_array_equal(out.T if turned else out, want)


@pytest.mark.nojit
def test_two_pixels_are_no_surface() -> None:
    """Of a flying pixel beside another one, whose distances have nothing to do with each other, nothing is kept."""
    depth = np.full((30, 40), 8000, np.uint16)
    depth[:, :20] = 2000
    depth[5:25, 20], depth[5:25, 21] = 2700, 5600
    out, (_, _, flying) = run(depth, 0.0015, 0.08, 5 * 0.0015)
    assert flying == 40
    assert (out[5:25, 20:22] == 0).all()


@pytest.mark.nojit
def test_millimetres_are_taken_as_they_are_and_metres_rounded() -> None:
    buffer = np.empty((30, 40), np.uint16)
    mm = np.random.default_rng(1).integers(1, 65533, (30, 40)).astype(np.uint16)
    assert np.shares_memory(depth_to_mm(mm, buffer), mm)
    assert depth_to_mm((mm / 1000.0).astype(np.float32), buffer).tolist() == mm.tolist()
    assert (depth_to_mm(np.full((30, 40), 1.2345678, np.float32), buffer) == 1235).all()


@pytest.mark.nojit
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_one_kind_of_array_comes_out_of_any_that_goes_in(dtype: type) -> None:
    """Parts, mirrored and read-only images: the kernels are compiled for one kind, and no image is written to."""
    buffer = np.empty((30, 40), np.uint16)
    large = np.random.default_rng(1).integers(1, 60, (64, 90)).astype(dtype)
    fixed = large[:30, :40].copy()
    fixed.flags.writeable = False
    for image in (large[:30, :40], large[::-2, ::-2][:30, :40], np.asfortranarray(large[:30, :40]), fixed):
        got = depth_to_mm(image, buffer)
        assert (got.dtype, got.shape, got.flags.c_contiguous, got.flags.writeable) == (np.uint16, (30, 40), True, False)
        np.testing.assert_array_equal(got, image * (1000 if dtype is np.float32 else 1))


@pytest.mark.parametrize("dtype", [np.int16, np.uint32, np.float64])
def test_other_kinds_of_arrays_are_refused(dtype: type) -> None:
    """A cast would take a depth of 70 m for one of 4.5 m."""
    with pytest.raises(ValueError, match=f"{np.dtype(dtype)}: expected uint16 millimetres or float32 metres"):
        depth_to_mm(np.ones((30, 40), dtype), np.ones((30, 40), np.uint16))


@pytest.mark.nojit
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 0.0, 0.0004, 70.0, 1e30])
def test_metres_that_measure_nothing_are_unknown(value: float) -> None:
    assert (depth_to_mm(np.full((30, 40), value, np.float32), np.ones((30, 40), np.uint16)) == 0).all()


@pytest.mark.nojit
@given(st.integers(0, 65535), st.sampled_from([1e-5, 0.0015, 0.01, 0.05]), st.sampled_from([2.0, 20.0, 65.0]))
def test_a_pixel_of_its_own_against_the_definition(mm: int, ke: float, max_m: float) -> None:
    info = replace(INFO, max_range_m=max_m)
    out = np.empty((1, 1), np.uint16)
    counts = classify(np.full((1, 1), mm, np.uint16), pixel_limits(info, ke, P), out)
    kind = naive.pixel_kind(mm, info.min_range_m, max_m, ke)
    assert out[0, 0] == {"measured": mm, "far": FAR_MM, "unknown": 0}[kind]
    assert counts == (kind == "measured", kind == "far", 0)


@pytest.mark.nojit
def test_the_cut_is_three_sigma_of_its_own_range_short_of_the_maximum() -> None:
    """At the cut Zc a pixel three sigma of disparity farther is at the maximum: 1/Zc - 3 ke = 1/max."""
    for ke in (1e-5, 0.0015, 0.05):
        assert 1.0 / clear_range_m(INFO, ke, P) - 3.0 * ke == pytest.approx(1.0 / INFO.max_range_m)

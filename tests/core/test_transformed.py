"""A model turned about the vertical and shifted, against the same with plain numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.stages.prism_table import PrismTable, prism_table
from core.transformed import turned
from core.types import FrameModel, FrameStats, FreeEnd, FreeProfile, Ground, InvalidCause

from . import naive
from .tables import some_prisms

SHIFT_M = (1200.5, -340.25, -55.0)


def model(planes: np.ndarray, prisms: PrismTable) -> FrameModel:
    """Of these planes and prisms, with free ranges in three directions and two layers."""
    rng = np.random.default_rng(5)
    n = len(planes)
    free_m = rng.uniform(0.0, 20.0, (2, 3, 2)).astype(np.float32)
    return FrameModel(
        valid=True, cause=InvalidCause.NONE, planes=planes, support_px=np.arange(n, dtype=np.int32),
        margin_m=rng.uniform(0.0, 1.0, n).astype(np.float32), flags=np.arange(n, dtype=np.uint8),
        cluster=np.arange(n, dtype=np.int32), prisms=prisms,
        free=FreeProfile(
            azimuth_edges_rad=np.array([-0.3, -0.1, 0.1, 0.4], np.float32), layer_edges_m=np.array([-1.1, 0.3, 0.9], np.float32),
            free_from_m=free_m[0], free_to_m=free_m[1], end=np.full((3, 2), FreeEnd.OBSTACLE, np.uint8),
        ),
        ground=Ground(seen=True, height_m=2.0, slope_x=0.01, slope_y=-0.02), stats=FrameStats(planes=n), ke_per_m=0.005,
    )  # fmt: skip


def some_planes(n: int) -> np.ndarray:
    planes = np.random.default_rng(3).uniform(-20.0, 20.0, (n, 6)).astype(np.float32)
    planes[:, 5] = planes[:, 4] + 1.0
    return planes


@pytest.mark.nojit
@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.9])
def test_it_is_that_of_plain_numbers_bit_for_bit(yaw_rad: float) -> None:
    before = model(some_planes(30), prism_table(some_prisms(12)))
    after = turned(before, yaw_rad, SHIFT_M)
    turn = math.cos(yaw_rad), math.sin(yaw_rad)
    np.testing.assert_array_equal(after.planes[:, 0:2], naive.turned(before.planes[:, 0:2], *turn, SHIFT_M))
    np.testing.assert_array_equal(after.planes[:, 2:4], naive.turned(before.planes[:, 2:4], *turn, SHIFT_M))
    prisms, moved = prism_table(before.prisms), prism_table(after.prisms)
    np.testing.assert_array_equal(moved.vertices_m, naive.turned(prisms.vertices_m, *turn, SHIFT_M))
    lower = (prisms.heights_m.astype(np.float64) + SHIFT_M[2]).astype(np.float32)
    np.testing.assert_array_equal(moved.heights_m, lower)
    for name in ("cluster", "closed", "margin_m", "vertex_begin", "edge_begin", "plane"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(prisms, name))
    free = before.free
    edges, layers = (
        free.azimuth_edges_rad.astype(np.float64) + yaw_rad,
        free.layer_edges_m.astype(np.float64) + SHIFT_M[2],
    )
    np.testing.assert_array_equal(after.free.azimuth_edges_rad, edges.astype(np.float32))
    np.testing.assert_array_equal(after.free.layer_edges_m, layers.astype(np.float32))
    for name in ("free_from_m", "free_to_m", "end"):
        np.testing.assert_array_equal(getattr(after.free, name), getattr(free, name))
    for name in ("support_px", "margin_m", "flags", "cluster"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert (after.valid, after.cause, after.stats, after.ke_per_m) == (True, InvalidCause.NONE, before.stats, 0.005)
    arrays = (
        after.planes,
        after.margin_m,
        after.free.azimuth_edges_rad,
        after.free.layer_edges_m,
        moved.heights_m,
        moved.vertices_m,
    )
    assert not any(array.flags.writeable for array in arrays)
    assert after.ground.slope_x == turn[0] * 0.01 + turn[1] * 0.02
    assert (after.ground.seen, after.ground.height_m) == (True, 2.0)


@pytest.mark.nojit
def test_heights_that_rounding_would_make_flat_stay_the_least_representable() -> None:
    flat = np.array([[1.0, 0.0, 1.0, 1.0, -0.001, 0.0], [1.0, 0.0, 1.0, 1.0, -3.0, 0.0]], np.float32)
    moved = turned(model(flat, prism_table(())), 0.0, (0.0, 0.0, -50_000.0)).planes
    assert moved[0, 5] == np.nextafter(np.float32(-50_000.0), np.float32(np.inf)) > moved[0, 4]
    assert (moved[1, 4], moved[1, 5]) == (-50_003.0, -50_000.0)


@pytest.mark.nojit
def test_none_stay_none() -> None:
    none = turned(model(some_planes(0), prism_table(())), 1.0, SHIFT_M)
    assert none.valid
    assert none.planes.shape == (0, 6)
    assert isinstance(none.prisms, PrismTable)
    assert len(none.prisms) == 0


@pytest.mark.nojit
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "where", ["planes", "margin_m", "azimuth_edges_rad", "layer_edges_m", "free_from_m", "free_to_m"]
)
def test_a_model_with_a_number_that_is_not_finite_is_invalid(where: str, value: float) -> None:
    before = model(some_planes(3), prism_table(some_prisms(2)))
    holder = before if hasattr(before, where) else before.free
    spoilt = getattr(holder, where).copy()
    spoilt.flat[1] = value
    object.__setattr__(holder, where, spoilt)
    after = turned(before, 0.4, SHIFT_M)
    assert (after.valid, after.cause) == (False, InvalidCause.NON_FINITE)
    assert len(after.planes) == len(after.prisms) == 0
    assert not after.free.free_to_m.any()

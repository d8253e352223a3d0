"""Planes and prisms turned about the vertical and shifted, against the same with plain numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.prism_table import PrismTable, prism_table
from core.turned import turned_planes, turned_prisms

from . import naive
from .tables import some_prisms

SHIFT_M = (1200.5, -340.25, -55.0)


def turn(yaw_rad: float) -> tuple[float, float]:
    return math.cos(yaw_rad), math.sin(yaw_rad)


@pytest.mark.nojit
@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.9])
def test_they_are_those_of_plain_numbers_bit_for_bit(yaw_rad: float) -> None:
    rng = np.random.default_rng(3)
    planes = rng.uniform(-20.0, 20.0, (30, 6)).astype(np.float32)
    planes.flags.writeable = False
    moved = turned_planes(planes, *turn(yaw_rad), SHIFT_M)
    np.testing.assert_array_equal(moved[:, 0:2], naive.turned(planes[:, 0:2], *turn(yaw_rad), SHIFT_M))
    np.testing.assert_array_equal(moved[:, 2:4], naive.turned(planes[:, 2:4], *turn(yaw_rad), SHIFT_M))
    table = prism_table(some_prisms(12))
    prisms = turned_prisms(table, *turn(yaw_rad), SHIFT_M)
    np.testing.assert_array_equal(prisms.vertices_m, naive.turned(table.vertices_m, *turn(yaw_rad), SHIFT_M))
    np.testing.assert_array_equal(
        prisms.heights_m, (table.heights_m.astype(np.float64) + SHIFT_M[2]).astype(np.float32)
    )
    for name in ("cluster", "closed", "margin_m", "vertex_begin", "edge_begin", "plane"):
        np.testing.assert_array_equal(getattr(prisms, name), getattr(table, name))


@pytest.mark.nojit
def test_what_rounding_would_make_flat_stays_the_least_that_can_be_told() -> None:
    flat = np.array([[1.0, 0.0, 1.0, 1.0, -0.001, 0.0], [1.0, 0.0, 1.0, 1.0, -3.0, 0.0]], np.float32)
    flat.flags.writeable = False
    moved = turned_planes(flat, 1.0, 0.0, (0.0, 0.0, -50_000.0))
    assert moved[0, 5] == np.nextafter(np.float32(-50_000.0), np.float32(np.inf)) > moved[0, 4]
    assert (moved[1, 4], moved[1, 5]) == (-50_003.0, -50_000.0)


@pytest.mark.nojit
def test_none_stay_none() -> None:
    assert turned_planes(np.zeros((0, 6), np.float32), 1.0, 0.0, SHIFT_M).shape == (0, 6)
    none = turned_prisms(prism_table(()), 1.0, 0.0, SHIFT_M)
    assert isinstance(none, PrismTable)
    assert len(none) == 0

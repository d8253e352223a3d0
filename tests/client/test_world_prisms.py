"""Profiles that close are solid: oriented, simple, layered; what crosses itself or runs the other way stays open."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.types import Prism
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.corners import is_simple
from osape_client.world.prisms import inside, way_inside, world_prisms
from osape_client.world.space import WorldSpace
from tests.core.worlds import NS, house, seen

shapely = pytest.importorskip("shapely")
SEED = st.integers(0, 2**32 - 1)


def ring(corners: list[tuple[float, float]], heights: list[tuple[float, float]]) -> np.ndarray:
    n = len(corners)
    return np.array([[*corners[k], *corners[(k + 1) % n], *heights[k]] for k in range(n)], np.float32)


def margins(planes: np.ndarray) -> np.ndarray:
    return np.full(len(planes), 0.1, np.float32)


BOX = [(-3.0, -3.0), (-3.0, 3.0), (3.0, 3.0), (3.0, -3.0)]


def test_a_ring_of_walls_is_one_solid() -> None:
    planes = ring(BOX, [(-4.0, 0.0)] * 4)
    (prism,) = world_prisms(planes[[2, 0, 3, 1]], margins(planes))
    assert prism.closed
    assert (prism.top_m, prism.bottom_m) == (-4.0, 0.0)
    polygon = shapely.Polygon(prism.vertices_m)
    assert polygon.is_valid
    assert polygon.area == pytest.approx(36.0)
    for k, plane in enumerate(prism.plane):
        row = planes[[2, 0, 3, 1]][plane]
        assert np.array_equal(row[:2], prism.vertices_m[k])
        assert np.array_equal(row[2:4], prism.vertices_m[(k + 1) % 4])


def test_other_heights_are_other_layers() -> None:
    planes = ring(BOX, [(-4.0, 0.0), (-4.1, 0.0), (-2.0, 0.0), (-4.0, 0.0)])
    prisms = world_prisms(planes, margins(planes))
    assert sorted((round(p.top_m, 2), round(p.bottom_m, 2), p.closed, len(p.plane)) for p in prisms) == [
        (-4.1, -2.0, False, 3),
        (-2.0, 0.0, True, 4),
    ]


def test_a_courtyard_and_a_knot_stay_open() -> None:
    yard = ring(BOX[::-1], [(-4.0, 0.0)] * 4)
    assert [p.closed for p in world_prisms(yard, margins(yard))] == [False]
    knot = ring([BOX[0], BOX[1], BOX[3], BOX[2]], [(-4.0, 0.0)] * 4)
    assert [p.closed for p in world_prisms(knot, margins(knot))] == [False]
    sheet = ring(BOX, [(-4.0, 0.0)] * 4)[:3]
    (prism,) = world_prisms(sheet, margins(sheet))
    assert not prism.closed
    assert len(prism.vertices_m) == 4


@settings(max_examples=40)
@given(SEED)
def test_simple_agrees_with_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v = rng.uniform(-5, 5, (int(rng.integers(3, 8)), 2))
    assert is_simple(v) == shapely.LinearRing(v).is_simple


@settings(max_examples=20)
@given(SEED)
def test_inside_agrees_with_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 12))
    turn = -np.sort(rng.uniform(0, math.tau, n))
    reach = rng.uniform(2, 5, n)
    v = np.column_stack([reach * np.cos(turn), reach * np.sin(turn)]).astype(np.float32)
    solid = Prism(
        cluster=0, top_m=-3.0, bottom_m=1.0, closed=True, margin_m=0.0, vertices_m=v, plane=np.zeros(n, np.int32)
    )
    polygon = shapely.Polygon(v)
    at = rng.uniform(-6, 6, (200, 3))
    for point, found in zip(at, inside(solid, at, 0.5), strict=True):
        expected = shapely.contains_xy(polygon, *point[:2]) and -3.5 <= point[2] <= 1.5
        assert found == expected
    to = at + rng.normal(size=at.shape) * 3
    for a, b, found in zip(at, to, way_inside(solid, at, to, 0.3), strict=True):
        s = np.linspace(0, 1, 201)[:, None]
        along = a + s * (b - a)
        z = along[:, 2]
        within = shapely.contains_xy(polygon, along[:, :2]) & (z >= -3.3) & (z <= 1.3)
        if within[0] or within[-1]:
            assert found
        elif not within.any() and found:
            grown = polygon.buffer(0.1)  # it touches between two of the points
            assert (shapely.contains_xy(grown, along[:, :2]) & (z >= -3.5) & (z <= 1.5)).any()


def test_inside_of_a_house_flown_around_is_occupied_its_roof_too() -> None:
    world, rng = World(), np.random.default_rng(2)
    for k in range(120):
        a = math.tau * k / 120
        at = (10 * math.cos(a), 10 * math.sin(a))
        if 30 <= k < 40:
            continue
        world.add(seen(house(0.0, 0.0), at, a + math.pi, k * NS // 10, noise=rng))
    space = WorldSpace(world.picture(12 * NS))
    assert [p.closed for p in space.prisms] == [True]
    points = np.array([[0, 0, 0], [2.5, 2.5, -3.9], [0, 0, -4.2], [0, 0, -5.0]])
    assert space.points(points, 0.3).tolist() == [2, 2, 2, 0]
    down = space.segments([[0, 0, -6.0]], [[0, 0, -3.0]])
    assert down.tolist() == [Occupancy.OCCUPIED]
    # what is known of one side only is a sheet: behind it nothing is known
    world = World()
    for k in range(10):
        world.add(seen(house(0.0, 0.0), (10.0, 0.2 * k), math.pi, k * NS // 10))
    space = WorldSpace(world.picture(NS))
    assert [p.closed for p in space.prisms] == [False]
    assert space.points([[0, 0, 0]], 0.3).tolist() == [Occupancy.UNKNOWN]

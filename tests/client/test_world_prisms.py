"""Profiles that close are solid: oriented, simple, layered; what crosses itself or runs the other way stays open."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.types import Prism
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.corners import is_simple
from osape_client.world.prisms import inside, way_inside, world_prisms
from osape_client.world.space import WorldSpace
from tests.core.worlds import NS, house, seen
from tests.nightly import examples

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


@examples(1.5)
@given(SEED)
def test_simple_agrees_with_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    v = rng.uniform(-5, 5, (int(rng.integers(3, 8)), 2))
    assert is_simple(v) == shapely.LinearRing(v).is_simple


@examples(0.8)
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
        if within.any():
            assert found
        elif found:
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


@examples(0.4)
@given(SEED)
def test_a_way_through_a_solid_between_two_planes_is_occupied(seed: int) -> None:
    """Planes that end short of a corner leave a gap there, and the solid between them has none."""
    rng = np.random.default_rng(seed)
    planes = house(0.0, 0.0, side=float(rng.uniform(1.5, 5.0)))
    along = (planes[:, 2:4] - planes[:, 0:2]) / np.linalg.norm(planes[:, 2:4] - planes[:, 0:2], axis=1)[:, None]
    short = rng.uniform(0.0, 0.45, (4, 2))
    planes[:, 0:2] += short[:, :1] * along
    planes[:, 2:4] -= short[:, 1:] * along
    space = WorldSpace(
        replace(
            World().picture(0),
            slots=np.arange(4, dtype=np.int32),
            planes=planes.astype(np.float32),
            margin_m=np.full(4, 0.02, np.float32),
            flags=np.zeros(4, np.uint8),
            hits=np.full(4, 20, np.int32),
            seen_ns=np.zeros(4, np.int64),
        )
    )
    if not any(prism.closed for prism in space.prisms):
        return
    a, b = (np.column_stack([rng.uniform(-6, 6, (300, 2)), rng.uniform(-5.0, 5.0, 300)]) for _ in range(2))
    corner = planes[0, 0:2] - short[0, 0] * along[0]  # and ways through two corners that face each other
    a[:20], b[:20] = [*(3.0 * corner), 0.0], [*(-3.0 * corner), 0.0]
    b[:20, :2] += rng.uniform(-0.2, 0.2, (20, 2))
    for radius in (0.0, 0.2):
        points = a[:, None] + np.linspace(0.0, 1.0, 100)[:, None] * (b - a)[:, None]
        touches = (space.points(points.reshape(-1, 3), radius) == Occupancy.OCCUPIED).reshape(len(a), 100).any(axis=1)
        missed = touches & (space.segments(a, b, radius) != Occupancy.OCCUPIED)
        assert not missed.any(), (a[missed], b[missed], radius)

"""The world asked, against asking every plane and every cell one by one, and against shapely."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.world.snapshot import WorldSnapshot
from osape_client.query.space import Occupancy
from osape_client.world.space import CELL_M, WorldSpace
from tests.nightly import examples

shapely = pytest.importorskip("shapely")
SEED = st.integers(0, 2**32 - 1)


def picture(rng: np.random.Generator, planes: int = 12, free_share: float = 0.97) -> WorldSnapshot:
    """Planes about the origin, and eight blocks about it with a share of their cells free."""
    xy = rng.uniform(-6.0, 6.0, (planes, 4))
    top = rng.uniform(-4.0, 2.0, planes)
    rows = np.column_stack([xy, top, top + rng.uniform(0.1, 4.0, planes)]).astype(np.float32)
    blocks = np.array(list(itertools.product((-1, 0), (-1, 0), (-1, 0))), np.int32)
    bits = rng.random((8, 256, 64)) < free_share
    masks = np.packbits(bits, axis=-1, bitorder="little").view(np.uint64)[..., 0]
    return WorldSnapshot(
        section=1,
        slots=np.arange(planes, dtype=np.int32),
        planes=rows,
        margin_m=rng.uniform(0, 0.3, planes).astype(np.float32),
        flags=np.zeros(planes, np.uint8),
        hits=np.ones(planes, np.int32),
        seen_ns=np.zeros(planes, np.int64),
        blocks=blocks,
        masks=masks,
    )


def cell_free(p: WorldSnapshot, index: tuple[int, int, int]) -> bool:
    """One cell, by looking for its block."""
    for block, masks in zip(p.blocks.tolist(), p.masks, strict=True):
        if block == [index[0] >> 4, index[1] >> 4, index[2] >> 6]:
            return bool(int(masks[(index[0] & 15) * 16 + (index[1] & 15)]) >> (index[2] & 63) & 1)
    return False


def ball_free(p: WorldSnapshot, at: np.ndarray, radius: float) -> bool:
    """Whether every cell that the box around a ball reaches into is free."""
    spans = [range(math.floor((c - radius) / CELL_M), math.floor((c + radius) / CELL_M) + 1) for c in at]
    return all(cell_free(p, index) for index in itertools.product(*spans))


def to_plane(r: np.ndarray, at: np.ndarray) -> float:
    """From a point to a rectangle."""
    e = r[2:4] - r[0:2]
    share = min(1.0, max(0.0, float((at[:2] - r[0:2]) @ e / (e @ e))))
    flat = r[0:2] + share * e - at[:2]
    return math.hypot(flat[0], flat[1], max(0.0, r[4] - at[2], at[2] - r[5]))


@examples(0.6)
@given(SEED, st.sampled_from([0.0, 0.2, 0.5, 0.8]))
def test_points_against_every_plane_and_every_cell(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    p = picture(rng)
    at = rng.uniform(-8.5, 8.5, (40, 3))
    answers = WorldSpace(p).points(at, radius)
    for point, answer in zip(at, answers, strict=True):
        gap = min(to_plane(r.astype(float), point) - m for r, m in zip(p.planes, p.margin_m.astype(float), strict=True))
        assert (answer == Occupancy.OCCUPIED) == (gap <= radius)
        if answer != Occupancy.OCCUPIED:
            assert (answer == Occupancy.FREE) == ball_free(p, point, radius)


@examples(0.6)
@given(SEED)
def test_a_way_that_is_free_has_no_point_that_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p = picture(rng, free_share=0.999)
    space = WorldSpace(p)
    a = rng.uniform(-7.5, 7.5, (60, 3))
    b = a + rng.normal(size=(60, 3))
    answers = space.segments(a, b, 0.2)
    assert Occupancy.FREE in answers
    for k, answer in enumerate(answers):
        along = a[k] + np.linspace(0, 1, 40)[:, None] * (b[k] - a[k])
        points = space.points(along, 0.2)
        if answer == Occupancy.FREE:
            assert (points == Occupancy.FREE).all()
        elif answer == Occupancy.UNKNOWN:
            assert Occupancy.OCCUPIED not in points


def test_ways_that_touch_planes_against_shapely() -> None:
    """Planes and ways of one height: what touches is a matter of the plan alone."""
    rng = np.random.default_rng(11)
    p = picture(rng, planes=40)
    planes = p.planes.copy()
    planes[:, 4], planes[:, 5] = -5.0, 5.0
    p = WorldSnapshot(**{n: getattr(p, n) for n in WorldSnapshot.__slots__} | {"planes": planes})
    a = np.column_stack([rng.uniform(-7, 7, (400, 2)), np.zeros(400)])
    b = a + np.column_stack([rng.normal(size=(400, 2)), np.zeros(400)])
    answers = WorldSpace(p).segments(a, b, 0.3)
    lines = [shapely.LineString([(r[0], r[1]), (r[2], r[3])]) for r in planes.astype(float)]
    for k in range(400):
        way = shapely.LineString([a[k, :2], b[k, :2]])
        near = min(way.distance(line) - m for line, m in zip(lines, p.margin_m.astype(float), strict=True))
        if abs(near - 0.3) > 1e-6:
            assert (answers[k] == Occupancy.OCCUPIED) == (near < 0.3)


def test_queries_all_over_are_answered_as_one_by_one() -> None:
    """Grouped, in several layers of blocks and in windows too large to be asked at once."""
    rng = np.random.default_rng(3)
    p = picture(rng)
    far = np.array([[40000, -30000, 0], [40000, -30000, 1]], np.int32)
    masks = np.full((2, 256), 0xFFFFFFFFFFFFFFFF, np.uint64)
    p = WorldSnapshot(
        **{n: getattr(p, n) for n in WorldSnapshot.__slots__}
        | {"blocks": np.concatenate([p.blocks, far]), "masks": np.concatenate([p.masks, masks])}
    )
    there = np.array([40000 * 8 + 4.0, -30000 * 8 + 4.0, 32.0])
    at = np.concatenate(
        [rng.uniform(-8, 8, (300, 3)), there + rng.uniform(-2, 2, (300, 3)), there[None] + np.array([0, 0, 40.0])]
    )
    space = WorldSpace(p)
    answers = space.points(at, 0.3)
    assert answers.tolist() == [int(space.points(one, 0.3)[0]) for one in at]
    assert (answers[300:600] == Occupancy.FREE).all()
    assert answers[600] == Occupancy.UNKNOWN


def test_numbers_that_are_none_are_occupied_and_shapes_are_checked() -> None:
    space = WorldSpace(picture(np.random.default_rng(0)))
    for bad in (math.nan, math.inf):
        assert space.points([[bad, 0, 0]]).tolist() == [Occupancy.OCCUPIED]
    assert WorldSpace(WorldSnapshot.empty()).points([[math.nan, 0, 0], [0, 0, 0]]).tolist() == [
        Occupancy.OCCUPIED,
        Occupancy.UNKNOWN,
    ]
    with pytest.raises(ValueError, match="2 starts and 1 ends"):
        space.segments(np.zeros((2, 3)), np.zeros((1, 3)))
    distance, towards, number = space.nearest([[0.0, 0.0, 0.0]])
    assert distance[0] >= 0.0
    assert np.linalg.norm(towards[0]) == pytest.approx(1.0) or distance[0] == 0.0
    assert 0 <= number[0] < 12


@pytest.mark.parametrize("radius", [-1.0, -1e-9, math.nan, math.inf])
def test_a_radius_that_is_none_is_refused(radius: float) -> None:
    space = WorldSpace(picture(np.random.default_rng(0)))
    with pytest.raises(ValueError, match="radius_m = "):
        space.points([[0, 0, 0]], radius)
    with pytest.raises(ValueError, match="radius_m = "):
        space.segments([[0, 0, 0]], [[1, 0, 0]], radius)


@pytest.mark.parametrize("far", [2e5, 1e9, 1e300])
def test_a_way_far_beyond_what_is_known_is_not_free(far: float) -> None:
    p = picture(np.random.default_rng(0), planes=1, free_share=1.0)
    answers = WorldSpace(p).segments(
        [[-20.0, 0, -20.0], [-far, 30.0, -20.0]], [[far, 0, -20.0], [far, 30.0, -20.0]], 0.2
    )
    assert Occupancy.FREE not in answers


@pytest.mark.parametrize("radius", [1e3, 1e12, 1e20, 1e300])
def test_a_ball_of_any_size_touches_the_ground_in_it(radius: float) -> None:
    """From 1e20 m on its cells were beyond the integers, and it touched nothing."""
    p = picture(np.random.default_rng(0), planes=0)
    ground = np.full((8, 256, 2), np.nan, np.float32)
    ground[:, 7] = 5.0, 0.1
    p = WorldSnapshot(**{n: getattr(p, n) for n in WorldSnapshot.__slots__} | {"ground": ground})
    assert WorldSpace(p).points([[0, 0, 0], [1e9, 0, -1e9]], radius)[0] == Occupancy.OCCUPIED
    assert WorldSpace(p).segments([[0, 0, 0]], [[1, 0, 0]], radius).tolist() == [Occupancy.OCCUPIED]


def test_a_ball_higher_than_any_view_takes_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where blocks lie far apart, the cells of a ball of 3 km took 1.6 GB."""
    p = picture(np.random.default_rng(0), planes=0)
    far = np.array([[-1250, -1250, -300], [1250, 1250, 300]], np.int32)
    masks = np.full((10, 256), 0xFFFFFFFFFFFFFFFF, np.uint64)
    p = WorldSnapshot(
        **{n: getattr(p, n) for n in WorldSnapshot.__slots__}
        | {"blocks": np.concatenate([p.blocks, far]), "masks": masks}
    )
    assert WorldSpace(p).points([[4, 4, 0]], 3.5).tolist() == [Occupancy.FREE]
    monkeypatch.setattr(WorldSpace, "_dense", None)
    assert WorldSpace(p).points([[4, 4, 0]], 3000.0).tolist() == [Occupancy.UNKNOWN]

"""Who follows whom around a corner: as by looking at all pairs; past each other, short of each other, with scraps beside."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from osape_client.world.corners import (
    END_M,
    FLAT,
    MEET_M,
    NONE,
    OVERLAP,
    PAST_M,
    PAST_SHARE,
    Around,
    _matched,
    _near,
    _sorted_cells,
    followers,
    in_solids,
)
from osape_client.world.prisms import world_prisms
from tests.core.worlds import house

shapely = pytest.importorskip("shapely")
SEED = st.integers(0, 2**32 - 1)


def naive_pair(p: np.ndarray, q: np.ndarray, looks: int) -> tuple[float, float, float, np.ndarray] | None:
    """(size class, how far past, gap, corner) of q following p; None: it does not."""
    both, height = min(p[5], q[5]) - max(p[4], q[4]), min(p[5] - p[4], q[5] - q[4])
    if both <= 0.0 or both < OVERLAP * height:
        return None
    lengths = math.dist(p[:2], p[2:4]), math.dist(q[:2], q[2:4])
    e, f = (p[2:4] - p[:2]) / lengths[0], (q[2:4] - q[:2]) / lengths[1]
    sine, gap = e[0] * f[1] - e[1] * f[0], math.dist(p[2:4], q[:2])
    size = math.floor(0.5 * math.log2(height * min(lengths) * looks))
    if abs(sine) < FLAT:
        if gap >= max(END_M, 0.5 * MEET_M + 1e-12):
            return None
        return size, -gap, gap, p[2:4] if gap < END_M else 0.5 * (p[2:4] + q[:2])
    x, y = np.linalg.solve(np.array([e, -f]).T, q[:2] - p[:2])
    past = lengths[0] - x, y
    limits = [min(PAST_M if sine < 0.0 else MEET_M, PAST_SHARE * n) for n in lengths]
    if gap >= END_M and (past[0] > limits[0] or past[1] > limits[1] or min(past) < -MEET_M):
        return None
    return size, past[0] + past[1], gap, p[2:4] if gap < END_M else p[:2] + x * e


def random_planes(rng: np.random.Generator, n: int) -> np.ndarray:
    xy = rng.uniform(-5, 5, (n, 2))
    turn, length = rng.uniform(0, math.tau, n), rng.uniform(0.3, 6.0, n)
    top = rng.uniform(-6, -2, n)
    ends = xy + np.column_stack([np.cos(turn), np.sin(turn)]) * length[:, None]
    return np.column_stack([xy, ends, top, top + rng.uniform(0.5, 6, n)])


@given(SEED)
def test_as_by_looking_at_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    planes = random_planes(rng, 24)
    hits = rng.integers(1, 50, 24).astype(np.int32)
    found = []
    for i, p in enumerate(planes):
        for k, q in enumerate(planes):
            pair = (
                naive_pair(p, q, int(min(hits[i], hits[k])))
                if i != k and math.dist(p[2:4], q[:2]) <= 2.0 * PAST_M
                else None
            )
            if pair is not None:
                found.append((-pair[0], -pair[1], pair[2], i, k, pair[3]))
    after, corner, taken = [NONE] * len(planes), np.zeros((len(planes), 2)), set()
    for *_, i, k, at in sorted(found, key=lambda c: c[:5]):
        if after[i] == NONE and k not in taken:
            after[i], corner[i] = k, at
            taken.add(k)
    # a corner within 1.5 m of both ends: they are within 3 m of each other, which is all that is looked at
    result = _matched(planes, hits, np.arange(len(planes)))
    assert result.after.tolist() == after
    assert np.allclose(result.corner, corner, atol=1e-6)


@given(SEED)
def test_none_that_is_near_is_overlooked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends, begins = rng.uniform(-20, 20, (60, 2)), rng.uniform(-20, 20, (60, 2))
    near = set(zip(*(a.tolist() for a in _near(ends, _sorted_cells(begins))), strict=True))
    for i in range(60):
        for k in range(60):
            if np.abs(ends[i] - begins[k]).max() <= 2.0 * PAST_M:
                assert (i, k) in near


def test_planes_without_number_in_one_place_take_little_memory() -> None:
    """The pairs of 6,000 planes within 6 m took more than 8 GB, of a planner that asked a world."""
    rng = np.random.default_rng(0)
    planes = random_planes(rng, 3000)
    planes[:, :2] = rng.uniform(-3, 3, (3000, 2))
    planes[:, 2:4] = planes[:, :2] + rng.normal(size=(3000, 2))
    tracemalloc.start()
    found = followers(planes)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.after.shape == (3000,)
    assert peak_bytes < 500e6


def tangents(radius: float, count: int, length: float, rng: np.random.Generator) -> np.ndarray:
    """What views from around make of something round: planes that touch it, each as long as it is wide."""
    turns = math.tau * (np.arange(count) + rng.uniform(-0.15, 0.15, count)) / count
    middle = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    along = 0.5 * length * np.column_stack([np.sin(turns), -np.cos(turns)])
    return np.column_stack([middle - along, middle + along, np.full(count, -3.0), np.zeros(count)])[
        rng.permutation(count)
    ]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [7, 9, 12])
def test_planes_that_touch_something_round_enclose_it(seed: int, count: int) -> None:
    planes = tangents(1.0, count, 2.1, np.random.default_rng(seed)).astype(np.float32)
    (prism,) = world_prisms(planes, np.full(count, 0.1, np.float32))
    assert prism.closed
    polygon, disc = shapely.Polygon(prism.vertices_m), shapely.Point(0, 0).buffer(1.0)
    assert polygon.buffer(0.01).contains(disc)
    assert polygon.area < 1.25 * disc.area


@pytest.mark.parametrize(("short", "closed"), [(0.4, True), (0.6, False)])
def test_walls_that_end_short_of_their_corner(short: float, closed: bool) -> None:
    walls = house(0.0, 0.0)
    along = (walls[:, 2:4] - walls[:, 0:2]) / 6.0
    walls[:, 0:2] += short * along
    walls[:, 2:4] -= short * along
    prisms = world_prisms(walls.astype(np.float32), np.full(4, 0.1, np.float32))
    assert any(p.closed for p in prisms) == closed
    if closed:
        assert shapely.Polygon(prisms[0].vertices_m).area == pytest.approx(36.0, abs=1e-4)


def test_walls_of_a_yard_that_run_on_behind_each_other_enclose_nothing() -> None:
    yard = house(0.0, 0.0)[:, [2, 3, 0, 1, 4, 5]]
    assert not any(p.closed for p in world_prisms(yard.astype(np.float32), np.full(4, 0.1, np.float32)))


def test_scraps_beside_a_corner_keep_nothing_from_closing() -> None:
    """Small planes across and along the walls, wherever they stand."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        n = 8
        corner = house(0.0, 0.0)[rng.integers(0, 4, n), 0:2]
        begin = corner + rng.normal(0.0, 0.4, (n, 2))
        scraps = np.column_stack([begin, begin + rng.normal(0.0, 0.3, (n, 2)), np.full(n, -3.0), np.full(n, -1.0)])
        planes = np.concatenate([house(0.0, 0.0), scraps]).astype(np.float32)
        closed = [p for p in world_prisms(planes, np.full(len(planes), 0.1, np.float32)) if p.closed]
        assert any(shapely.Polygon(p.vertices_m).area > 35.0 for p in closed)


def test_what_is_a_solid() -> None:
    """A ring around what it stands for; not one around free space, none that crosses itself, no end that leads into one."""
    square = np.array([[0.0, 2.0], [2.0, 2.0], [2.0, 0.0], [0.0, 0.0]])
    after = np.array([1, 2, 3, 0, 1, NONE], np.int32)
    corner = np.concatenate([square, [[5.0, 5.0], [0.0, 0.0]]])
    around = [True, True, True, True, False, False]
    ways = {
        name: in_solids(Around(after, c)).tolist()
        for name, c in (("one", corner), ("other", corner[[3, 2, 1, 0, 4, 5]]))
    }
    assert sorted(ways.values()) == sorted([around, [False] * 6])
    knot = corner[[0, 2, 1, 3, 4, 5]]
    assert not in_solids(Around(after, knot)).any()
    assert len(followers(np.zeros((0, 6))).after) == 0


def test_what_was_seen_often_closes_without_what_was_seen_once() -> None:
    """Large planes of single looks stand across the corners of a house, and take the walls' followers from each other."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        corner = house(0.0, 0.0)[:, 0:2]
        begin = corner + rng.normal(0.0, 0.5, (4, 2))
        across = np.column_stack([begin, begin + rng.normal(0.0, 2.0, (4, 2)), np.full(4, -4.0), np.full(4, 4.0)])
        planes = np.concatenate([house(0.0, 0.0), across]).astype(np.float32)
        hits = np.array([60, 70, 80, 90, 1, 2, 1, 3], np.int32)
        closed = [p for p in world_prisms(planes, np.full(8, 0.1, np.float32), hits) if p.closed]
        assert any(shapely.Polygon(p.vertices_m).area == pytest.approx(36.0, abs=0.01) for p in closed)

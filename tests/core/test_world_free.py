"""Free space remembered: never more than one frame saw free, forgotten in time, taken back where an obstacle stands."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.free_view import FreeView
from core.jit import kernel
from core.types import FreeProfile
from core.world.association import OBSERVATION
from core.world.free_grid import CELL_M, any_free, bits, empty_free, see_free, seen_blocks
from core.world.free_removal import stand_in
from core.world.plane_index import BOX
from osape_client.query.space import balls_free

from ..nightly import examples

pytestmark = pytest.mark.nojit
SEED = st.integers(0, 2**32 - 1)
NO_GROUND = math.inf, 0.0, 0.0, 0.0, 0.0


def profile(rng: np.random.Generator) -> FreeProfile:
    d, layers = int(rng.integers(4, 20)), int(rng.integers(1, 5))
    around = rng.uniform(-4, 4)
    edges = around + np.sort(rng.uniform(-0.7, 0.7, d + 1))
    return FreeProfile(
        azimuth_edges_rad=edges.astype(np.float32),
        layer_edges_m=(rng.uniform(-40, 40) + 2.0 * np.arange(layers + 1)).astype(np.float32),
        free_from_m=rng.uniform(0, 2, (d, layers)).astype(np.float32),
        free_to_m=rng.choice([0.0, 4.0, 8.0, 9.5], (d, layers)).astype(np.float32),
        end=np.zeros((d, layers), np.uint8),
    )


def look(free, p: FreeProfile, x: float, y: float) -> None:
    edges, layers = p.azimuth_edges_rad.astype(float), p.layer_edges_m.astype(float)
    see_free(free, FreeView(x, y, 0.0, edges, layers, p.free_from_m, p.free_to_m, p.end, *NO_GROUND))


def cells(free, now: int = 0) -> set[tuple[int, int, int]]:
    """Indices of the cells that are free, one bit at a time."""
    out = set()
    for (bx, by, bz), masks, _ in zip(*seen_blocks(free, now), strict=True):
        for c in np.flatnonzero(masks):
            for b in range(64):
                if int(masks[c]) >> b & 1:
                    out.add((int(bx) * 16 + int(c) // 16, int(by) * 16 + int(c) % 16, int(bz) * 64 + b))
    return out


def naive(p: FreeProfile, x: float, y: float) -> tuple[set[tuple[int, int, int]], set[tuple[int, int, int]]]:
    """(cells surely free, cells that may be) by asking for each one whether its whole column of air is."""
    surely, maybe = set(), set()
    edges, layers = p.azimuth_edges_rad.astype(float), p.layer_edges_m.astype(float)
    for ix in range(math.floor((x - 10) / CELL_M), math.ceil((x + 10) / CELL_M)):
        for iy in range(math.floor((y - 10) / CELL_M), math.ceil((y + 10) / CELL_M)):
            cx, cy = (ix + 0.5) * CELL_M - x, (iy + 0.5) * CELL_M - y
            r = math.hypot(cx, cy)
            for grow, out in ((1e-6, surely), (-1e-6, maybe)):
                half = 0.7072 * CELL_M + grow
                if r <= 2 * 0.7072 * CELL_M + grow:
                    continue
                turn = math.asin(half / r)
                middle = math.atan2(cy, cx)
                ok = [_all_free(p, middle, turn, k, r - half, r + half, edges) for k in range(len(layers) - 1)]
                for iz in range(math.floor(layers[0] / CELL_M), math.ceil(layers[-1] / CELL_M)):
                    z0, z1 = iz * CELL_M, (iz + 1) * CELL_M
                    inside = z0 >= layers[0] and z1 <= layers[-1]
                    if inside and all(ok[k] for k in range(len(ok)) if layers[k] < z1 and layers[k + 1] > z0):
                        out.add((ix, iy, iz))
    return surely, maybe


def _all_free(p: FreeProfile, middle: float, turn: float, k: int, near: float, far: float, edges: np.ndarray) -> bool:
    """Whether every direction that an arc reaches into is free from near to far, and the arc lies within the view."""
    for wrap in (-2, -1, 0, 1, 2):
        low, high = middle - turn + wrap * math.tau, middle + turn + wrap * math.tau
        if low >= edges[0] and high < edges[-1]:
            hit = [d for d in range(len(edges) - 1) if edges[d] <= high and edges[d + 1] > low]
            return all(p.free_from_m[d, k] <= near and p.free_to_m[d, k] >= far for d in hit)
    return False


@examples(0.1)
@given(SEED)
def test_cells_against_asking_each_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, x, y = profile(rng), *rng.uniform(-30, 30, 2)
    free = empty_free(64)
    look(free, p, x, y)
    found = cells(free)
    surely, maybe = naive(p, x, y)
    assert surely <= found <= maybe


@examples(0.8)
@given(SEED)
def test_every_free_cell_is_free_to_the_planners_queries(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, x, y = profile(rng), *rng.uniform(-30, 30, 2)
    free = empty_free(64)
    look(free, p, x, y)
    at = np.array(sorted(cells(free)), float).reshape(-1, 3)
    inside = (at + rng.uniform(0.001, 0.999, at.shape)) * CELL_M
    assert balls_free(p, (x, y, 0.0), inside, np.full(len(inside), 1e-6)).all()


@pytest.mark.parametrize(
    ("most", "reach_m"), [(1, 12.0), (2, 12.0), (5, 12.0), pytest.param(64, 60.0, marks=pytest.mark.compiled)]
)
def test_a_frame_that_sees_more_than_the_table_holds_frees_nothing_else(most: int, reach_m: float) -> None:
    """Layers on both sides of z = 0 lie in two blocks of each column, of which one may replace the other."""
    p = FreeProfile(
        azimuth_edges_rad=np.linspace(-0.8, 0.8, 9, dtype=np.float32),
        layer_edges_m=np.array([-3.0, -1.0, 1.0, 3.0], np.float32),
        free_from_m=np.full((8, 3), 0.5, np.float32),
        free_to_m=np.tile(np.array([0.8, 1.0, 0.7], np.float32) * reach_m, (8, 1)),
        end=np.zeros((8, 3), np.uint8),
    )
    free, large = empty_free(most), empty_free(1024)
    for x in (0.0, 3.0):
        look(free, p, x, 0.0)
        look(large, p, x, 0.0)
    assert 0 < len(cells(free)) < len(cells(large))
    assert cells(free) <= cells(large)


def test_free_space_is_forgotten_after_two_epochs_and_never_later() -> None:
    rng, free = np.random.default_rng(5), empty_free(64)
    free.state["epoch"] = 7
    look(free, profile(rng), 0.0, 0.0)
    assert cells(free, 7) == cells(free, 8) != set()
    assert cells(free, 9) == set()
    assert cells(free, 6) == set()  # a clock that went back knows nothing
    free.state["epoch"] = 8
    first = cells(free, 8)
    look(free, profile(rng), 100.0, 0.0)
    assert first < cells(free, 8)
    second = cells(free, 8) - first
    assert cells(free, 9) == second
    free.state["epoch"] = 10
    look(free, profile(rng), 0.0, 0.0)
    assert not cells(free, 10) & first - cells(free, 11)


@kernel
def asked(free, points, out):
    for k in range(points.shape[0]):
        out[k] = any_free(free, points[k, 0], points[k, 1], points[k, 2])


@kernel
def block_all(free, observations):
    for k in range(observations.shape[0]):
        stand_in(free, observations[k], True)


def observations_at(rows: np.ndarray) -> np.ndarray:
    """(N,) OBSERVATION of planes (N, 6)."""
    out = np.zeros(len(rows), OBSERVATION)
    for name, column in zip(BOX, rows.T, strict=True):
        out[name] = column
    return out


@examples(0.4)
@given(SEED)
def test_where_an_obstacle_stands_nothing_is_free(seed: int) -> None:
    rng, free = np.random.default_rng(seed), empty_free(64)
    p = profile(rng)
    look(free, p, 0.0, 0.0)
    before = cells(free)
    z = float(p.layer_edges_m[0])
    rows = np.column_stack([rng.uniform(-8, 8, (5, 4)), z + rng.uniform(0, 3, 5), z + rng.uniform(3, 6, 5)])
    block_all(free, observations_at(rows))
    after = cells(free)
    assert after <= before
    s = np.linspace(0, 1, 50)
    for row in rows:
        at = np.array([[row[0] + k * (row[2] - row[0]), row[1] + k * (row[3] - row[1])] for k in s])
        for x, y in at:
            for height in np.linspace(row[4], row[5], 9):
                index = (math.floor(x / CELL_M), math.floor(y / CELL_M), math.floor(height / CELL_M))
                assert index not in after
    points = (np.array(sorted(before), float).reshape(-1, 3) + 0.5) * CELL_M
    out = np.zeros(len(points), bool)
    asked(free, points, out)
    assert {tuple(c) for c in np.floor(points[out] / CELL_M).astype(int).tolist()} == after


def test_the_blocks_not_touched_longest_go() -> None:
    rng, free = np.random.default_rng(2), empty_free(4)
    p = profile(rng)
    for k in range(20):
        free.state["frame"] = k + 1
        look(free, p, 50.0 * k, 0.0)
    assert free.state[0].blocks == 4
    assert free.state[0].dropped > 0
    found = cells(free)
    fresh = empty_free(64)
    look(fresh, p, 50.0 * 19, 0.0)
    assert found
    assert min(c[0] for c in found) > 50.0 * 14 / CELL_M
    assert found & cells(fresh)


def test_bits_of_a_mask() -> None:
    for first, end in ((0, 64), (3, 7), (-5, 2), (60, 80), (5, 5), (9, 3), (-9, 0), (64, 70)):
        assert int(bits(first, end)) == sum(1 << b for b in range(max(0, first), min(64, end)))

"""Random frames of a world, some read late, against asking each frame: what is free was measured free in time, and nothing came
into it since."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import FrameModel, FreeProfile, Ground
from core.world.free_grid import CELL_M, HALF_M
from core.world.params import WorldParams
from core.world.snapshot import WorldSnapshot
from core.world.world import RESTART_S, Observation, World
from osape_client.query.solid_ground import solid_ground
from osape_client.query.space import balls_free
from tests.core.worlds import NS, seen

Floats = NDArray[np.float64]
AGE_S = 4.0
PARAMS = WorldParams(free_age_s=AGE_S, jump_m=100.0)
MOST_NOISE_M = 0.1 * 11.0
"""Of the ground of any frame here, where it was measured."""
INSIDE = np.array(list(product((0.002, 0.25, 0.498), repeat=3)))
"""Points of a cell."""
NO_WALLS = seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, 0).model


def random_model(rng: np.random.Generator, at: Floats) -> FrameModel:
    """Free ranges, ground and planes that have nothing to do with each other."""
    d, layers, n = int(rng.integers(4, 20)), int(rng.integers(1, 5)), int(rng.integers(0, 4))
    half = rng.choice([0.7, 1.5, 3.1])
    free = FreeProfile(
        azimuth_edges_rad=(rng.uniform(-4, 4) + np.sort(rng.uniform(-half, half, d + 1))).astype(np.float32),
        layer_edges_m=(rng.uniform(-3, 1) + rng.choice([0.5, 1.0, 2.0]) * np.arange(layers + 1)).astype(np.float32),
        free_from_m=rng.uniform(0, 2, (d, layers)).astype(np.float32),
        free_to_m=rng.choice([0.0, 4.0, 8.0, 9.5], (d, layers)).astype(np.float32),
        end=rng.integers(0, 5, (d, layers)).astype(np.uint8),
    )
    ground = Ground(
        seen=bool(rng.random() < 0.5),
        height_m=rng.uniform(0.3, 3.0),
        slope_x=rng.uniform(-0.2, 0.2),
        slope_y=rng.uniform(-0.2, 0.2),
        tolerance_m=rng.uniform(0.0, 0.5),
        noise_per_m=rng.uniform(0.0, 0.1),
        seen_from_m=tuple(rng.uniform(0.0, 3.0, d)),
        seen_to_m=tuple(rng.choice([0.0, 5.0, 9.0], d)),
    )
    a, top = at[:2] + rng.uniform(-7, 7, (n, 2)), rng.uniform(-3, 1, n)
    b = a + rng.normal(size=(n, 2)) * rng.choice([0.3, 2.0, 5.0])
    return replace(
        NO_WALLS,
        free=free,
        ground=ground,
        planes=np.column_stack([a, b, top, top + rng.uniform(0.05, 4, n)]).astype(np.float32),
        support_px=np.full(n, 50, np.int32),
        margin_m=rng.uniform(0, 0.3, n).astype(np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
        ke_per_m=float(rng.choice([0.001, 0.01])),
    )


def random_frame(rng: np.random.Generator, t_ns: int) -> Observation:
    at = rng.uniform(-3, 3, 3) * np.array([1.0, 1.0, 0.3])
    return Observation(model=random_model(rng, at), place_m=tuple(at.tolist()), t_ns=t_ns)


def measured_free(frame: Observation, points: Floats) -> bool:
    free, ground = frame.model.free, solid_ground(frame.model.ground, frame.model.free, frame.place_m)
    none = np.zeros(len(points))
    return bool((balls_free(free, frame.place_m, points, none) & ground.clear(points, none)).all())


def crosses(frame: Observation, low: Floats) -> bool:
    """Whether a plane of a frame enters a cell, by more than rounding."""
    low, high = low + 1e-5, low + CELL_M - 1e-5
    for plane in frame.model.planes.astype(float):
        begin, end = 0.0, 1.0
        for k in (0, 1):
            step = plane[2 + k] - plane[k]
            shares = sorted((edge - plane[k]) / step for edge in (low[k], high[k])) if step else [-math.inf, math.inf]
            begin, end = max(begin, shares[0]), min(end, shares[1])
            if not step and not low[k] <= plane[k] <= high[k]:
                end = -1.0
        if begin <= end and plane[5] > low[2] and plane[4] < high[2]:
            return True
    return False


def lies_below_ground(frame: Observation, low: Floats) -> bool:
    """Whether a frame measured the ground of a whole column of cells, and this cell is plainly below it."""
    ground, (x, y, z) = frame.model.ground, frame.place_m
    east, north = low[0] + 0.5 * CELL_M - x, low[1] + 0.5 * CELL_M - y
    range_m, edges = math.hypot(east, north), frame.model.free.azimuth_edges_rad.astype(float)
    if not ground.seen or range_m <= 2.0 * HALF_M:
        return False
    half = math.asin(HALF_M / range_m)
    begin = (math.atan2(north, east) - half - edges[0]) % math.tau + edges[0]
    if begin + 2.0 * half >= edges[-1]:
        return False
    hit = [d for d in range(len(edges) - 1) if edges[d] <= begin + 2.0 * half and edges[d + 1] > begin]
    if any(ground.seen_from_m[d] > range_m - HALF_M or ground.seen_to_m[d] < range_m + HALF_M for d in hit):
        return False
    highest = z + ground.height_m + ground.slope_x * east + ground.slope_y * north
    highest -= math.hypot(ground.slope_x, ground.slope_y) * HALF_M
    return bool(low[2] > highest + 2.0 * MOST_NOISE_M + CELL_M)


def free_cells(picture: WorldSnapshot) -> Floats:
    """(N, 3) the least corner of each free cell."""
    bits = np.unpackbits(picture.masks.view(np.uint8).reshape(-1, 256, 8), axis=-1, bitorder="little")
    block, column, bit = np.nonzero(bits)
    index = picture.blocks[block] * np.array([16, 16, 64]) + np.column_stack([column // 16, column % 16, bit])
    return np.asarray(index * CELL_M)


def proved(frames: list[Observation], low: Floats, now_ns: int) -> bool:
    """Whether a frame of the stated time measured a cell free, and none of those since came into it."""
    oldest_ns = now_ns - round((AGE_S + RESTART_S) * NS)
    for frame in frames:
        if frame.t_ns < oldest_ns or not measured_free(frame, low + INSIDE):
            continue
        since = [f for f in frames if f.t_ns >= frame.t_ns]
        if not any(crosses(f, low) or (f is not frame and lies_below_ground(f, low)) for f in since):
            return True
    return False


@pytest.mark.parametrize("seed", range(6))
def test_each_free_cell_was_measured_in_time_and_nothing_came_since(seed: int) -> None:
    rng, frames, t_ns, cells = np.random.default_rng(seed), list[Observation](), 10 * NS, 0
    world = World(replace(PARAMS, most_free_blocks=int(rng.choice([64, 4096]))))
    for k in range(24):
        t_ns += round(rng.choice([0.03, 0.1, 0.5, 1.4]) * NS)
        late_ns = round(rng.uniform(0.0, 0.9) * NS) if rng.random() < 0.25 else 0
        frames.append(random_frame(rng, t_ns - late_ns))
        world.add(frames[-1])
        if k % 6 == 5:
            now_ns = t_ns + round(rng.choice([0.0, 0.1, 1.0, 3.0]) * NS)
            found = free_cells(world.picture(now_ns))
            chosen = found[rng.permutation(len(found))[:150]]
            cells += len(chosen)
            assert all(proved(frames, low, now_ns) for low in chosen)
    assert world.counts.sections == 1
    assert cells > 100

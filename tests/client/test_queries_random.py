"""Queries of random profiles, grounds and planes of up to three cameras, against one point at a time in plain Python."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from core.transformed import turned
from core.types import FrameModel, FreeProfile, Ground
from osape_client.query.space import Occupancy, PlacedModel, Space
from tests.core.worlds import seen

Floats = NDArray[np.float64]
ROUNDING = 1e-9
"""Of azimuths, radians: points are drawn at the very edges."""
LAYERS = np.array([-4.0, -2.0, 0.0, 2.0, 4.0], np.float32)


def random_model(rng: np.random.Generator) -> FrameModel:
    """A profile that begins anywhere and may reach around once, over a ground that is inclined or not there."""
    directions = int(rng.integers(1, 24))
    width = float(rng.choice([0.6, 1.6, 4.0, math.tau]))
    edges = rng.uniform(-math.pi, math.pi) + np.sort(
        np.concatenate([[0.0, width], rng.uniform(0.0, width, directions - 1)])
    )
    shape = (directions, len(LAYERS) - 1)
    begins = rng.uniform(0.0, 3.0, shape).astype(np.float32)
    ends = np.where(rng.random(shape) < 0.25, 0.0, rng.uniform(4.0, 12.0, shape)).astype(np.float32)
    ground = Ground(
        seen=bool(rng.random() < 0.8),
        height_m=rng.uniform(0.3, 4.0),
        slope_x=rng.uniform(-0.3, 0.3),
        slope_y=rng.uniform(-0.3, 0.3),
        tolerance_m=rng.uniform(0.0, 0.5),
        noise_per_m=rng.uniform(0.0, 0.1),
        seen_from_m=tuple(rng.uniform(0.0, 3.0, directions)),
        seen_to_m=tuple(rng.choice([0.0, 5.0, 9.0], directions)),
    )
    free = FreeProfile(
        azimuth_edges_rad=edges.astype(np.float32),
        layer_edges_m=LAYERS,
        free_from_m=begins,
        free_to_m=ends,
        end=np.zeros(shape, np.uint8),
    )
    return replace(seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, 0).model, free=free, ground=ground)


def free_by_one(model: FrameModel, place: Floats, p: Floats) -> bool:
    """Whether one camera calls a point free: by its definition, direction by direction."""
    x, y, z = p - place
    r, g, f = math.hypot(x, y), model.ground, model.free
    if g.seen:
        height = g.height_m + g.slope_x * x + g.slope_y * y - z
        if height < max(g.tolerance_m, g.noise_per_m * r):
            return False
    edges, layers = f.azimuth_edges_rad.astype(float), f.layer_edges_m.astype(float)
    for turn in range(-4, 5):
        azimuth = math.atan2(y, x) + turn * math.tau
        for d in range(len(edges) - 1):
            for layer in range(len(layers) - 1):
                inside = (
                    edges[d] - ROUNDING <= azimuth <= edges[d + 1] + ROUNDING
                    and layers[layer] <= p[2] <= layers[layer + 1]
                )
                if inside and f.free_from_m[d, layer] <= r <= f.free_to_m[d, layer]:
                    return True
    return False


def on_ball(rng: np.random.Generator, radius_m: float, count: int) -> Floats:
    """(count, 3) offsets within a ball, most of them on its surface."""
    to = rng.normal(size=(count, 3))
    to /= np.linalg.norm(to, axis=1)[:, None]
    return np.asarray(to * radius_m * np.where(rng.random((count, 1)) < 0.7, 1.0, rng.random((count, 1))))


@pytest.mark.parametrize("seed", range(12))
def test_all_points_of_a_free_ball_are_free_to_one_camera(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(int(rng.integers(1, 4))):
        shift = tuple(rng.uniform(-3.0, 3.0, 3).tolist())
        model = turned(random_model(rng), float(rng.uniform(-7.0, 7.0)), shift)
        assert model.valid
        parts.append(PlacedModel(model, shift))
    space, radius_m = Space(parts), float(rng.choice([0.0, 0.1, 0.4]))
    at = np.array(parts[0].place_m)
    points = at + rng.uniform(-12.0, 12.0, (6000, 3)) * np.array([1.0, 1.0, 0.4])
    # at the very edges of directions and layers too
    free = parts[0].model.free
    edges, r = rng.choice(free.azimuth_edges_rad.astype(float), 1000), rng.uniform(0.0, 10.0, 1000)
    points[:1000, 0], points[:1000, 1] = at[0] + r * np.cos(edges), at[1] + r * np.sin(edges)
    points[500:1500, 2] = rng.choice(free.layer_edges_m.astype(float), 1000)
    answers = space.points(points, radius_m)
    found = points[answers == Occupancy.FREE]
    for p in found[:150]:
        around = p + on_ball(rng, radius_m * (1.0 - 1e-6), 12)
        by_each = [all(free_by_one(part.model, np.array(part.place_m), q) for q in around) for part in parts]
        assert any(by_each), (p, radius_m)
    # and what every camera calls free at a point is answered so, unless the ground of another occupies it
    inside = [p for p in points[1500:1800] if any(free_by_one(s.model, np.array(s.place_m), p) for s in parts)]
    if inside:
        assert Occupancy.UNKNOWN not in space.points(np.array(inside))


@pytest.mark.parametrize("seed", range(6))
def test_answers_move_with_the_model(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    model, yaw, shift = random_model(rng), float(rng.uniform(-7.0, 7.0)), tuple(rng.uniform(-50.0, 50.0, 3).tolist())
    p = rng.uniform(-10.0, 10.0, (4000, 3)) * np.array([1.0, 1.0, 0.4])
    c, s = math.cos(yaw), math.sin(yaw)
    q = np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]]) + shift
    for radius_m in (0.0, 0.3):
        before = Space([PlacedModel(model, (0.0, 0.0, 0.0))]).points(p, radius_m)
        after = Space([PlacedModel(turned(model, yaw, shift), shift)]).points(q, radius_m)
        assert (before == after).mean() > 0.998  # float32 edges


def test_numbers_beyond_all_measure_are_never_free() -> None:
    space = Space([PlacedModel(random_model(np.random.default_rng(3)), (0.0, 0.0, 0.0))])
    bad = [math.nan, math.inf, -math.inf, 1e9, -1e12, 1e300]
    p = np.array([[b if k == axis else 1.0 for k in range(3)] for b in bad for axis in range(3)])
    for radius_m in (0.0, 1.0, 1e12):
        assert Occupancy.FREE not in space.points(p, radius_m)
        assert Occupancy.FREE not in space.segments(p, np.ones_like(p), radius_m)
    distance_m, towards, _ = space.nearest(p)
    assert not np.isnan(distance_m).any()
    assert np.isfinite(towards).all()

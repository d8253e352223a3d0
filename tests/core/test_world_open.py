"""Open space and the merged world: it neither writes free cells nor removes a remembered plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.world.params import WorldParams
from core.world.world import Observation, World

from .worlds import NS, seen

WALL = np.array([[8.0, -3.0, 8.0, 3.0, -1.0, 1.0]])


def all_open(observation: Observation) -> Observation:
    """The observation with everything presumed free to 15 m."""
    f = observation.model.free
    opened = replace(f, open_from_dm=np.ones(f.end.shape, np.uint8), open_to_dm=np.full(f.end.shape, 150, np.uint8))
    return replace(observation, model=replace(observation.model, free=opened))


def blank(t_ns: int) -> Observation:
    """A frame that measured nothing and sees no plane."""
    observation = seen(np.zeros((0, 6)), (0.0, 0.0), 0.0, t_ns)
    f = observation.model.free
    return replace(observation, model=replace(observation.model, free=replace(f, free_to_m=np.zeros_like(f.free_to_m))))


def test_a_world_of_frames_with_open_space_is_that_without() -> None:
    worlds = []
    for change in (lambda o: o, all_open):
        world = World(WorldParams())
        for k in range(3):
            world.add(seen(WALL, (0.0, 0.0), 0.0, k * NS // 10))
        for k in range(3, 30):
            world.add(change(blank(k * NS // 10)))
        worlds.append(world.picture(3 * NS))
    plain, opened = worlds
    assert len(plain.planes) == 1
    assert np.array_equal(plain.planes, opened.planes)
    assert np.array_equal(plain.blocks, opened.blocks)
    assert np.array_equal(plain.masks, opened.masks)

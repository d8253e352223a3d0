"""What the merged world calls free, and which obstacles it has lost, by the results of a flight."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.client_queries import world_space
from companion.live.world_thread import observation_of
from companion.pipeline.results import PrismsResult
from core.world.params import WorldParams
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.space import WorldSpace

EVERY = 8
"""Of so many results in the world one is judged."""
HELD_M, LOST_M = 0.5, 1.5
"""A plane within HELD_M of a place stands for it; none within LOST_M afterwards: the world has lost it."""
EXACT_M = 12.0
"""Range from which LOST_M grows. At 14 m, near the end of the range, the plane of a wall moved from 0.2 to 1.5 m before it."""
PARAMS = WorldParams(most_planes=4096, most_free_blocks=512)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(slots=True)
class WorldWatch:
    """Merges results as the world's thread does. space: queries of the world, made again after each EVERY results."""

    space: WorldSpace | None = None
    _world: World = field(default_factory=lambda: World(PARAMS))
    _began_ns: int = -1
    _taken: int = 0
    _section: int = -1
    _held: Mask = field(default_factory=lambda: np.zeros(0, bool))

    def take(self, result: PrismsResult, began_ns: int) -> bool:
        """Adds a result. Returns whether the world is to be judged now. began_ns: start of the service, with a new world."""
        if began_ns != self._began_ns:
            self._world, self._began_ns, self._section = World(PARAMS), began_ns, -1
        observation = observation_of(result)
        if observation is None:
            return False
        self._world.add(observation)
        self._taken += 1
        if self._taken % EVERY or self._world.section is None:
            return False
        if self._world.section.number != self._section:
            self._section, self._held = self._world.section.number, np.zeros(0, bool)
        self.space = world_space(self._world.picture(result.t_exposure_ns))
        return True

    def free(self, points_m: Floats) -> Mask:
        """Returns which points (N, 3) of the world are free."""
        assert self.space is not None
        return np.asarray(self.space.points(points_m) == Occupancy.FREE)

    def lost(self, surface_m: Floats, range_m: Floats) -> Mask:
        """Returns which places (N, 3) on surfaces, always the same ones, the present section has lost since it held them.

        range_m: (N,) from the vehicle. The noise grows with its square, and with it what a plane may be moved towards the vehicle."""
        assert self.space is not None
        far_m = self.space.nearest(surface_m)[0]
        held = self._held if len(self._held) else np.zeros(len(surface_m), bool)
        lost = held & (far_m > LOST_M * np.maximum(1.0, (range_m / EXACT_M) ** 2))
        self._held = (held | (far_m < HELD_M)) & ~lost
        return np.asarray(lost)

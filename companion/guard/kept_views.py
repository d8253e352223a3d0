"""Views of a moment ago, moved to the present position: what they saw free along the present path.

A hole of the depth image, or a course that the noise of the velocity turns, leaves parts of the corridor unseen in one
frame. Another frame has seen the same places. Places are compared in ned, so both frames need a position, and an
estimate that has not jumped between them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..autopilot.obstacle_memory import Here
from ..autopilot.surroundings import Surroundings
from ..autopilot.view_free import View, points_free

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MovedViews:
    """Views of one decision, for places in `level` at another one: p_then = Rz(turn_rad) p + shift_m.

    exposed_ns: the oldest exposure of the views."""

    views: tuple[View, ...]
    turn_rad: float
    shift_m: tuple[float, float, float]
    exposed_ns: int = 0

    def free(self, x: Floats, y: Floats, z: Floats) -> NDArray[np.bool_]:
        """Returns which places were measured free, (len(z), *x.shape). x, y: of one shape; z: (heights,)."""
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        x_then, y_then = c * x - s * y + self.shift_m[0], s * x + c * y + self.shift_m[1]
        out = np.zeros((len(z), *x.shape), bool)
        for view in self.views:
            if view.model.valid:
                out |= points_free(view, x_then, y_then, z + self.shift_m[2], along_rays=True, measured=True)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class KeptRays:
    """The rays of the present corridor by frames of a moment ago.

    Attributes:
        exposed_ns: oldest exposure of the frames.
        free_m: (N,) distance to which each ray is seen free."""

    exposed_ns: int
    free_m: Floats


def _moved(then: Here, now: Here) -> MovedViews | None:
    """Returns no views yet, for places at another decision; None: the places cannot be compared."""
    if then.position_ned_m is None or now.position_ned_m is None or then.estimate != now.estimate:
        return None
    north, east, down = (b - a for a, b in zip(then.position_ned_m, now.position_ned_m, strict=True))
    c, s = math.cos(then.heading_rad), math.sin(then.heading_rad)
    turn_rad = math.remainder(now.heading_rad - then.heading_rad, math.tau)
    return MovedViews((), turn_rad, (c * north + s * east, c * east - s * north, down))


@dataclass(slots=True)
class KeptViews:
    """The views exposed in the last keep_ns, one decision for each set of frames."""

    keep_ns: int
    _kept: deque[Surroundings] = field(default_factory=lambda: deque(maxlen=32))

    def take(self, s: Surroundings) -> None:
        """Adds the surroundings of a decision. Without views or frames there is nothing to keep."""
        if s.views and s.here is not None and s.frames and (not self._kept or self._kept[-1].frames != s.frames):
            self._kept.append(s)

    def before(self, s: Surroundings) -> Iterator[MovedViews]:
        """Yields the kept views of other frames, for places in `level` at a decision.

        The views of several cameras differ in age. Each decision comes with all of them, then without the oldest one,
        and so on, so that those of a slow camera do not end what the others have seen."""
        for kept in self._kept:
            if kept.frames == s.frames or s.here is None or kept.here is None:
                continue
            moved = _moved(kept.here, s.here)
            if moved is None:
                continue
            by_age = sorted(zip(kept.views, kept.frames, strict=True), key=lambda pair: pair[1][1])
            for k, (_, (_, exposed_ns)) in enumerate(by_age):
                if s.t_ns - exposed_ns <= self.keep_ns:
                    yield replace(moved, views=tuple(view for view, _ in by_age[k:]), exposed_ns=exposed_ns)

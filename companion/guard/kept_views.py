"""Views of a moment ago, moved to the present position: what they saw free along the present path.

A hole of the depth image, or a course that the noise of the velocity turns, leaves parts of the corridor unseen in one
frame. Another frame has seen the same places. Places are compared in ned, so both frames need a position, and an
estimate that has not jumped between them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..autopilot.obstacle_memory import Here
from ..autopilot.surroundings import Surroundings
from ..autopilot.view_free import View, points_free
from ..pipeline.transform import LevelTransform
from .corridor import Bools, Floats, Samples

KEEP_FREE_NS = 350_000_000
"""Time from the exposure for which space that was seen free counts while newer frames do not see it and show no obstacle."""


def measured_free(view: View, x: Floats, y: Floats, z: Floats) -> Bools:
    """Returns which places a view has measured free, (len(z), *x.shape). x, y: of one shape; z: (heights,)."""
    if not view.model.valid:
        return np.zeros((len(z), *x.shape), bool)
    return points_free(view, x, y, z, along_rays=True, measured=True)


@dataclass(frozen=True, slots=True, eq=False)
class KeptRays:
    """The rays of the present corridor by frames of a moment ago."""

    exposed_ns: int  # oldest exposure of the frames
    free_m: Floats  # (N,) distance to which each ray is seen free


@dataclass(frozen=True, slots=True, eq=False)
class KeptDecision:
    """Views of one decision, for places in `level` at another one."""

    then_now: LevelTransform  # transform of such places to `level` at the decision of the views
    views: tuple[tuple[View, int], ...] = ()  # each with its exposure in ns, the youngest first

    def rays(self, samples: Samples) -> Iterator[KeptRays]:
        """Yields the rays of a corridor by the youngest view, by the two youngest ones, and so on.

        The views of several cameras differ in age: those of a slow camera must not end what the others have seen."""
        found = None
        for view, exposed_ns in self.views:
            seen = samples.found(partial(self._free, view))
            found = seen if found is None else found | seen
            yield KeptRays(exposed_ns, samples.rays_m(found))

    def _free(self, view: View, x: Floats, y: Floats, z: Floats) -> Bools:
        """Returns which places the view has measured free; see `measured_free`."""
        return measured_free(view, *self.then_now.places(x, y), z + self.then_now.translation_m[2])


def _moved(then: Here, now: Here) -> KeptDecision | None:
    """Returns a decision without views, for places at another one; None: the places cannot be compared."""
    if then.position_ned_m is None or now.position_ned_m is None or then.estimate != now.estimate:
        return None
    north, east, down = (b - a for a, b in zip(then.position_ned_m, now.position_ned_m, strict=True))
    forward, right = LevelTransform(-then.heading_rad).places(north, east)
    return KeptDecision(LevelTransform(now.heading_rad - then.heading_rad, (forward, right, down)))


@dataclass(slots=True)
class KeptViews:
    """The views exposed in the last KEEP_FREE_NS, one decision for each set of frames."""

    _kept: deque[Surroundings] = field(default_factory=lambda: deque(maxlen=32))

    def take(self, s: Surroundings) -> None:
        """Adds the surroundings of a decision. Without views or frames there is nothing to keep."""
        if s.views and s.here is not None and s.frames and (not self._kept or self._kept[-1].frames != s.frames):
            self._kept.append(s)

    def before(self, s: Surroundings) -> Iterator[KeptDecision]:
        """Yields the kept decisions with other frames, for places in `level` at a decision, with their views that are not
        older than KEEP_FREE_NS."""
        for kept in self._kept:
            if kept.frames == s.frames or s.here is None or kept.here is None:
                continue
            moved = _moved(kept.here, s.here)
            if moved is None:
                continue
            views = [(view, t_ns) for view, (_, t_ns) in zip(kept.views, kept.frames, strict=True)]
            fresh = [(view, t_ns) for view, t_ns in views if s.t_ns - t_ns <= KEEP_FREE_NS]
            if fresh:
                yield replace(moved, views=tuple(sorted(fresh, key=lambda pair: -pair[1])))

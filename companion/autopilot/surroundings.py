"""The inputs of one decision of the obstacle output, for parts that watch the space around the vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .obstacle_memory import Here, Remembered
from .polar_histogram import Recall
from .view_free import View


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Inputs of a decision.

    Attributes:
        t_ns: instant of the decision, monotonic.
        views: models of the seeing cameras, in level at t_ns.
        weak_px: of each view, planes with this support or less need a second frame.
        exposed_ns: oldest of the newest exposures of these cameras; None: no camera sees.
        recall: see `polar_histogram.Recall`; valid only during the call.
        recalled: remembered obstacles.
        blind: why each blind camera is blind.
        here: heading and position; None: not known.
        velocity_ned_m_s: None: not known, or older than 0.5 s.
        frames: camera and exposure of each view; empty: not known.
        velocity_ns: instant of the velocity; None: not known.
        moved: the views were moved by the distance flown since their exposures. False: neither position nor velocity is known,
            and they show the places as at their exposures."""

    t_ns: int
    views: tuple[View, ...]
    weak_px: tuple[float, ...]
    exposed_ns: int | None
    recall: Recall | None
    recalled: Remembered
    blind: dict[str, str]
    here: Here | None
    velocity_ned_m_s: tuple[float, float, float] | None
    frames: tuple[tuple[str, int], ...] = ()
    velocity_ns: int | None = None
    moved: bool = True


Observer = Callable[[Surroundings], None]
"""Called in the thread of the obstacle output. It must not raise and must not block."""

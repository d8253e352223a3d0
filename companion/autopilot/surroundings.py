"""The inputs of one decision of the obstacle output, for parts that watch the space around the vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .obstacle_memory import Here, Remembered
from .polar_histogram import Recall
from .view_free import View


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Inputs of a decision."""

    t_ns: int  # instant of the decision, monotonic
    views: tuple[View, ...]  # models of the seeing cameras, in level at t_ns
    weak_px: tuple[float, ...]  # of each view, planes with this support or less need a second frame
    exposed_ns: int | None  # oldest of the newest exposures of these cameras; None: no camera sees
    recall: Recall | None  # see `polar_histogram.Recall`; valid only during the call
    recalled: Remembered
    blind: dict[str, str]  # why each blind camera is blind
    here: Here | None  # heading and position; None: not known
    velocity_ned_m_s: tuple[float, float, float] | None  # None: not known, or older than 0.5 s
    frames: tuple[tuple[str, int], ...] = ()  # camera and exposure of each view; empty: not known
    velocity_ns: int | None = None  # instant of the velocity; None: not known
    # the views were moved by the distance flown since their exposures. False: neither position nor velocity is known,
    # and they show the places as at their exposures.
    moved: bool = True


Observer = Callable[[Surroundings], None]
"""Called in the thread of the obstacle output. It must not raise and must not block."""

"""What one decision of the obstacle output was made from, for parts that watch the space around the vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .obstacle_memory import Here, Remembered
from .polar_histogram import Recall
from .view_free import View


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """State at the instant t_ns of a decision, monotonic. views: of the cameras that see, in level at t_ns. weak_px: for
    each view, planes with this support or less need a second frame. exposed_ns: oldest of the newest exposures of these
    cameras, None: no camera sees. frames: camera and exposure of each view; empty: not known. recall: see `polar_histogram.Recall`; only valid during the call. blind: why each blind
    camera is blind. here: heading and position, None: not known. velocity_ned_m_s: None: not known, or older than 0.5 s;
    velocity_ns: its own stamp, None: not known."""

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


Observer = Callable[[Surroundings], None]
"""Called in the thread of the obstacle output; it must not raise and must not block."""

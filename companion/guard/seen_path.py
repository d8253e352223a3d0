"""How long the path is seen without interruption. After a stop for unseen space, unseen space stops the vehicle again only after the
path was seen for a time: in flight, or at rest after a camera failed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from .assessment import Verdict
from .hold_motion import STANDS_M_S
from .path_sight import LEAST_SPEED_M_S

ALONG_RAD: Final = math.radians(10.0)
"""A vehicle at rest looks along the course on which it was stopped if its heading differs by at most this."""


@dataclass(slots=True)
class SeenPath:
    """Follows the verdicts. `in_flight` and `at_rest` return how long the path is seen, in ns; None: it is not, or that is not known.
    now_ns: monotonic."""

    _since_ns: int | None = None
    _camera_failed: bool = False  # the newest stop for unseen space came from a camera that failed

    def stopped(self, verdict: Verdict, repeated: bool) -> None:
        """The vehicle is stopped by this verdict; repeated: and has been for unseen space since the path was last seen long enough."""
        self._since_ns = None
        if not repeated:
            self._camera_failed = verdict.camera_fails

    def in_flight(self, verdict: Verdict | None, now_ns: int) -> int | None:
        """Takes the verdict of a vehicle that flies."""
        if verdict is None or not verdict.sees:
            self._since_ns = None
            return None
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns

    def at_rest(self, verdict: Verdict | None, stopped: Verdict | None, now_ns: int) -> int | None:
        """Takes the verdict of a vehicle that was stopped and stands.

        The path counts as seen if a camera had failed, none fails now, and the vehicle looks along the course on which it was
        stopped. A vehicle that flies sideways, or leans or descends so that no camera shows its path, would otherwise be stopped each
        time its mission is resumed."""
        turned = turned_rad(verdict, stopped)
        if verdict is None or turned is None or verdict.camera_fails or not self._camera_failed:
            self._since_ns = None
            return None
        if abs(turned) <= ALONG_RAD:
            return self.in_flight(verdict, now_ns)
        if verdict.speed_m_s is None or not LEAST_SPEED_M_S <= verdict.speed_m_s < STANDS_M_S:
            self._since_ns = None
        return None  # at such a speed the course is that of drift or noise, and the heading is not known


def turned_rad(verdict: Verdict | None, stopped: Verdict | None) -> float | None:
    """Returns the angle from the course on which the vehicle was stopped to its present one; None: one is not known."""
    course_rad = None if verdict is None else verdict.course_rad
    stopped_rad = None if stopped is None else stopped.course_rad
    if course_rad is None or stopped_rad is None:
        return None
    return math.remainder(course_rad - stopped_rad, math.tau)

"""DISTANCE_SENSOR upward and downward: the lowest obstacle above the vehicle, and the ground below it.

Upward, only obstacles that were seen are sent, never "clear". They are remembered, because a camera that looks ahead
does not see what the vehicle flies under."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.segment_distance import segment_distance_m
from drivers.mavlink.dialect import dialect

from ..config.avoidance import AvoidParams
from .obstacle_distance import SENSOR_UNKNOWN, limits_cm
from .obstacle_memory import Here, rotated
from .view_free import View, ground_z_m

NS = 1_000_000_000
UPWARD, DOWNWARD = dialect.MAV_SENSOR_ROTATION_PITCH_90, dialect.MAV_SENSOR_ROTATION_PITCH_270
SENSOR_ID, NO_COVARIANCE = 1, 255
MOST = 4096
"""Greatest number of undersides that are kept; the nearest ones are. Below a roof 15 frames a second have a hundred each."""


class Overhead:
    """Memory of the undersides of planes, in ned, while the autopilot reports a position."""

    def __init__(self, avoid: AvoidParams) -> None:
        self._avoid = avoid
        self._known = np.zeros((0, 7))  # a_x, a_y, b_x, b_y, underside z, margin, instant in s
        self._section: tuple[bool, int | None] = (False, None)
        self._place_m = np.zeros(3)
        self._velocity_m_s = np.zeros(3)
        self._followed_ns = 0
        self._turned_rad = 0.0

    def see(self, view: View, here: Here, now_ns: int) -> None:
        """Adds the planes of a new frame whose undersides are above the vehicle's middle."""
        self._follow(here, now_ns)
        planes = view.model.planes.astype(np.float64)
        over = planes[:, 5] < 0.0
        if not view.model.valid or not over.any():
            return
        ends = [here.to_world().places(*xy.T) for xy in (planes[over, 0:2], planes[over, 2:4])]
        rest = (planes[over, 5] + self._place_m[2], view.model.margin_m[over], np.full(over.sum(), now_ns / NS))
        self._known = np.concatenate([self._known, np.column_stack([*ends[0], *ends[1], *rest])])
        if len(self._known) > MOST:
            self._known = self._known[np.argsort(self._distance_m(), kind="stable")[:MOST]]

    def upward_m(self, here: Here, now_ns: int) -> float | None:
        """Returns the distance from the vehicle's middle up to the lowest obstacle above its hull, less the margin;
        None: not known.

        None does not mean clear."""
        self._follow(here, now_ns)
        self._known = self._known[now_ns / NS - self._known[:, 6] <= self._avoid.remember_up_s]
        known = self._known
        over = self._distance_m() <= self._avoid.radius_m + known[:, 5]
        above = known[over & (known[:, 4] < self._place_m[2])]
        if not len(above):
            return None
        return float(np.maximum(0.0, self._place_m[2] - above[:, 4] - above[:, 5]).min())

    def _distance_m(self) -> NDArray[np.float64]:
        """Returns the horizontal distance of each known underside from the vehicle, (N,)."""
        return segment_distance_m(self._place_m[:2], self._known[:, 0:2], self._known[:, 2:4])

    def _follow(self, here: Here, now_ns: int) -> None:
        """Forgets the memory if the position is lost, and moves the memory if the position or the heading jumps. What the
        vehicle has flown since is no jump."""
        section = (here.position_ned_m is not None, here.section)
        place_m = np.array(here.position_ned_m or (0.0, 0.0, 0.0))
        velocity_m_s = self._velocity_m_s if here.velocity_ned_m_s is None else np.array(here.velocity_ned_m_s)
        for ends in (slice(0, 2), slice(2, 4)):
            turned_rad = here.turned_rad - self._turned_rad
            self._known[:, ends] = rotated(self._known[:, ends], self._place_m[:2], turned_rad)
        if section != self._section:
            step = place_m - self._place_m - velocity_m_s * ((now_ns - self._followed_ns) / NS)
            self._known[:, 0:4] += np.tile(step[:2], 2)
            self._known[:, 4] += step[2]
        self._section, self._place_m, self._turned_rad = section, place_m, here.turned_rad
        self._velocity_m_s, self._followed_ns = velocity_m_s, now_ns
        if here.position_ned_m is None:
            self._known = self._known[:0]


def downward_m(views: Sequence[View]) -> float | None:
    """Returns the distance from the vehicle's middle down to the nearest ground that a camera sees now; None: none
    does."""
    here = np.zeros(1)
    found = [float(ground_z_m(view, here, here)[0]) for view in views]
    return min((m for m in found if 0.0 < m < math.inf), default=None)


def distance_sensor_message(distance_m: float, orientation: int, time_ms: int, avoid: AvoidParams) -> Any:
    """Returns the message. The distance is rounded towards the vehicle. orientation: UPWARD or DOWNWARD.

    A distance below min_distance is sent as it is: a greater one would be wrong, also as a height."""
    low, high = limits_cm(avoid)
    cm = min(high - 1, math.floor(100.0 * distance_m))
    return dialect.MAVLink_distance_sensor_message(
        time_ms % 2**32, low, high, cm, SENSOR_UNKNOWN, SENSOR_ID, orientation, NO_COVARIANCE
    )

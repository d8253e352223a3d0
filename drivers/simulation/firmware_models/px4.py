"""Model of PX4's obstacle map in collision prevention, for tests and the simulated autopilot.

The map has 72 bins of 5 degrees in PX4 v1.16 and 36 bins of 10 degrees up to v1.15, clockwise from the nose. A bin reads the
element of OBSTACLE_DISTANCE at its own angle; 65535 leaves the bin unchanged until its value is 0.5 s old. The reaction of the
vehicle in Position mode is modelled in `benchmarks.autopilot.px4_position_mode`. Not modelled: DISTANCE_SENSOR, messages in a frame aligned with north.

Source: CollisionPrevention.cpp of PX4 v1.14.3 (equal in v1.15.4) and v1.16.0. Later versions enter each element that overlaps a
bin, the last one stays: with elements of 5 degrees the same.
"""

from __future__ import annotations

import math
from typing import Any

from ...mavlink.dialect import dialect

NS = 1_000_000_000
UNKNOWN = 65535
STALE_NS = NS // 2
"""RANGE_STREAM_TIMEOUT_US."""
HOLD_NS = 5 * NS
"""TIMEOUT_HOLD_US."""


class Px4Reader:
    """Obstacle map of one PX4. bin_deg: 5 (v1.16) or 10 (up to v1.15). cp_dist_m: CP_DIST. system_id: MAV_SYS_ID."""

    def __init__(self, bin_deg: int = 5, cp_dist_m: float = 2.0, system_id: int = 1) -> None:
        self.bin_deg, self.cp_dist_m, self.system_id = bin_deg, cp_dist_m, system_id
        count = 360 // bin_deg
        self._cm = [UNKNOWN] * count
        self.ranges_cm = [0] * count
        self.updated_ns = [0] * count
        self._newest_ns: int | None = None
        self.min_cm = UNKNOWN

    def read(self, message: Any, now_ns: int) -> None:
        """Takes an OBSTACLE_DISTANCE. A message in another frame than MAV_FRAME_BODY_FRD is ignored."""
        step_deg = message.increment_f if message.increment_f > 0.0 else float(message.increment)
        if message.frame != dialect.MAV_FRAME_BODY_FRD or step_deg <= 0.0:
            return
        self._newest_ns = now_ns
        self.min_cm = min(self.min_cm, message.min_distance)
        cached = self.bins_cm(now_ns)
        for i in range(len(self._cm)):
            at = (i * self.bin_deg - message.angle_offset) % 360.0
            value = message.distances[math.ceil(at / step_deg)]
            if value != UNKNOWN and _accepts(cached[i], self.ranges_cm[i], value, message.max_distance):
                self._cm[i], self.ranges_cm[i], self.updated_ns[i] = value, message.max_distance, now_ns

    @property
    def keep_m(self) -> float:
        """Distance that PX4 keeps: the larger of min_distance and CP_DIST, metres."""
        return max(self.min_cm / 100.0, self.cp_dist_m)

    def bins_cm(self, now_ns: int) -> list[int]:
        """Value of each bin, cm. 65535: no data."""
        return [UNKNOWN if now_ns - at > STALE_NS else cm for cm, at in zip(self._cm, self.updated_ns, strict=True)]

    def has_data(self, now_ns: int) -> bool:
        """Whether any bin has data. Without data no movement is permitted."""
        fresh = self._newest_ns is not None and now_ns - self._newest_ns < STALE_NS
        return fresh and any(cm != UNKNOWN for cm in self.bins_cm(now_ns))

    def holds(self, now_ns: int) -> bool:
        """Whether PX4 has switched to Hold because no data came for 5 s. It sends that command to system 1."""
        silent = self._newest_ns is None or now_ns - self._newest_ns > HOLD_NS
        return self.system_id == 1 and silent and not self.has_data(now_ns)

    def feasible(self, index: int, now_ns: int) -> bool:
        """Whether PX4 permits movement into bin `index`: it has data. CP_GO_NO_DATA is 0, its default."""
        return self.bins_cm(now_ns)[index] != UNKNOWN

    def room_m(self, direction_deg: float, now_ns: int) -> float:
        """Distance that may be flown in a direction before the vehicle must stand: inf where clear, 0 where no movement is
        permitted. Each bin in the half plane ahead counts by the cosine of its angle to the direction."""
        if not self.has_data(now_ns) or not self.feasible(math.floor(direction_deg % 360.0 / self.bin_deg), now_ns):
            return 0.0
        room_m = math.inf
        for i, cm in enumerate(self.bins_cm(now_ns)):
            towards = math.cos(math.radians(i * self.bin_deg - direction_deg))
            if cm > self.min_cm and cm < self.ranges_cm[i] and towards > 0.1:
                room_m = min(room_m, max(0.0, cm / 100.0 - self.keep_m) / towards)
        return room_m


def _accepts(cached_cm: int, cached_range_cm: int, value_cm: int, range_cm: int) -> bool:
    """Whether a value of a sensor with this range replaces the value of a bin (_enterData). A sensor must not change its range:
    an obstacle replaces an obstacle only of the same or a longer range, and clear replaces an obstacle only of the same range.
    A bin without fresh data, 65535, takes both."""
    had_obstacle = cached_cm < cached_range_cm
    if value_cm < range_cm:
        return not had_obstacle or range_cm <= cached_range_cm
    return range_cm == cached_range_cm if had_obstacle else range_cm >= cached_range_cm

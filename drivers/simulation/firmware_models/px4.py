"""What PX4 makes of OBSTACLE_DISTANCE, by what its documentation says: for tests and for the simulated autopilot. It
answers what the vehicle would be told, not how it flies. ArduPilot's counterpart is in ardupilot_reader.py.

Collision prevention, Position mode: bins of 5 degrees, in older versions of 10, each reading the element at its own
angle alone; 65535 leaves a bin as it was until it is half a second old.
"""

from __future__ import annotations

import math
from typing import Any

NS = 1_000_000_000
UNKNOWN = 65535
STALE_NS = NS // 2
HOLD_NS = 5 * NS
BODY_FRD = 12


class Px4Reader:
    """The map of one PX4. bin_deg: 5 or, in older versions, 10. go_no_data: CP_GO_NO_DATA."""

    def __init__(self, bin_deg: int = 5, cp_dist_m: float = 2.0, go_no_data: bool = False) -> None:
        self.bin_deg, self.cp_dist_m, self.go_no_data = bin_deg, cp_dist_m, go_no_data
        count = 360 // bin_deg
        self._cm = [UNKNOWN] * count
        self.ranges_cm = [0] * count
        self._at_ns = [0] * count
        self._seen = [False] * count
        self._newest_ns: int | None = None
        self.min_cm = UNKNOWN

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message; one in a frame that it does not know is ignored."""
        if message.frame != BODY_FRD or message.increment_f <= 0.0:
            return
        self._newest_ns = now_ns
        self.min_cm = min(self.min_cm, message.min_distance)
        for i in range(len(self._cm)):
            at = (i * self.bin_deg - message.angle_offset) % 360.0
            value = message.distances[math.ceil(at / message.increment_f)]
            if value != UNKNOWN and self._accepts(i, value, message.max_distance):
                self._cm[i], self.ranges_cm[i], self._at_ns[i], self._seen[i] = (
                    value,
                    message.max_distance,
                    now_ns,
                    True,
                )

    def _accepts(self, i: int, value: int, range_cm: int) -> bool:
        """An obstacle replaces a nearer one only of the same or a longer range of the sensor; clear replaces an obstacle
        only of the same range. So a sensor must never change its range."""
        held, held_range = self._cm[i], self.ranges_cm[i]
        if value < range_cm:
            return held >= held_range or range_cm <= held_range
        return (held >= held_range and range_cm >= held_range) or (held < held_range and range_cm == held_range)

    def bins_cm(self, now_ns: int) -> list[int]:
        """What each bin holds now; 65535: nothing."""
        return [
            UNKNOWN if now_ns - at > STALE_NS else cm for cm, at in zip(self._cm, self._at_ns, strict=True)
        ]  # fmt: skip

    def has_data(self, now_ns: int) -> bool:
        """Whether anything is known at all; without it the vehicle does not move."""
        fresh = self._newest_ns is not None and now_ns - self._newest_ns < STALE_NS
        return fresh and any(cm != UNKNOWN for cm in self.bins_cm(now_ns))

    def holds(self, now_ns: int) -> bool:
        """Whether it has switched to Hold for want of data."""
        return not self.has_data(now_ns) and (self._newest_ns is None or now_ns - self._newest_ns > HOLD_NS)

    def room_m(self, direction_deg: float, now_ns: int) -> float:
        """How far the vehicle may still go in a direction before it has to stand: inf where it was told clear, 0 where it
        may not go at all. Every bin in front counts by how much of the way leads towards it."""
        if not self.has_data(now_ns):
            return 0.0
        bins = self.bins_cm(now_ns)
        own = math.floor(direction_deg % 360.0 / self.bin_deg)
        if bins[own] == UNKNOWN and not (self.go_no_data and not self._seen[own]):
            return 0.0
        keep_m = max(self.min_cm / 100.0, self.cp_dist_m)
        room_m = math.inf
        for i, cm in enumerate(bins):
            towards = math.cos(math.radians(i * self.bin_deg - direction_deg))
            if cm > self.min_cm and cm < self.ranges_cm[i] and towards > 0.1:
                room_m = min(room_m, max(0.0, cm / 100.0 - keep_m) / towards)
        return room_m

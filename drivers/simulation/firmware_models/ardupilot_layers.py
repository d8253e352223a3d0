"""What ArduPilot makes of OBSTACLE_DISTANCE_3D and of DISTANCE_SENSOR upward and downward, by its documented behaviour: for
tests and for the simulated autopilot.

Five layers of 30 degrees of height, each of eight faces; the nearest point of each counts, by its distance in space.
Messages of one time are one scan. It counts once the first message of the next scan comes; of version 4.1 the faces are
emptied by that message, and filled as points come. Newer versions keep a face without a point of the scan for 1.0 to 1.75 s
(AP_Proximity_Temp_Boundary::update_3D_boundary, check_face_timeout); here it is clear at once, so that an obstacle that is not
sent again is noticed at once.

Sources: AP_Proximity_MAV.cpp (handle_obstacle_distance_3d_msg, handle_distance_sensor_msg), AP_Proximity_Boundary_3D.cpp
(get_face).
"""

from __future__ import annotations

import math
from typing import Any

from ...mavlink.ardupilot_faces import FACES, face_of
from ...mavlink.dialect import dialect
from .ardupilot import STALE_NS, ArduPilotReader

LAYERS, MIDDLE, LAYER_DEG, LOWEST_DEG, HIGHEST_DEG = 5, 2, 30.0, -75.0, 74.9
SCAN_ENDS_NS = 50_000_000


def nothing() -> list[list[float]]:
    """All layers without an obstacle."""
    return [[math.inf] * FACES for _ in range(LAYERS)]


def layer_of(elevation_deg: float) -> int:
    """The layer a direction belongs to: 0 the lowest."""
    return int((min(HIGHEST_DEG, max(LOWEST_DEG, elevation_deg)) - LOWEST_DEG) / LAYER_DEG)


class ArduPilotLayers:
    """Points in, distances of the layers out; the one in the middle goes to the fence. at_once: as version 4.1 does."""

    def __init__(self, fence: ArduPilotReader, at_once: bool = False) -> None:
        self._fence, self._at_once = fence, at_once
        self._scan = nothing()
        self._time_ms: int | None = None
        self._newest_ns = 0
        self._published = nothing()

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message; any keeps proximity healthy, also one whose point is too near, too far or nowhere."""
        begins = message.time_boot_ms != self._time_ms or now_ns - self._newest_ns > SCAN_ENDS_NS
        self._time_ms, self._newest_ns = message.time_boot_ms, now_ns
        if message.frame != dialect.MAV_FRAME_BODY_FRD:
            return
        if begins:
            self._published, self._scan = (nothing() if self._at_once else self._scan), nothing()
        x, y, up = message.x, message.y, -message.z
        distance_m = math.sqrt(x * x + y * y + up * up)
        if distance_m > 0.0 and message.min_distance <= distance_m <= message.max_distance:
            face = face_of(math.degrees(math.atan2(y, x)) % 360.0)
            layer = self._scan[layer_of(math.degrees(math.atan2(up, math.hypot(x, y))))]
            layer[face] = min(layer[face], distance_m)
        if self._at_once:
            self._published = self._scan
        self._fence.take_faces(list(self._published[MIDDLE]), now_ns)

    def layers_m(self, now_ns: int) -> list[list[float]]:
        """Distance of each face of each layer; inf: none, which to it is the same as clear."""
        return [list(layer) for layer in self._published] if self._fence.healthy(now_ns) else nothing()


class ArduPilotHeights:
    """The distances up and down that were received; each counts for half a second, whatever was meant by its absence."""

    def __init__(self) -> None:
        self._published: dict[int, tuple[float, int]] = {}

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a DISTANCE_SENSOR."""
        self._published[message.orientation] = (message.current_distance / 100.0, now_ns)

    def up_m(self, now_ns: int) -> float | None:
        """To what stands over it; None: it climbs as it likes."""
        return self._fresh(dialect.MAV_SENSOR_ROTATION_PITCH_90, now_ns)

    def down_m(self, now_ns: int) -> float | None:
        """To the ground, as its rangefinder would measure it."""
        return self._fresh(dialect.MAV_SENSOR_ROTATION_PITCH_270, now_ns)

    def _fresh(self, orientation: int, now_ns: int) -> float | None:
        distance_m, at_ns = self._published.get(orientation, (0.0, now_ns - STALE_NS - 1))
        return distance_m if now_ns - at_ns <= STALE_NS else None

"""The newest obstacle distances sent to the autopilot, and those that it sent back, for the health report."""

from __future__ import annotations

import math
import threading
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.ardupilot_faces import FACES
from osape_client.proto import osape_v1_pb2 as pb

from .feedback_check import echoed_face
from .obstacle_distance import BODY_FRD, UNKNOWN
from .polar_histogram import SECTORS

NS: Final = 1_000_000_000
FORGOTTEN_NS: Final = 2 * NS
"""Older values are not reported: the autopilot does not use them any more."""


class SectorView:
    """The newest sent and echoed distances. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: pb.ObstacleSectors | None = None
        self._map: pb.ObstacleSectors | None = None
        self._faces: dict[int, tuple[int, int]] = {}

    def sent(self, values: NDArray[np.uint16], clear_cm: int, now_ns: int) -> None:
        """Records values that were sent, (72,) cm."""
        message = pb.ObstacleSectors(
            cm=values.tolist(), t_ns=now_ns, clear_cm=clear_cm, step_deg=360.0 / SECTORS, body_frame=True
        )
        with self._lock:
            self._sent = message

    def take(self, message: Any, now_ns: int) -> None:
        """Takes a message of the autopilot: PX4 echoes its map as OBSTACLE_DISTANCE, ArduPilot one DISTANCE_SENSOR
        per face."""
        if message.get_type() == "OBSTACLE_DISTANCE":
            first_deg, step_deg = float(message.angle_offset), float(message.increment_f or message.increment)
            if not (math.isfinite(first_deg) and math.isfinite(step_deg)):
                return  # readers of the report could not draw them
            echo = pb.ObstacleSectors(
                cm=[int(v) for v in message.distances],
                t_ns=now_ns,
                clear_cm=int(message.max_distance) + 1,
                first_deg=first_deg,
                step_deg=step_deg,
                body_frame=message.frame == BODY_FRD,
            )
            with self._lock:
                self._map = echo
        elif (face := echoed_face(message)) is not None:
            near = message.current_distance < message.max_distance  # the greatest distance stands for an empty face
            with self._lock:
                self._faces[face] = (now_ns, int(message.current_distance) if near else UNKNOWN)

    def fill(self, health: pb.AutopilotHealth, now_ns: int) -> None:
        """Writes the values that are not older than FORGOTTEN_NS into a report."""
        with self._lock:
            if self._sent is not None and now_ns - self._sent.t_ns <= FORGOTTEN_NS:
                health.obstacles_sent.CopyFrom(self._sent)
            faces = {k: (t, cm) for k, (t, cm) in self._faces.items() if now_ns - t <= FORGOTTEN_NS}
            if self._map is not None and now_ns - self._map.t_ns <= FORGOTTEN_NS:
                health.obstacles_echoed.CopyFrom(self._map)
            elif faces:
                echoed = pb.ObstacleSectors(
                    cm=[faces[k][1] if k in faces else UNKNOWN for k in range(FACES)],
                    t_ns=max(t for t, _ in faces.values()),
                    step_deg=360.0 / FACES,
                    body_frame=True,
                )
                health.obstacles_echoed.CopyFrom(echoed)

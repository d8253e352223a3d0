"""One PX4 in Position mode that gets what the service would send, without rendering: the sectors are given."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.autopilot.px4_position_mode import PositionMode
from companion.autopilot.obstacle_distance import BrakingReach, for_reader, obstacle_distance_message
from companion.config.avoidance import AvoidParams

NS = 1_000_000_000
STEP_NS = NS // 50
Values = NDArray[np.uint16]


@dataclass(slots=True, eq=False)
class Px4Loop:
    """Steps of 20 ms, a message in every third or fourth, as the service sends 15 a second. now_ns: monotonic instant; reach: of
    `braking_reach`, as the service has it at that instant."""

    vehicle: PositionMode
    avoid: AvoidParams
    now_ns: int = 10 * NS
    reach: BrakingReach | None = None
    _next_ns: int = field(default=0)

    def fly(self, seconds: float, stick: NDArray[np.float64], send: Callable[[int], Values | None]) -> None:
        """stick: (2,) forward and right. send: (72,) cm for an instant before the adaptation to PX4; None: no message."""
        end_ns = self.now_ns + round(seconds * NS)
        while self.now_ns < end_ns:
            self.now_ns += STEP_NS
            if self.now_ns >= self._next_ns:
                self._next_ns = max(self._next_ns, self.now_ns) + round(NS / self.avoid.rate_hz)
                values = send(self.now_ns)
                if values is not None:
                    values = for_reader(values, self.avoid, "PX4", self.reach)
                    self.vehicle.reader.read(obstacle_distance_message(values, 0, self.avoid), self.now_ns)
            self.vehicle.step(stick, STEP_NS / NS, self.now_ns)


def stick_at(deflection: float, angle_deg: float) -> NDArray[np.float64]:
    """(2,) forward and right; deflection 0 to 1, angle clockwise from the nose."""
    angle = math.radians(angle_deg)
    return deflection * np.array([math.cos(angle), math.sin(angle)])

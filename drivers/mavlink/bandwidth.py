"""Data rate of the requested and sent messages, compared with the capacity of the link.

Serial lines have their rate in each direction at once. UDP and TCP have no relevant limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .ardupilot_faces import FACES
from .parser import SIGNATURE_BYTES
from .session_types import MavlinkParams

SLOW_BAUD = 230_400
BITS_PER_BYTE = 10
"""8 data bits, start bit and stop bit."""
SHARE = 0.5
"""Share of the line available to this service: autopilots send more than it requests, and in bursts."""
FRAME = 12
"""Bytes of header and checksum."""
ATTITUDE, POSITION, OBSTACLES, POINT, FACE, HEARTBEAT, TIMESYNC = 32, 28, 167, 28, 39, 9, 16
"""Sizes of payloads in bytes."""
TIMESYNC_HZ, ECHO_HZ = 10.0, 2.0
"""Greatest rate of TIMESYNC, while the clock is estimated and PX4 sends its own requests; rate of the echoes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkBudget:
    """Data rates of a link."""

    need_in: float  # from the autopilot, bytes/s
    need_out: float  # to the autopilot, bytes/s
    line: float  # capacity of each direction, bytes/s
    attitude_hz: float  # requested rate of the attitude
    attitude_bytes: float  # size of its message

    def text(self) -> str:
        """Returns the figures."""
        return f"needs {self.need_in / 1000:.1f} kB/s in and {self.need_out / 1000:.1f} out of {self.line / 1000:.1f} each way"

    def warning(self) -> str:
        """Returns the warning for a slow line; empty: it is fast enough."""
        most, baud = max(self.need_in, self.need_out), round(self.line * BITS_PER_BYTE)
        if most > SHARE * self.line:
            # the rate that remains for the attitude
            room = SHARE * self.line - (self.need_in - self.attitude_hz * self.attitude_bytes)
            hz = max(5, math.floor(room / self.attitude_bytes))
            remedy = f", or attitude_hz = {hz}" if self.need_in > SHARE * self.line and hz < self.attitude_hz else ""
            return (
                f"the line of {baud} baud carries {self.line:.0f} bytes/s each way; the requested and sent messages "
                f"need {most:.0f} bytes/s: set 921600 baud{remedy}"
            )
        if baud < SLOW_BAUD:
            return (
                f"the line of {baud} baud is slow: the service needs {most:.0f} of its {self.line:.0f} bytes/s, and other "
                "messages of the autopilot delay the attitudes; set 921600 baud"
            )
        return ""


def budget_of(params: MavlinkParams, bytes_per_s: float | None, *, signed: bool = False) -> LinkBudget | None:
    """Returns the budget of a session with these parameters; None for a link without a limit. signed: messages are signed."""
    if bytes_per_s is None:
        return None
    around = FRAME + (SIGNATURE_BYTES if signed else 0)
    attitude_bytes = ATTITUDE + around
    motion = params.attitude_hz * attitude_bytes + params.position_hz * (POSITION + around)
    always = (HEARTBEAT + around) + TIMESYNC_HZ * (TIMESYNC + around)
    echo = ECHO_HZ * FACES * (FACE + around) if params.obstacles_hz else 0.0
    payloads = (OBSTACLES,) if params.obstacle_points == 0 else (POINT,) * params.obstacle_points
    payloads += (FACE,) * params.distance_sensors
    return LinkBudget(
        need_in=motion + 2.0 * always + echo + params.neighbours * params.tunnel_bytes_per_s,
        need_out=params.obstacles_hz * sum(payload + around for payload in payloads)
        + 2.0 * always
        + params.tunnel_bytes_per_s,
        line=bytes_per_s,
        attitude_hz=params.attitude_hz,
        attitude_bytes=attitude_bytes,
    )
